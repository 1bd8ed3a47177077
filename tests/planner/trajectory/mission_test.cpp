#include "planner_daemon/trajectory/mission.h"

#include <gtest/gtest.h>

#include "lcmtypes/bus/codec.h"
#include "tests/support/print_time.h"
#include "tests/support/random_messages.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

MotionState at(double x, double speed_mps = 0.0) {
  MotionState state;
  state.position = {x, 0, 1};
  state.velocity.y() = speed_mps;
  return state;
}

Waypoint waypoint(double x) {
  Waypoint place;
  place.position = {x, 0, 1};
  return place;
}

TEST(Mission, IsTheSameOnTheWire) {
  random_messages::Random random(1);
  for (const int waypoints : {1, 2, 7, kMaxWaypoints}) {
    const auto sent = random_messages::make<sogm_swarm::goal_t>(random, waypoints);
    const Mission mission = mission_of(sent);
    ASSERT_EQ(std::ssize(mission), waypoints);
    EXPECT_EQ(mission.back().position, Eigen::Vector3d(sent.waypoints.back().position));
    sogm_swarm::goal_t again = to_goal(mission);
    again.header = sent.header;
    EXPECT_EQ(mission_of(again), mission);
    std::vector<std::uint8_t> bytes;
    encode(again, &bytes);
    EXPECT_EQ(decode(bytes, &again), Refusal::kNone);
  }
  sogm_swarm::goal_t usual{};
  usual.waypoints.resize(1);
  EXPECT_EQ(mission_of(usual), Mission{Waypoint()});
  EXPECT_EQ(mission_of(usual).front().tolerance_m, 0.1);
}

TEST(MissionProgress, GoesFromWaypointToWaypointAndStaysAtTheLast) {
  MissionProgress progress;
  EXPECT_TRUE(progress.empty());
  progress.pass(kStart, at(0));
  progress.fly({waypoint(1), waypoint(2), waypoint(1)});
  progress.pass(kStart, at(2));
  EXPECT_EQ(progress.index(), 0) << "not in their order";
  progress.pass(kStart, at(1.09));
  EXPECT_EQ(progress.index(), 1);
  progress.pass(kStart, at(1.89));
  EXPECT_EQ(progress.index(), 1);
  progress.pass(kStart, at(1.91));
  EXPECT_EQ(progress.index(), 2);
  for (int i = 0; i < 3; ++i) progress.pass(kStart + i * 1s, at(1));
  EXPECT_EQ(progress.index(), 2);
  EXPECT_EQ(progress.waypoint(), waypoint(1));
}

TEST(MissionProgress, TheSameMissionGoesOnAnotherBegins) {
  MissionProgress progress;
  progress.fly({waypoint(1), waypoint(2)});
  progress.pass(kStart, at(1));
  progress.fly({waypoint(1), waypoint(2)});
  EXPECT_EQ(progress.index(), 1);
  progress.fly({waypoint(1), waypoint(3)});
  EXPECT_EQ(progress.index(), 0);
}

TEST(MissionProgress, WaitsAsLongAsItIsNear) {
  MissionProgress progress;
  Waypoint first = waypoint(1);
  first.wait = 2s;
  first.tolerance_m = 0.5;
  progress.fly({first, waypoint(2)});
  progress.pass(kStart, at(0.6));
  progress.pass(kStart + 1900ms, at(1.4));
  progress.pass(kStart + 2s, at(1.6));  // pushed away
  progress.pass(kStart + 3s, at(1.4));
  progress.pass(kStart + 4900ms, at(1.0));
  EXPECT_EQ(progress.index(), 0);
  progress.shift(10s);  // the clock was set
  progress.pass(kStart + 14900ms, at(1.0));
  EXPECT_EQ(progress.index(), 0);
  progress.pass(kStart + 15s, at(1.0));
  EXPECT_EQ(progress.index(), 1);
  progress.fly({first, waypoint(2), waypoint(3)});
  progress.pass(kStart + 20s, at(1.0));
  progress.pass(kStart + 1s, at(1.0));  // the clock was set back, and nobody said so
  progress.pass(kStart + 2900ms, at(1.0));
  EXPECT_EQ(progress.index(), 0);
  progress.pass(kStart + 3s, at(1.0));
  EXPECT_EQ(progress.index(), 1);
}

TEST(MissionProgress, GoesOnNoFasterThanItMayFromThereOn) {
  MissionProgress progress;
  Waypoint slow = waypoint(2);
  slow.speed_mps = 0.5;
  progress.fly({waypoint(1), slow});
  progress.pass(kStart, at(1, -0.6));
  EXPECT_EQ(progress.index(), 0);
  progress.pass(kStart, at(1, -0.5));
  EXPECT_EQ(progress.index(), 1);
}

}  // namespace
}  // namespace swarm
