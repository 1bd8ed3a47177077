// Plans before the first one that counts.
#include "planner_daemon/rehearsal.h"

#include <gtest/gtest.h>

#include "tests/support/planner_node_fixture.h"
#include "tests/support/random_map.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm::test {
namespace {

using Eigen::Vector3d;

TEST(Rehearsal, LeavesNothingBehind) {
  Rng rng(6);
  PlannerConfig config;
  config.limits.space_min = {-4.9, -4.9, -0.9};
  config.limits.space_max = {4.9, 4.9, 0.9};
  Planner rehearsed(config), fresh(config);
  Rehearsal rehearsal(config.limits);
  int plans = 1;
  while (rehearsal.plan(random_map(rng, 0, {10, 10, 2}, 20, kStart, 100ms), &rehearsed)) ++plans;
  EXPECT_GT(plans, 8);
  const Vector3d home = in_box(rng, {-3, -3, -0.8}, {3, 3, 0.8});
  for (int i = 0; i < 20; ++i) {
    const Utime now = kStart + i * 50ms;
    const Sogm map = random_map(rng, 15, {10, 10, 2}, 20, now, 100ms);
    const std::vector<Peer> peers(1, {random_motion(rng, now - 500ms, 3.0), Trajectory(), 0.2});
    PlanRequest request;
    request.sogm = &map;
    request.peers = &peers;
    request.own = {Trajectory::hover(1, now - 1s, home), {}};
    request.start_utime = now + 20ms;
    request.goal = i == 0 ? Vector3d(0, 0, 0) : i < 10 ? Vector3d(4, 4, 0) : Vector3d(-4, 4, 0);
    const PlanResult &a = rehearsed.plan(request), &b = fresh.plan(request);
    ASSERT_EQ(a.expansions, b.expansions) << i;
    ASSERT_EQ(a.outcome, b.outcome) << i;
    ASSERT_EQ(a.is_unreachable, b.is_unreachable) << i;
    for (Utime t = now; t < now + 2s; t += 10ms)
      ASSERT_EQ(a.trajectory.at(t).position, b.trajectory.at(t).position) << i;
    rehearsed.prepare(request);
    fresh.prepare(request);
  }
}

// Each of the five steps of a plan takes so long.
class RehearsedNode : public PlannerNodeFixture {
 public:
  explicit RehearsedNode(Duration step = 2ms)
      : PlannerNodeFixture(make_config(), [ns = std::chrono::nanoseconds(), step]() mutable { return ns += step; }) {}
};

// By then the first map is too old.
TEST(PlannerNodeRehearsal, ComesBeforeTheFirstPlan) {
  RehearsedNode f;
  f.start({1, 0, 1});
  f.run_for(0.04);
  EXPECT_EQ(f.node.plans(), 0);
  f.send_map();
  f.run_for(0.001);
  EXPECT_EQ(f.node.plans(), 1);
}

// Nobody waits for plans as long as the first one to a goal takes.
TEST(PlannerNodeRehearsal, WaysToAnotherGoalAreWorkedOutBeforeThePlan) {
  RehearsedNode f;
  f.start({1, 0, 1});
  for (int map = 0; map < 4; ++map) {
    f.run_for(0.05);
    f.send_map();
  }
  f.run_for(0.05);
  const int before = f.node.plans();
  EXPECT_GT(before, 1);
  f.send_map();
  EXPECT_EQ(f.node.plans(), before + 1);
  f.run_for(0.05);
  f.send_goal({-2, 1, 1});
  f.send_map();
  EXPECT_EQ(f.node.plans(), before + 1);
  f.run_for(1e-6);
  EXPECT_EQ(f.node.plans(), before + 2);
  EXPECT_LT((end_of(f.planned()) - Vector3d(-2, 1, 1)).norm(), 0.05);
}

// A plan that took longer than it was given is announced too late, and never heard of again.
TEST(PlannerNodeRehearsal, PlansAreGivenTheTimeThatEarlierOnesTook) {
  RehearsedNode f(20ms);
  f.start({1, 0, 1});
  const auto lead_s = [&f] {
    f.run_for(0.4);
    f.send_hover();
    f.send_map();
    f.run_for(0.001);
    return to_seconds(f.planned().start_utime() - f.now);
  };
  f.run_for(0.001);
  EXPECT_LT(lead_s(), 0.04);
  EXPECT_GT(lead_s(), 0.1) << "five steps of 20 ms";
}

}  // namespace
}  // namespace swarm::test
