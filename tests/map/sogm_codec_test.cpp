// The SOGM on the wire: round trip, size, and what broken or hostile parts do.
#include "map_daemon/sogm_codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "lcmtypes/bus/crc32.h"
#include "map_daemon/obstacle.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using sogm_swarm::header_t;
using sogm_swarm::sogm_t;

header_t make_header(std::int64_t seq, std::int32_t boot = 1) {
  header_t header{};
  header.schema_version = header_t::kSchemaVersion;
  header.robot_id = 3;
  header.boot = boot;
  header.seq = seq;
  return header;
}

// 10 columns and 10 rings of the paper's kind around the robot.
Sogm paper_map(std::mt19937* rng) {
  const auto uniform = [rng](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(*rng);
  };
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {-50, -50, -10}, .size = {100, 100, 40}}, 20, kStart, 100ms);
  for (int i = 0; i < 20; ++i) {
    Obstacle obstacle;
    const double speed = uniform(0, 1), heading = uniform(0, 2 * std::numbers::pi);
    obstacle.velocity = {speed * std::cos(heading), speed * std::sin(heading), 0};
    obstacle.position = {uniform(-5, 5), uniform(-5, 5), 2.0};
    obstacle.utime = sogm.start_utime;
    if (i % 2 == 0) {
      obstacle.shape.size = {uniform(0.5, 1.0), 4.0, 0.0};
    } else {
      obstacle.shape.kind = Shape::Kind::kRing;
      obstacle.shape.size = {uniform(0.7, 2.5), 0.1, 0.0};
      obstacle.shape.yaw_rad = uniform(-3, 3);
      obstacle.position.z() = uniform(0.8, 2.0);
    }
    rasterize(obstacle, 0.05, 0.0, &sogm);
  }
  return sogm;
}

Sogm noise(const Eigen::Vector3i& size, int frames, std::mt19937* rng) {
  Sogm sogm;
  sogm.reset({.resolution_m = 0.15, .origin = {7, -8, 9}, .size = size}, frames, to_utime(123'456'789), 50ms);
  const int tail = size.z() % 64, words = sogm.geometry.words_per_column();
  std::uniform_int_distribution<std::uint64_t> bits;
  const auto all = sogm.words_to_write();
  for (std::size_t i = 0; i < all.size(); ++i) {
    all[i] = bits(*rng);
    if (tail != 0 && i % words == static_cast<std::size_t>(words) - 1) all[i] &= (std::uint64_t{1} << tail) - 1;
  }
  return sogm;
}

void expect_equal(const Sogm& a, const Sogm& b) {
  EXPECT_EQ(a.start_utime, b.start_utime);
  EXPECT_EQ(a.frame_duration, b.frame_duration);
  EXPECT_EQ(a.num_frames, b.num_frames);
  EXPECT_EQ(a.geometry, b.geometry);
  EXPECT_TRUE(a.words() == b.words());
}

std::vector<sogm_t> parts_of(const Sogm& sogm, std::int64_t seq, std::int32_t boot = 1) {
  SogmEncoder encoder;
  const auto parts = encoder.encode(sogm, make_header(seq, boot));
  return {parts.begin(), parts.end()};
}

// Through the bytes of the wire and all their checks.
sogm_t transported(const sogm_t& part) {
  std::vector<std::uint8_t> bytes;
  encode(part, &bytes);
  sogm_t out;
  EXPECT_EQ(decode<sogm_t>(bytes, &out), Refusal::kNone);
  return out;
}

TEST(SogmCodec, RoundTripsInAnyOrderWithDuplicates) {
  std::mt19937 rng(5);
  SogmAssembler assembler;
  Sogm out;
  std::int64_t seq = 0;
  std::size_t most_parts = 0;
  const Eigen::Vector3i sizes[] = {{1, 1, 1}, {30, 40, 40}, {33, 21, 65}, {9, 7, 128}, {120, 50, 64}};
  for (const Eigen::Vector3i& size : sizes) {
    for (int frames : {1, 3, 12}) {
      const Sogm in = noise(size, frames, &rng);
      std::vector<sogm_t> parts = parts_of(in, seq++);
      most_parts = std::max(most_parts, parts.size());
      std::shuffle(parts.begin(), parts.end(), rng);
      for (std::size_t i = 0; i < parts.size(); ++i) {
        EXPECT_LE(parts[i].num_bytes, 60000);
        const bool last = i + 1 == parts.size();
        const Assembly assembly = assembler.add(transported(parts[i]), &out);
        ASSERT_EQ(assembly.status, last ? AssemblyStatus::kComplete : AssemblyStatus::kIncomplete)
            << to_string(assembly.refusal);
        if (!last) {
          EXPECT_EQ(assembler.add(parts[i / 2], &out).status, AssemblyStatus::kIncomplete);
        }
      }
      expect_equal(in, out);
      EXPECT_EQ(assembler.add(parts[0], &out).refusal, Refusal::kSequence);  // a late duplicate
    }
  }
  EXPECT_GE(most_parts, 8u);
}

TEST(SogmCodec, PaperMapFitsOneDatagramAndIsDeterministic) {
  std::mt19937 rng(6);
  std::size_t most = 0;
  for (int trial = 0; trial < 20; ++trial) {
    const Sogm in = paper_map(&rng);
    const std::vector<sogm_t> parts = parts_of(in, trial), again = parts_of(in, trial);
    ASSERT_EQ(parts.size(), 1u);
    EXPECT_EQ(parts[0].packed, again[0].packed);
    EXPECT_EQ(to_utime(parts[0].header.utime), in.start_utime);
    most = std::max(most, parts[0].packed.size());
    Sogm out;
    SogmAssembler assembler;
    ASSERT_EQ(assembler.add(transported(parts[0]), &out).status, AssemblyStatus::kComplete);
    expect_equal(in, out);
  }
  RecordProperty("largest_map_bytes", static_cast<int>(most));
  EXPECT_LT(most, 60000u);
}

// As lcmtypes/sogm_t.lcm says, by hand: two columns that are alike, of which one goes, and one of every other voxel.
TEST(SogmCodec, TheBytesAreThoseOfTheFormat) {
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {20, 10, 64}}, 2, Utime(), 100ms);
  for (int frame : {0, 1}) {
    sogm.column(frame, 0, 2)[0] = 0xF0;
    sogm.column(frame, 0, 4)[0] = 0xF0;
    sogm.column(frame, 9, 9)[0] = 0x5555'5555'5555'5555;
  }
  sogm.column(1, 0, 4)[0] = 0;
  const std::vector<std::vector<std::uint8_t>> tokens = {
      {4, 0, 0, 0},                                                      // so many words
      {0xC2, 4, 0x88},                                                   // after 2: a new one, edges at bits 4 and 8
      {0x01},                                                            // after 1: as the first table has it
      {0xFF, 31, 0x40, 0x55, 0x55, 0x55, 0x55, 0x55, 0x55, 0x55, 0x55},  // after 63 + 31: a new one, as it is
      {0xBF, 41, 0x39},                                                  // after 63 + 41: as the third table has it
  };
  std::vector<std::uint8_t> bytes;
  for (const auto& token : tokens) bytes.insert(bytes.end(), token.begin(), token.end());
  const std::vector<sogm_t> parts = parts_of(sogm, 0);
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_EQ(parts[0].packed, bytes);
}

// No library, processor or compiler has a say.
TEST(SogmCodec, TheSameBytesOnEveryMachine) {
  std::uint64_t state = 1;
  const auto number = [&state](std::uint64_t below) {  // of our own: the library's distributions differ
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (state >> 33) % below;
  };
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {60, 50, 70}}, 10, Utime(), 100ms);
  for (int box = 0; box < 200; ++box) {
    const int x = static_cast<int>(number(58)), y = static_cast<int>(number(48));
    const std::uint64_t bits = (std::uint64_t{1} << number(40)) - 1;
    for (int frame = static_cast<int>(number(10)); frame < 10; ++frame) {
      for (int i = 0; i < 6; ++i) sogm.column(frame, x + i % 3, y + i / 3)[0] |= bits << 20;
    }
  }
  const std::vector<sogm_t> parts = parts_of(sogm, 0);
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_EQ(parts[0].packed.size(), 1916u);
  EXPECT_EQ(crc32(parts[0].packed), 0x555E19B3u);
}

// Encoder, assembler and both maps are used again and again; what is looked at is where something was written.
TEST(SogmCodec, TheBytesAreThoseOfTheWholeGrid) {
  std::mt19937 rng(11);
  const auto number = [&rng](int below) { return static_cast<int>(rng() % static_cast<unsigned>(below)); };
  SogmEncoder encoder;
  SogmAssembler assembler;
  Sogm sparse, whole, out;
  for (int seq = 0; seq < 400; ++seq) {
    const Eigen::Vector3i size(30, seq % 100 < 50 ? 20 : 37, seq % 40 < 20 ? 40 : 100);
    sparse.reset({.resolution_m = 0.1, .origin = {seq, 0, 0}, .size = size}, 1 + seq / 100, kStart, 100ms);
    whole.reset(sparse.geometry, sparse.num_frames, kStart, 100ms);
    for (int i = number(20); i > 0; --i) {
      const int x = number(size.x()), y = number(size.y()), z = number(size.z());
      for (int frame = number(sparse.num_frames); frame < sparse.num_frames; ++frame)
        set_run(z, z + number(9), size.z(), sparse.column(frame, x, y));
    }
    std::ranges::copy(sparse.words(), whole.words_to_write().begin());
    const auto parts = encoder.encode(sparse, make_header(seq));
    ASSERT_EQ(parts.size(), 1u) << seq;
    ASSERT_EQ(parts[0].packed, parts_of(whole, seq)[0].packed) << seq;
    ASSERT_EQ(assembler.add(parts[0], &out).status, AssemblyStatus::kComplete) << seq;
    expect_equal(whole, out);
    ASSERT_EQ(parts_of(out, seq)[0].packed, parts[0].packed) << seq;
  }
}

TEST(SogmCodec, NewerMapsReplaceIncompleteOnes) {
  std::mt19937 rng(7);
  const Sogm first = noise({60, 50, 64}, 8, &rng), second = noise({20, 20, 20}, 4, &rng);
  const std::vector<sogm_t> old_parts = parts_of(first, 10), new_parts = parts_of(second, 11);
  ASSERT_GE(old_parts.size(), 3u);
  SogmAssembler assembler;
  Sogm out;
  EXPECT_EQ(assembler.add(old_parts[0], &out).status, AssemblyStatus::kIncomplete);
  EXPECT_EQ(assembler.add(new_parts[0], &out).status, AssemblyStatus::kComplete);
  expect_equal(second, out);
  EXPECT_EQ(assembler.add(old_parts[1], &out).refusal, Refusal::kSequence);
  expect_equal(second, out);
  // A restarted sender counts from anew under a higher boot.
  for (const sogm_t& part : parts_of(first, 0, 2)) {
    EXPECT_NE(assembler.add(part, &out).status, AssemblyStatus::kRefused);
  }
  expect_equal(first, out);
  EXPECT_EQ(assembler.add(parts_of(second, 99, 1)[0], &out).refusal, Refusal::kSequence);
}

TEST(SogmCodec, ContradictingPartsAreRefusedAndTheMapStillCompletes) {
  std::mt19937 rng(8);
  const Sogm in = noise({60, 50, 64}, 8, &rng);
  const std::vector<sogm_t> parts = parts_of(in, 1);
  SogmAssembler assembler;
  Sogm out;
  ASSERT_EQ(assembler.add(parts[0], &out).status, AssemblyStatus::kIncomplete);
  const auto expect_refused = [&](const auto& change) {
    sogm_t wrong = parts[1];
    change(&wrong);
    const Assembly assembly = assembler.add(wrong, &out);
    EXPECT_EQ(assembly.status, AssemblyStatus::kRefused);
    EXPECT_EQ(assembly.refusal, Refusal::kInconsistent);
  };
  expect_refused([](sogm_t* part) { ++part->header.utime; });
  expect_refused([](sogm_t* part) { ++part->header.robot_id; });
  expect_refused([](sogm_t* part) { ++part->frame_duration_us; });
  expect_refused([](sogm_t* part) { ++part->num_frames; });
  expect_refused([](sogm_t* part) { ++part->size[1]; });
  expect_refused([](sogm_t* part) { ++part->origin[2]; });
  expect_refused([](sogm_t* part) { part->resolution *= 2; });
  expect_refused([](sogm_t* part) { ++part->num_parts; });
  expect_refused([](sogm_t* part) { ++part->total_bytes; });
  for (std::size_t i = 1; i < parts.size(); ++i)
    EXPECT_NE(assembler.add(parts[i], &out).status, AssemblyStatus::kRefused);
  expect_equal(in, out);
}

// Content that passed the envelope's checks (its CRC is right) but was never made by the encoder.
TEST(SogmCodec, DamagedContentNeverBecomesAMap) {
  std::mt19937 rng(9);
  const Sogm in = paper_map(&rng);
  const sogm_t good = parts_of(in, 0)[0];
  SogmAssembler assembler;
  Sogm out;
  std::int64_t seq = 0;
  int refused = 0;
  const auto add = [&](sogm_t part) {
    part.header.seq = seq++;
    part.num_bytes = part.total_bytes = static_cast<std::int32_t>(part.packed.size());
    const Assembly assembly = assembler.add(part, &out);
    if (assembly.status == AssemblyStatus::kComplete) {  // a damaged bit may still decode: then within the window
      EXPECT_EQ(out.geometry, in.geometry);
      EXPECT_TRUE(
          std::all_of(out.words().begin(), out.words().end(), [](std::uint64_t word) { return word >> 40 == 0; }));
    } else {
      EXPECT_EQ(assembly.status, AssemblyStatus::kRefused);
      ++refused;
    }
    return assembly.refusal;
  };
  for (int trial = 0; trial < 300; ++trial) {  // flipped bits
    sogm_t part = good;
    part.packed[rng() % part.packed.size()] ^= static_cast<std::uint8_t>(1u << rng() % 8);
    (void)add(part);
  }
  EXPECT_GT(refused, 150);
  for (std::size_t size = 1; size < good.packed.size(); size += 1 + good.packed.size() / 50) {  // cut short
    sogm_t part = good;
    part.packed.resize(size);
    EXPECT_NE(add(part), Refusal::kNone) << size;
  }
  for (int trial = 0; trial < 100; ++trial) {  // garbage
    sogm_t part = good;
    for (std::uint8_t& byte : part.packed) byte = static_cast<std::uint8_t>(rng());
    EXPECT_NE(add(part), Refusal::kNone);
  }
  sogm_t longer = good;
  longer.packed.push_back(0);
  EXPECT_EQ(add(longer), Refusal::kInconsistent);
  sogm_t twice = good;  // two maps in a row
  twice.packed.insert(twice.packed.end(), good.packed.begin(), good.packed.end());
  EXPECT_EQ(add(twice), Refusal::kInconsistent);
  EXPECT_EQ(add(good), Refusal::kNone);
  expect_equal(in, out);
}

TEST(SogmCodec, BombsAndWrongSizesAreRefused) {
  Sogm zeros;  // but for one voxel: 15 MB in a few bytes
  zeros.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {512, 512, 64}}, 7, Utime(), 100ms);
  for (int frame = 0; frame < 7; ++frame) zeros.column(frame, 511, 511)[0] = 1;
  std::vector<sogm_t> parts = parts_of(zeros, 0);
  ASSERT_EQ(parts.size(), 1u);
  SogmAssembler assembler;
  Sogm out;
  sogm_t small = parts[0];  // says it is a small grid
  small.size[0] = small.size[1] = 10;
  EXPECT_EQ(assembler.add(small, &out).refusal, Refusal::kInconsistent);
  sogm_t large = parts[0];  // says it is above the cap
  large.header.seq = 1;
  large.num_frames = 9;
  EXPECT_EQ(assembler.add(large, &out).refusal, Refusal::kLength);
  EXPECT_EQ(out.num_frames, 0);
  large.num_frames = 7;  // the refused one has not used up its number
  EXPECT_EQ(assembler.add(large, &out).status, AssemblyStatus::kComplete);
  expect_equal(zeros, out);
}

TEST(SogmCodec, BitsAboveTheWindowAreRefused) {
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {4, 4, 70}}, 2, Utime(), 100ms);
  sogm.column(1, 3, 2)[1] = std::uint64_t{1} << 6;  // voxel 70
  SogmAssembler assembler;
  Sogm out;
  EXPECT_EQ(assembler.add(parts_of(sogm, 0)[0], &out).refusal, Refusal::kValue);
  sogm.column(1, 3, 2)[1] = std::uint64_t{1} << 5;  // voxel 69
  EXPECT_EQ(assembler.add(parts_of(sogm, 1)[0], &out).status, AssemblyStatus::kComplete);
}

TEST(SogmCodec, IncompressibleMapsAboveThePartLimitAreNotSent) {
  std::mt19937 rng(10);
  const Sogm sogm = noise({100, 100, 64}, 50, &rng);  // 4 MB of noise
  SogmEncoder encoder;
  EXPECT_TRUE(encoder.encode(sogm, make_header(0)).empty());
  EXPECT_GT(encoder.compressed_bytes(), 64 * 60000);
}

}  // namespace
}  // namespace swarm
