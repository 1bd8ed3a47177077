// Packed announcements: what is packed comes back to the last bit, on every machine; what else arrives is refused.
#include "lcmtypes/bus/packed_announcement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "lcmtypes/bus/crc32.h"
#include "lcmtypes/bus/seal.h"
#include "lcmtypes/bus/validate.h"
#include "tests/support/random_messages.h"

namespace swarm {
namespace {

using namespace random_messages;
using Bytes = std::vector<std::uint8_t>;

Bytes bytes_of(const announcement_t& message) {
  Bytes bytes;
  encode(message, &bytes);
  return bytes;
}

// A robot that flies a curve, as a planner's.
trajectory_t curve(int seq, std::int64_t utime, double phase) {
  trajectory_t t{};
  t.seq = seq;
  t.start_utime = utime;
  t.piece_us = 200'000;
  t.num_pieces = 10;
  for (int k = 0; k <= 10; ++k) {
    const double u = phase + 0.3 * k, w = 0.7 * u, moves = k < 10 ? 1.0 : 0.0;  // 1.5 rad/s
    const double velocity[] = {2 * std::cos(u), -2 * std::sin(w), 0.0};
    const double acceleration[] = {-3 * std::sin(u), -2.1 * std::cos(w), 0.0};
    const double position[] = {2 / 1.5 * std::sin(u), 2 / 1.05 * std::cos(w), 1.5};
    for (int axis = 0; axis < 3; ++axis) {
      t.knots[k][axis] = static_cast<float>(position[axis]);
      t.knots[k][3 + axis] = static_cast<float>(moves * velocity[axis]);
      t.knots[k][6 + axis] = static_cast<float>(moves * acceleration[axis]);
    }
  }
  return t;
}

announcement_t in_flight(int robots) {
  announcement_t m{};
  m.header.robot_id = 3;
  m.header.boot = 1'764'000'000;
  m.header.seq = 5000;
  m.header.utime = to_us(kStart);
  m.radius = 0.2f;
  m.committed = curve(117, m.header.utime - 140'000, 0.0);
  m.pending = curve(119, m.header.utime + 60'000, 0.3);
  m.pending_state = announcement_t::kAnnounced;
  m.pending_stamp = m.header.utime - 10'000;
  m.roster_crc = -123456789;
  m.least_delay_us = 2345;
  for (int i = 0; i < robots; ++i) m.acks.push_back({1'764'000'000 + 37 * i % 100, 0, ack_t::kNone});
  m.num_acks = static_cast<std::int16_t>(robots);
  return m;
}

TEST(PackedAnnouncement, ComesBackAsItWasPacked) {
  Random random(1);
  announcement_t unpacked;  // used again, as nodes do
  for (int i = 0; i < 2000; ++i) {
    auto message = make<announcement_t>(random, i % 61);
    const auto before = message;
    const packed_announcement_t packed = pack(&message);
    ASSERT_EQ(unpack(packed, &unpacked), Refusal::kNone) << i;
    ASSERT_EQ(bytes_of(unpacked), bytes_of(message)) << i;
    const Bytes once = packed.packed;
    ASSERT_EQ(pack(&message).packed, once) << "what is rounded stays so; " << i;
    // All but the knots, the radius and a stamp of nothing is as it was.
    ASSERT_EQ(message.committed.start_utime, before.committed.start_utime);
    ASSERT_EQ(message.committed.piece_us, before.committed.piece_us);
    ASSERT_EQ(message.pending.seq, before.pending.seq);
    ASSERT_EQ(message.forced_seq, before.forced_seq);
    ASSERT_EQ(message.least_delay_us, before.least_delay_us);
    ASSERT_EQ(message.roster_crc, before.roster_crc);
    ASSERT_EQ(message.pending_stamp, before.pending_state == 0 ? 0 : before.pending_stamp);
    ASSERT_GE(message.radius, before.radius - 2e-6f);
    ASSERT_LT(message.radius, before.radius + 1e-3f);
    for (std::size_t k = 0; k < before.acks.size(); ++k) {
      ASSERT_EQ(message.acks[k].peer_boot, before.acks[k].peer_boot);
      ASSERT_EQ(message.acks[k].judged_seq, before.acks[k].judged_seq);
      ASSERT_EQ(message.acks[k].verdict, before.acks[k].verdict);
    }
    for (int k = 0; k <= before.committed.num_pieces; ++k) {
      for (int axis = 0; axis < 3; ++axis)
        ASSERT_NEAR(message.committed.knots[k][axis], before.committed.knots[k][axis], 6e-4);  // floats, at 10 km
    }
  }
}

TEST(PackedAnnouncement, IsSmall) {
  announcement_t message = in_flight(20);
  EXPECT_LT(pack(&message).num_bytes, 200);
  message.pending_state = announcement_t::kNone;
  EXPECT_LT(pack(&message).num_bytes, 120);
  for (auto& knot : message.committed.knots) std::fill(knot + 3, knot + 9, 0.0f), std::fill(knot, knot + 3, 1.0f);
  EXPECT_LT(pack(&message).num_bytes, 60) << "at rest";
  EXPECT_EQ(message.radius, 0.2f);
}

// The largest there is: it still fits a WiFi frame (1,472 bytes of UDP), sealed and with LCM's header.
TEST(PackedAnnouncement, FitsAFrameAtTheWorst) {
  announcement_t message = in_flight(60);
  message.header.boot = 0;
  message.header.utime = 0;
  message.forced_seq = message.committed.seq = std::numeric_limits<std::int32_t>::max();
  message.pending.seq = 1;
  message.least_delay_us = -10'000'000;
  message.radius = 10.0f;
  message.pending_stamp = message.committed.start_utime = message.pending.start_utime = to_us(kMaxUtime);
  for (trajectory_t* t : {&message.committed, &message.pending}) {
    t->piece_us = 9'999'999;
    for (int k = 0; k <= 10; ++k) {
      const float sign = k % 2 == 0 ? 1.0f : -1.0f;
      std::fill(t->knots[k], t->knots[k] + 3, sign * 1e5f);
      if (k == 10) continue;
      std::fill(t->knots[k] + 3, t->knots[k] + 6, -sign * 100.0f);
      std::fill(t->knots[k] + 6, t->knots[k] + 9, sign * 1000.0f);
    }
  }
  message.acks.assign(60, {std::numeric_limits<std::int32_t>::max(), std::numeric_limits<std::int32_t>::max(), 2});
  message.acks.front() = {std::numeric_limits<std::int32_t>::max(), 1, ack_t::kGivenUp};
  ASSERT_EQ(validate(message), Refusal::kNone);
  const packed_announcement_t packed = pack(&message);
  EXPECT_GT(packed.num_bytes, 1000);
  EXPECT_LE(packed.num_bytes, kMaxPackedBytes);
  announcement_t unpacked;
  ASSERT_EQ(unpack(packed, &unpacked), Refusal::kNone);
  EXPECT_EQ(bytes_of(unpacked), bytes_of(message));
  packed_announcement_t largest = packed;
  largest.packed.resize(kMaxPackedBytes);
  largest.num_bytes = kMaxPackedBytes;
  const int lcm_header = 8 + static_cast<int>(sizeof "ANNOUNCEMENT");
  EXPECT_LE(largest.getEncodedSize() + static_cast<int>(kSealBytes) + lcm_header, 1472);
  last_words_t words = last_words_of(&message);
  words.packed = largest.packed;
  EXPECT_LE(words.getEncodedSize() + static_cast<int>(kSealBytes) + lcm_header, 1472);
}

TEST(PackedAnnouncement, IsRepeatedAsItWas) {
  Random random(5);
  for (int i = 0; i < 60; ++i) {
    announcement_t message = i % 2 == 0 ? in_flight(i) : make<announcement_t>(random, i);
    message.header.schema_version = header_t::kSchemaVersion;
    last_words_t words = last_words_of(&message);
    words.header = make<robot_state_t>(random, 0).header;
    ASSERT_EQ(validate(words), Refusal::kNone);
    announcement_t repeated;
    ASSERT_EQ(unpack(words, &repeated), Refusal::kNone);
    EXPECT_EQ(bytes_of(repeated), bytes_of(message));
  }
}

TEST(PackedAnnouncement, RefusesWhatBreaksOffOrGoesOn) {
  Random random(2);
  announcement_t unpacked;
  for (int i = 0; i < 60; ++i) {
    auto message = i % 2 == 0 ? in_flight(i) : make<announcement_t>(random, i);
    packed_announcement_t packed = pack(&message);
    const Bytes whole = packed.packed;
    for (std::size_t size = 0; size < whole.size(); ++size) {
      packed.packed.assign(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      ASSERT_NE(unpack(packed, &unpacked), Refusal::kNone) << i << ": " << size << " of " << whole.size();
    }
    packed.packed = whole;
    packed.packed.push_back(0);
    ASSERT_EQ(unpack(packed, &unpacked), Refusal::kSize);
  }
}

// Bits that flip are refused or say something else that is valid; so is noise.
TEST(PackedAnnouncement, WhateverArrivesIsRefusedOrValid) {
  Random random(3);
  announcement_t unpacked;
  int accepted = 0;
  const auto try_bytes = [&](const packed_announcement_t& packed) {
    if (unpack(packed, &unpacked) != Refusal::kNone) return;
    ++accepted;
    ASSERT_EQ(validate(unpacked), Refusal::kNone);
    const Bytes before = bytes_of(unpacked);
    const packed_announcement_t again = pack(&unpacked);
    ASSERT_EQ(bytes_of(unpacked), before);
    ASSERT_LE(again.num_bytes, kMaxPackedBytes);
    announcement_t same;
    ASSERT_EQ(unpack(again, &same), Refusal::kNone);
    ASSERT_EQ(bytes_of(same), before);
  };
  for (int i = 0; i < 20; ++i) {
    auto message = i % 2 == 0 ? in_flight(i) : make<announcement_t>(random, i);
    packed_announcement_t packed = pack(&message);
    for (std::size_t bit = 0; bit < 8 * packed.packed.size(); ++bit) {
      packed.packed[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
      try_bytes(packed);
      packed.packed[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    }
  }
  EXPECT_GT(accepted, 100);
  for (int i = 0; i < 50'000; ++i) {
    auto noise = make<packed_announcement_t>(random, integer(random, 1, 200));
    noise.header.utime = to_us(kStart);
    try_bytes(noise);
  }
}

// The same bits on every machine: they do not depend on how it rounds.
TEST(PackedAnnouncement, IsTheSameEverywhere) {
  std::uint32_t crc = 0, state = 1;
  const auto next = [&state](int below) {
    state = state * 1664525u + 1013904223u;
    return static_cast<int>((state >> 8u) % static_cast<std::uint32_t>(below));
  };
  for (int i = 0; i < 200; ++i) {
    announcement_t message = in_flight(i % 61);
    for (trajectory_t* t : {&message.committed, &message.pending}) {
      t->num_pieces = static_cast<std::int16_t>(1 + next(10));
      t->piece_us = i % 3 == 0 ? 10'000 + next(9'000'000) : 200'000;
      const int range = i % 5 == 0 ? 100'000 : 1 + next(1000);
      for (int k = 0; k <= 10; ++k) {
        for (int axis = 0; axis < 9; ++axis) {
          const bool is_set = axis < 3 ? k <= t->num_pieces : k < t->num_pieces;
          t->knots[k][axis] =
              is_set ? static_cast<float>(next(2 * range) - range) / (axis < 3 ? 64.0f : 1024.0f) : 0.0f;
        }
      }
    }
    const packed_announcement_t packed = pack(&message);
    crc = crc32(packed.packed, crc);
    announcement_t unpacked;
    ASSERT_EQ(unpack(packed, &unpacked), Refusal::kNone) << i;
    crc = crc32(bytes_of(unpacked), crc);
  }
  EXPECT_EQ(crc, 93709289u);
}

}  // namespace
}  // namespace swarm
