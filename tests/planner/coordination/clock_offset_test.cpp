// How far a peer's clock is from ours: what delays both ways tell of it.
#include "planner_daemon/coordination/clock_offset.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/start_time.h"

namespace swarm {
namespace {

// Two ends of a link, which tell each other what they see.
struct Link {
  ClockOffset here, there;
  Utime now = kStart;
  Duration offset{};  // our clock is ahead by this
  std::mt19937_64 random{1};

  // Messages both ways every 50 ms, a delay drawn for each.
  void run(int messages, Duration mean, Duration jitter) {
    std::uniform_real_distribution<double> delay_s(to_seconds(mean - jitter), to_seconds(mean + jitter));
    for (int i = 0; i < messages; ++i, now += 50ms) {
      here.heard(now + offset, now - to_duration(delay_s(random)));
      there.heard(now, now + offset - to_duration(delay_s(random)));
      if (const auto told = there.least_delay()) here.told(*told);
      if (const auto told = here.least_delay()) there.told(*told);
    }
  }
};

TEST(ClockOffset, IsHalfTheDifferenceOfTheDelays) {
  for (const Duration offset : {0ms, 7ms, -60ms}) {
    Link link;
    link.offset = offset;
    link.run(ClockOffset::kEnough - 1, 3ms, 0ms);
    EXPECT_FALSE(link.here.offset());
    EXPECT_FALSE(link.here.beyond(1ms));
    link.run(1, 3ms, 0ms);
    EXPECT_EQ(link.here.offset(), offset);
    EXPECT_EQ(link.there.offset(), -offset);
    EXPECT_EQ(link.here.least_delay(), 3ms + offset);
  }
}

TEST(ClockOffset, BeyondTheLimitIsSeenFromBothEnds) {
  for (const Duration offset : {9ms, 11ms, -9ms, -11ms}) {
    Link link;
    link.offset = offset;
    link.run(60, 2ms, 0ms);
    EXPECT_EQ(link.here.beyond(10ms), std::chrono::abs(offset) > 10ms);
    EXPECT_EQ(link.there.beyond(10ms), std::chrono::abs(offset) > 10ms);
  }
}

// A jittery radio alone is no wrong clock, from the first answer on.
TEST(ClockOffset, JitterIsNoOffset) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    Link link;
    link.random.seed(seed);
    for (int i = 0; i < 400; ++i) {
      link.run(1, 300ms, 150ms);
      ASSERT_FALSE(link.here.beyond(10ms)) << "seed " << seed << ", message " << i;
    }
    ASSERT_LE(std::chrono::abs(link.here.offset().value()), 15ms);
  }
}

TEST(ClockOffset, ForgetsAClockThatWasSet) {
  Link link;
  link.run(200, 2ms, 0ms);
  link.offset = 50ms;
  link.run(static_cast<int>(2 * ClockOffset::kWindow / 50ms), 2ms, 0ms);
  EXPECT_EQ(link.here.offset(), 50ms);
  link.now += 60s;  // silence
  link.run(1, 2ms, 0ms);
  EXPECT_FALSE(link.here.least_delay());
}

}  // namespace
}  // namespace swarm
