// What the planner daemon makes of how far its robot errs: a margin beyond the clearance.
#include "planner_daemon/planner_node.h"
#include "tests/support/planner_node_fixture.h"

namespace swarm::test {
namespace {

// It flies past a column at a distance that grows with what its broadcaster announces beyond its own radius.
TEST(PlannerNode, KeepsOffByWhatTheRobotErrs) {
  const auto distance_m = [](float radius) {
    PlannerNodeFixture f;
    f.occupy({1.5, -0.1, 0}, {1.7, 0.1, 3});
    auto own = f.announcement(kRobot, Trajectory::hover(1, f.now, kHome), {}, announcement_t::kNone);
    own.radius = radius;
    f.send(channel::kOwnTrajectory, own);
    f.send_goal({3, 0, 1});
    f.send_map();
    EXPECT_NEAR(f.status().margin, radius - 0.2f, 1e-6);
    const Trajectory planned = f.planned();
    double nearest_m = 10.0;
    for (Utime t = planned.start_utime(); t < planned.end_utime(); t += 10ms)
      nearest_m = std::min(nearest_m, (planned.at(t).position - Eigen::Vector3d(1.6, 0, 1)).head<2>().norm());
    return nearest_m;
  };
  EXPECT_LT(distance_m(0.2f), 0.55);
  EXPECT_GT(distance_m(0.5f), 0.6);
}

// A margin that has grown over the place where it is makes the robot leave, not flee.
TEST(PlannerNode, AMarginOverItsOwnPlaceIsNoEmergency) {
  PlannerNodeFixture f;
  f.occupy({-0.6, -1, 0}, {-0.4, 1, 3});
  auto own = f.announcement(kRobot, Trajectory::hover(1, f.now, kHome), {}, announcement_t::kNone);
  own.radius = 0.5f;
  f.send(channel::kOwnTrajectory, own);
  f.send_goal({3, 0, 1});
  f.send_map();
  EXPECT_EQ(f.status().outcome, planner_status_t::kSmooth);
}

}  // namespace
}  // namespace swarm::test
