// Checked decoding: what was encoded comes back, and whatever else arrives is refused for the right reason.
#include "lcmtypes/bus/codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "lcmtypes/bus/crc32.h"
#include "tests/support/random_messages.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using namespace random_messages;
using Bytes = std::vector<std::uint8_t>;

// The length field of each type that has one.
template <class T, class Array = std::remove_const_t<decltype(MessageTraits<T>::kArray)>>
struct CountField {
  static constexpr int bytes = sizeof(std::declval<T>().*(MessageTraits<T>::kArray.count));
  static constexpr int cap = MessageTraits<T>::kArray.max_count;
};
template <class T>
struct CountField<T, NoArray> {
  static constexpr int bytes = 0, cap = 0;
};

// The definition, bit by bit.
std::uint32_t slow_crc32(std::span<const std::uint8_t> bytes) {
  std::uint32_t crc = ~0u;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1u) != 0 ? (crc >> 1) ^ 0xEDB88320u : crc >> 1;
  }
  return ~crc;
}

void put_big_endian(Bytes& bytes, std::size_t offset, int width, std::int64_t value) {
  for (int i = 0; i < width; ++i) bytes[offset + i] = static_cast<std::uint8_t>(value >> (8 * (width - 1 - i)));
}

void reseal(Bytes& bytes) {
  if (bytes.size() > 12) put_big_endian(bytes, 8, 4, crc32(std::span(bytes).subspan(12)));
}

template <class T>
Bytes encoded(const T& message) {
  Bytes bytes;
  encode(message, &bytes);
  return bytes;
}

// Decodes from memory of exactly this size, so that a sanitizer sees any byte read beyond it.
template <class T>
Refusal judge(const Bytes& bytes, T* message) {
  const std::unique_ptr<std::uint8_t[]> exact(new std::uint8_t[bytes.size()]);
  std::copy(bytes.begin(), bytes.end(), exact.get());
  return decode(std::span<const std::uint8_t>(exact.get(), bytes.size()), message);
}
template <class T>
Refusal judge(const Bytes& bytes) {
  T message;
  return judge(bytes, &message);
}

template <class T>
class CodecTest : public testing::Test {};
struct TypeNames {
  template <class T>
  static std::string GetName(int) {  // NOLINT(readability-identifier-naming): GoogleTest calls it
    return T::getTypeName();
  }
};
TYPED_TEST_SUITE(CodecTest, AllTypes, TypeNames);

TYPED_TEST(CodecTest, RoundTrip) {
  Random random(1);
  TypeParam decoded;  // reused, as the nodes do
  for (const int elements : {0, 1, 7, 300, 0, CountField<TypeParam>::cap}) {
    for (int repeat = 0; repeat < 20; ++repeat) {
      const Bytes bytes = encoded(make<TypeParam>(random, elements));
      ASSERT_EQ(judge(bytes, &decoded), Refusal::kNone) << to_string(judge(bytes, &decoded)) << ", " << elements;
      ASSERT_EQ(encoded(decoded), bytes);
      ASSERT_EQ(slow_crc32(std::span(bytes).subspan(12)), static_cast<std::uint32_t>(decoded.header.crc32));
    }
  }
}

TYPED_TEST(CodecTest, RefusesEveryOtherLength) {
  Random random(2);
  const Bytes bytes = encoded(make<TypeParam>(random, 3));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    Bytes cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    ASSERT_NE(judge<TypeParam>(cut), Refusal::kNone) << size;
    reseal(cut);
    const Refusal refusal = judge<TypeParam>(cut);
    ASSERT_TRUE(refusal == Refusal::kSize || refusal == Refusal::kLength) << size << ": " << to_string(refusal);
  }
  for (const int more : {1, 4, 1000, 1 << 20}) {
    Bytes longer = bytes;
    longer.resize(bytes.size() + static_cast<std::size_t>(more));
    reseal(longer);
    ASSERT_EQ(judge<TypeParam>(longer), Refusal::kSize) << more;
  }
}

TYPED_TEST(CodecTest, RefusesEveryFlippedBit) {
  Random random(3);
  Bytes bytes = encoded(make<TypeParam>(random, 5));
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    const Refusal refusal = judge<TypeParam>(bytes);
    if (bit < 64) {
      ASSERT_EQ(refusal, Refusal::kFingerprint);
    } else {
      ASSERT_TRUE(refusal == Refusal::kCrc || refusal == Refusal::kLength || refusal == Refusal::kSize)
          << bit << ": " << to_string(refusal);
    }
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
  }
}

TYPED_TEST(CodecTest, RefusesWrongCounts) {
  using Field = CountField<TypeParam>;
  if constexpr (Field::bytes > 0) {
    Random random(4);
    const Bytes bytes = encoded(make<TypeParam>(random, 6));
    const std::size_t offset = static_cast<std::size_t>(TypeParam{}.getEncodedSize()) - Field::bytes;
    const std::int64_t highest = (std::int64_t{1} << (8 * Field::bytes - 1)) - 1;
    for (const std::int64_t count : {std::int64_t{-1}, -highest - 1, -highest, highest, highest / 2,
                                     std::int64_t{Field::cap} + 1, std::int64_t{Field::cap}, std::int64_t{7}}) {
      Bytes wrong = bytes;
      put_big_endian(wrong, offset, Field::bytes, count);
      reseal(wrong);
      EXPECT_EQ(judge<TypeParam>(wrong), Refusal::kLength) << count;
    }
    for (const std::int64_t count : {0, 3}) {
      Bytes wrong = bytes;
      put_big_endian(wrong, offset, Field::bytes, count);
      reseal(wrong);
      EXPECT_EQ(judge<TypeParam>(wrong), Refusal::kSize) << count;
    }
  }
}

TYPED_TEST(CodecTest, RefusesWrongHeaders) {
  Random random(5);
  const auto refusal = [&random](auto spoil) {
    TypeParam message = make<TypeParam>(random, 2);
    spoil(message.header);
    return judge<TypeParam>(encoded(message));
  };
  EXPECT_EQ(refusal([](header_t& h) { h.schema_version = header_t::kSchemaVersion - 1; }), Refusal::kVersion);
  EXPECT_EQ(refusal([](header_t& h) { h.schema_version = -1; }), Refusal::kVersion);
  EXPECT_EQ(refusal([](header_t& h) { h.robot_id = -1; }), Refusal::kValue);
  EXPECT_EQ(refusal([](header_t& h) { h.boot = -1; }), Refusal::kValue);
  EXPECT_EQ(refusal([](header_t& h) { h.seq = -1; }), Refusal::kValue);
  EXPECT_EQ(refusal([](header_t& h) { h.utime = -1; }), Refusal::kValue);
  EXPECT_EQ(refusal([](header_t& h) { h.utime = std::numeric_limits<std::int64_t>::max(); }), Refusal::kValue);
}

TYPED_TEST(CodecTest, RefusesOtherTypes) {
  Random random(6);
  // The neighbour's bytes, cut or filled to a size that this type might have.
  using Other = std::conditional_t<std::is_same_v<TypeParam, goal_t>, robot_state_t, goal_t>;
  Bytes bytes = encoded(make<Other>(random, 0));
  bytes.resize(encoded(make<TypeParam>(random, 0)).size());
  reseal(bytes);
  EXPECT_EQ(judge<TypeParam>(bytes), Refusal::kFingerprint);
}

TYPED_TEST(CodecTest, RefusesNumbersThatAreNotFinite) {
  Random random(7);
  TypeParam message = make<TypeParam>(random, 2);
  int fields = 0;
  each_real(message, [&](auto& value) {
    ++fields;
    const auto good = value;
    using Real = std::remove_reference_t<decltype(value)>;
    using Limits = std::numeric_limits<Real>;
    for (const Real bad : {Limits::quiet_NaN(), -Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity()}) {
      value = bad;
      const Refusal refusal = judge<TypeParam>(encoded(message));
      // The knots of a trajectory that is not there must be zero, which is another rule.
      EXPECT_TRUE(refusal == Refusal::kValue || refusal == Refusal::kInconsistent) << fields << ": " << bad;
    }
    value = good;
  });
  constexpr bool has_none = std::same_as<TypeParam, map_request_t> || std::same_as<TypeParam, packed_announcement_t> ||
                            std::same_as<TypeParam, last_words_t> || std::same_as<TypeParam, cell_announcement_t> ||
                            std::same_as<TypeParam, cell_roster_t>;
  EXPECT_EQ(fields > 0, !has_none);
  EXPECT_EQ(judge<TypeParam>(encoded(message)), Refusal::kNone);
}

// Garbage, and valid messages spoilt behind an intact seal: never a crash, never accepted as something else than it is.
TYPED_TEST(CodecTest, Fuzz) {
  Random random(8);
  std::array<int, kNumRefusals> counts{};
  TypeParam decoded;
  for (int i = 0; i < 10'000; ++i) {
    Bytes bytes;
    if (i % 10 == 0) {
      bytes.resize(static_cast<std::size_t>(integer(random, 0, 1500)));
      for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
      if (i % 20 == 0 && bytes.size() >= 8) put_big_endian(bytes, 0, 8, TypeParam::getHash());
    } else {
      bytes = encoded(make<TypeParam>(random, integer(random, 0, 9) < 9 ? integer(random, 0, 6) : 40));
      for (int change = integer(random, 1, 3); change > 0; --change) {
        const auto at = static_cast<std::size_t>(integer(random, 12, static_cast<int>(bytes.size()) - 1));
        bytes[at] =
            static_cast<std::uint8_t>(integer(random, 0, 2) == 0 ? random() : bytes[at] ^ (1u << (random() % 8)));
      }
      if (integer(random, 0, 9) == 0) bytes.resize(static_cast<std::size_t>(integer(random, 0, 1500)));
      reseal(bytes);
    }
    const Refusal refusal = judge(bytes, &decoded);
    ++counts[static_cast<std::size_t>(refusal)];
    if (refusal == Refusal::kNone) {
      ASSERT_EQ(encoded(decoded), bytes) << i;
      each_real(decoded, [&](auto value) { ASSERT_TRUE(std::isfinite(value)) << i; });
    }
  }
  // Accepted changes and refusals of each depth were really met.
  for (const Refusal met :
       {Refusal::kNone, Refusal::kSize, Refusal::kFingerprint, Refusal::kVersion, Refusal::kValue}) {
    EXPECT_GT(counts[static_cast<std::size_t>(met)], 20) << to_string(met);
  }
  EXPECT_EQ(counts[static_cast<std::size_t>(Refusal::kDecode)], 0);  // all was refused before
}

TEST(Crc32, IsTheStandardOne) {
  const std::string check = "123456789";
  const Bytes bytes(check.begin(), check.end());
  EXPECT_EQ(crc32(bytes), 0xCBF43926u);
  Random random(9);
  for (std::size_t size = 0; size < 70; ++size) {
    Bytes noise(size);
    for (std::uint8_t& byte : noise) byte = static_cast<std::uint8_t>(random());
    ASSERT_EQ(crc32(noise), slow_crc32(noise)) << size;
    const auto first = std::span(noise).first(size / 3);
    ASSERT_EQ(crc32(std::span(noise).subspan(first.size()), crc32(first)), slow_crc32(noise)) << size;
  }
}

TEST(Codec, RefusesToEncodeACountThatIsNotTheNumberOfElements) {
  Random random(10);
  auto message = make<sogm_t>(random, 5);
  Bytes bytes;
  for (const int count : {-1, 0, 4, 6}) {
    message.num_bytes = count;
    EXPECT_THROW(encode(message, &bytes), std::logic_error) << count;
  }
}

TEST(CheckTime, HoldsAtItsBoundsAndForAnyTime) {
  EXPECT_EQ(check_time(kStart - 500us, kStart, 500us, 100us), Refusal::kNone);
  EXPECT_EQ(check_time(kStart - 501us, kStart, 500us, 100us), Refusal::kTime);
  EXPECT_EQ(check_time(kStart + 100us, kStart, 500us, 100us), Refusal::kNone);
  EXPECT_EQ(check_time(kStart + 101us, kStart, 500us, 100us), Refusal::kTime);
  EXPECT_EQ(check_time(Utime::min(), kStart, 500us, 100us), Refusal::kTime);
  EXPECT_EQ(check_time(Utime::max(), kStart, 500us, 100us), Refusal::kTime);
}

TEST(SequenceGate, LetsOnlyNewerMessagesPass) {
  SequenceGate gate;
  header_t header{};
  const auto pass = [&](std::int32_t boot, std::int64_t seq) {
    header.boot = boot;
    header.seq = seq;
    return gate.pass(header);
  };
  EXPECT_EQ(pass(5, 0), Refusal::kNone);
  EXPECT_EQ(pass(5, 0), Refusal::kSequence);
  EXPECT_EQ(pass(5, 7), Refusal::kNone);
  EXPECT_EQ(pass(5, 6), Refusal::kSequence);
  EXPECT_EQ(pass(4, 100), Refusal::kSequence);  // from before the restart
  EXPECT_EQ(pass(6, 0), Refusal::kNone);
  EXPECT_EQ(pass(5, 8), Refusal::kSequence);
}

TEST(RefusalCounts, CountsByReason) {
  RefusalCounts counts;
  for (int i = 0; i < 3; ++i) counts.count(Refusal::kCrc);
  counts.count(Refusal::kDecode);
  std::int32_t out[kNumRefusals];
  counts.copy_to(out);
  EXPECT_EQ(counts.total(), 4);
  for (int i = 0; i < kNumRefusals; ++i) {
    const auto reason = static_cast<Refusal>(i);
    EXPECT_EQ(out[i], reason == Refusal::kCrc ? 3 : reason == Refusal::kDecode ? 1 : 0) << to_string(reason);
    EXPECT_EQ(out[i], counts[reason]);
  }
}

}  // namespace
}  // namespace swarm
