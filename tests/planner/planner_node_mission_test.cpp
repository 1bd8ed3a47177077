// How the planner daemon's node flies missions.
#include "planner_daemon/planner_node.h"
#include "tests/support/planner_node_fixture.h"

namespace swarm::test {
namespace {

using Fixture = PlannerNodeFixture;

// A mission of two: past the first without a stop, to the second more slowly; then the first one's repetition, and an
// order to go to the second at another speed.
TEST(PlannerNodeMission, FliesMissions) {
  Fixture f;
  goal_t goal = to_goal({{{1, 0, 1}, 0.3}, {{3, 0, 1}, 0.1, 0.5}});
  const auto send = [&](int seq) {
    goal.header = make_header(kRobot, 1, seq, f.now);
    f.send(channel::kGoal, goal);
  };
  const auto plan = [&](double x) {
    f.send_own({Trajectory::hover(1, f.now, {x, 0, 1}), {}});
    f.send_map();
    double speed_mps = 0.0;
    for (Utime t = f.planned().start_utime(); t < f.planned().end_utime(); t += 10ms)
      speed_mps = std::max(speed_mps, f.planned().at(t).velocity.norm());
    f.run_for(0.1);
    return speed_mps;
  };
  send(1);
  plan(0.0);
  EXPECT_LT((end_of(f.planned()) - Eigen::Vector3d(1, 0, 1)).norm(), 0.05);
  EXPECT_EQ(f.status().waypoint, 0);
  const double slow_mps = plan(0.75);
  EXPECT_GT(end_of(f.planned()).x(), 1.3);
  EXPECT_LT(slow_mps, 0.505);
  EXPECT_GT(slow_mps, 0.45);
  EXPECT_EQ(f.status().waypoint, 1);
  send(2);
  EXPECT_LT(plan(0.75), 0.505);
  EXPECT_EQ(f.status().waypoint, 1) << "the same mission again";
  goal = to_goal({{{3, 0, 1}}});
  send(3);
  EXPECT_GT(plan(0.75), 1.0) << "what was looked ahead for 0.5 m/s does not serve any more";
  EXPECT_EQ(f.status().waypoint, 0);
}

// Faster than it may be from now on: it brakes, and its plans are no emergencies.
TEST(PlannerNodeMission, BrakesToALowerSpeed) {
  Fixture f;
  MotionState from, to;
  from.position = {-1, 0, 1}, from.velocity = {1.9, 0, 0};
  to.position = {2, 0, 1};
  Trajectory fast(1, f.now, 3s, 1);
  fast.set_knot(0, from);
  fast.set_knot(1, to);
  goal_t goal = to_goal({{{4, 0, 1}, 0.1, 0.5}});
  goal.header = make_header(kRobot, 1, 1, f.now);
  f.send(channel::kGoal, goal);
  f.send_own({fast, {}});
  f.send_map();
  const Trajectory plan = f.planned();
  EXPECT_NE(f.status().outcome, planner_status_t::kUnsafe);
  EXPECT_GT(plan.at(plan.start_utime()).velocity.x(), 1.5);
  for (Utime t = plan.start_utime() + 900ms; t < plan.end_utime(); t += 10ms)
    EXPECT_LT(plan.at(t).velocity.x(), 0.51) << to_seconds(t - plan.start_utime());
  EXPECT_GT(plan.at(plan.start_utime() + 1s).velocity.x(), 0.2);
}

// Who leads it: nobody on the ground and straight up and down; to the place of its flight's state; to its goal.
TEST(PlannerNodeMission, FollowsTheFlightsState) {
  using sogm_swarm::flight_status_t;
  Fixture f;
  std::int64_t seq = 0;
  const auto say = [&](std::int16_t state, std::int16_t led_to, const Eigen::Vector3d& destination) {
    flight_status_t status{};
    status.header = make_header(kRobot, 1, seq++, f.now);
    status.state = state;
    status.led_to = led_to;
    status.order_boot = -1;
    Eigen::Map<Eigen::Vector3d>(status.destination) = destination;
    f.send(channel::kFlightStatus, status);
  };
  const auto plan = [&] {
    const int before = f.node.plans();
    f.send_hover();
    f.send_map();
    f.run_for(0.1);
    return f.node.plans() > before;
  };
  f.send_goal({1, 0, 1});
  say(flight_status_t::kTakeOff, flight_status_t::kNowhere, {0, 0, 0});
  for (int i = 0; i < 11; ++i) EXPECT_FALSE(plan());
  EXPECT_EQ(f.status().state, planner_status_t::kNotLed);
  EXPECT_EQ(f.node.missed(), 0) << "nobody is to plan with them";
  say(flight_status_t::kHome, flight_status_t::kDestination, {0, -1, 1});
  EXPECT_TRUE(plan());
  EXPECT_LT((end_of(f.planned()) - Eigen::Vector3d(0, -1, 1)).norm(), 0.05);
  say(flight_status_t::kFlying, flight_status_t::kGoal, {0, 0, 0});
  EXPECT_TRUE(plan());
  EXPECT_LT((end_of(f.planned()) - Eigen::Vector3d(1, 0, 1)).norm(), 0.05);
  // It has landed: its goal is forgotten.
  say(flight_status_t::kOnGround, flight_status_t::kNowhere, {0, 0, 0});
  EXPECT_FALSE(plan());
  say(flight_status_t::kFlying, flight_status_t::kGoal, {0, 0, 0});
  EXPECT_TRUE(plan());
  EXPECT_EQ(f.node.newest_request().goal, kHome);
}

}  // namespace
}  // namespace swarm::test
