// How far a peer's clock is from ours: what delays both ways tell of it.
#include "planner_daemon/coordination/clock_offset.h"

#include <gtest/gtest.h>

#include <random>

namespace swarm {
namespace {

constexpr std::int64_t kStart_us = 1'700'000'000'000'000;

// Two ends of a link, which tell each other what they see.
struct Link {
  ClockOffset here, there;
  std::int64_t now_us = kStart_us, offset_us = 0;  // our clock is ahead by this
  std::mt19937_64 random{1};

  // Messages both ways every 50 ms, `delay` drawn for each [us].
  void run(int messages, double mean_us, double jitter_us) {
    std::uniform_real_distribution<double> delay(mean_us - jitter_us, mean_us + jitter_us);
    for (int i = 0; i < messages; ++i, now_us += 50'000) {
      here.heard(now_us + offset_us, now_us - std::llround(delay(random)));
      there.heard(now_us, now_us + offset_us - std::llround(delay(random)));
      if (const auto told = there.least_delay_us()) here.told(*told);
      if (const auto told = here.least_delay_us()) there.told(*told);
    }
  }
};

TEST(ClockOffset, IsHalfTheDifferenceOfTheDelays) {
  for (const std::int64_t offset_us : {0, 7'000, -60'000}) {
    Link link;
    link.offset_us = offset_us;
    link.run(ClockOffset::kEnough - 1, 3000, 0);
    EXPECT_FALSE(link.here.offset_us());
    EXPECT_FALSE(link.here.beyond(1'000));
    link.run(1, 3000, 0);
    EXPECT_EQ(link.here.offset_us(), offset_us);
    EXPECT_EQ(link.there.offset_us(), -offset_us);
    EXPECT_EQ(link.here.least_delay_us(), 3'000 + offset_us);
  }
}

TEST(ClockOffset, BeyondTheLimitIsSeenFromBothEnds) {
  for (const std::int64_t offset_us : {9'000, 11'000, -9'000, -11'000}) {
    Link link;
    link.offset_us = offset_us;
    link.run(60, 2000, 0);
    EXPECT_EQ(link.here.beyond(10'000), std::abs(offset_us) > 10'000);
    EXPECT_EQ(link.there.beyond(10'000), std::abs(offset_us) > 10'000);
  }
}

// A jittery radio alone is no wrong clock, from the first answer on.
TEST(ClockOffset, JitterIsNoOffset) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    Link link;
    link.random.seed(seed);
    for (int i = 0; i < 400; ++i) {
      link.run(1, 300'000, 150'000);
      ASSERT_FALSE(link.here.beyond(10'000)) << "seed " << seed << ", message " << i;
    }
    ASSERT_NEAR(static_cast<double>(link.here.offset_us().value()), 0.0, 15'000.0);
  }
}

TEST(ClockOffset, ForgetsAClockThatWasSet) {
  Link link;
  link.run(200, 2000, 0);
  link.offset_us = 50'000;
  link.run(2 * ClockOffset::kWindow_us / 50'000, 2000, 0);
  EXPECT_EQ(link.here.offset_us(), 50'000);
  link.now_us += 60'000'000;  // silence
  link.run(1, 2000, 0);
  EXPECT_FALSE(link.here.least_delay_us());
}

}  // namespace
}  // namespace swarm
