#include "planner_daemon/search/local_minimum.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/print_time.h"

namespace swarm {
namespace {

const Eigen::Vector3d kGoal(5, 0, 1);
constexpr Utime kStart{100s};
constexpr double kFast_mps = 2.0;

// Every 50 ms a plan: when it begins to lead, and what the way is then.
struct Robot {
  // With the way of each moment; until it leads, or gives up after `most`.
  template <class Way>
  bool is_led_within(Duration most, bool stands, const Way& way_m) {
    for (const Utime end = now + most; now < end; now += 50ms) {
      if (local_minimum.leads(now, kGoal, way_m(to_seconds(now - kStart)), stands, kFast_mps)) return true;
    }
    return false;
  }
  LocalMinimum local_minimum;
  Utime now = kStart;
};

TEST(LocalMinimum, WhoeverStandsStuckIsLed) {
  Robot robot;
  EXPECT_TRUE(robot.is_led_within(1s, true, [](double) { return 4.0; }));
  EXPECT_EQ(robot.now, kStart + 300ms);
  EXPECT_TRUE(robot.local_minimum.leads(robot.now, kGoal, 3.1, false, kFast_mps)) << "not far enough yet";
  EXPECT_FALSE(robot.local_minimum.leads(robot.now, kGoal, 3.0, false, kFast_mps)) << "a metre on its way";
}

TEST(LocalMinimum, WhoeverComesNoNearerIsLed) {
  Robot to_and_fro, slow, on_its_way;
  EXPECT_TRUE(to_and_fro.is_led_within(4s, false, [](double t) { return 4.0 + 0.25 * std::sin(3 * t); }));
  EXPECT_GE(to_and_fro.now, kStart + 2500ms);
  EXPECT_FALSE(slow.is_led_within(20s, false, [](double t) { return 40.0 - 0.15 * t; }));
  EXPECT_FALSE(on_its_way.is_led_within(10s, false, [](double t) { return 40.0 - 2 * t; }));
}

// At a tenth of a metre a second nobody comes 0.3 m nearer in 2.5 s.
TEST(LocalMinimum, WhoeverMayOnlyFlySlowlyIsNotStuck) {
  for (const double speed_mps : {0.05, 0.1, 0.5, 2.0}) {
    LocalMinimum local_minimum;
    for (Utime now = kStart; now < kStart + 20s; now += 50ms) {
      const double way_m = 40.0 - 0.9 * speed_mps * to_seconds(now - kStart);
      ASSERT_FALSE(local_minimum.leads(now, kGoal, way_m, false, speed_mps)) << speed_mps;
    }
  }
}

// Something has closed the way: it is another one now.
TEST(LocalMinimum, ALongerWayIsAnotherWay) {
  Robot robot;
  EXPECT_FALSE(robot.is_led_within(2400ms, false, [](double) { return 4.0; }));
  EXPECT_FALSE(robot.is_led_within(2400ms, false, [](double) { return 9.0; }));
  EXPECT_TRUE(robot.is_led_within(200ms, false, [](double) { return 9.0; }));
}

TEST(LocalMinimum, IsLedTwiceAsFarWhereItComesBack) {
  Robot robot;
  for (const double far_m : {1.0, 2.0, 4.0, 8.0, 8.0}) {
    ASSERT_TRUE(robot.is_led_within(1s, true, [](double) { return 20.0; }));
    EXPECT_TRUE(robot.local_minimum.leads(robot.now, kGoal, 20.0 - far_m + 0.01, false, kFast_mps)) << far_m;
    EXPECT_FALSE(robot.local_minimum.leads(robot.now, kGoal, 20.0 - far_m, false, kFast_mps)) << far_m;
  }
  ASSERT_TRUE(robot.is_led_within(1s, true, [](double) { return 9.0; }));
  EXPECT_FALSE(robot.local_minimum.leads(robot.now, kGoal, 8.0, false, kFast_mps)) << "it had come past the other one";
}

// What it was led by did not help: now and then it is tried again.
TEST(LocalMinimum, IsLedInVainLessAndLess) {
  Robot robot;
  const auto stands = [](double) { return 4.0; };
  for (const Duration patience : {300ms, 600ms, 1200ms, 2400ms, 4800ms, 4800ms}) {
    const Utime begun = robot.now;
    ASSERT_TRUE(robot.is_led_within(10s, true, stands));
    EXPECT_EQ(robot.now - begun, patience);
    robot.now += 9950ms;
    EXPECT_TRUE(robot.local_minimum.leads(robot.now, kGoal, 4.0, true, kFast_mps));
    robot.now += 50ms;
    EXPECT_FALSE(robot.local_minimum.leads(robot.now, kGoal, 4.0, true, kFast_mps));
  }
}

TEST(LocalMinimum, AnotherGoalIsAnotherWay) {
  Robot robot;
  ASSERT_TRUE(robot.is_led_within(1s, true, [](double) { return 4.0; }));
  EXPECT_FALSE(robot.local_minimum.leads(robot.now, {0, 5, 1}, 4.0, true, kFast_mps));
  EXPECT_TRUE(robot.is_led_within(1s, true, [](double) { return 4.0; }));
  robot.local_minimum.give_up(robot.now);
  EXPECT_FALSE(robot.local_minimum.leads(robot.now + 50ms, kGoal, 4.0, true, kFast_mps)) << "tried again later";
}

}  // namespace
}  // namespace swarm
