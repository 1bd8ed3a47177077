#include "planner_daemon/give_way.h"

#include "tests/support/planner_node_fixture.h"

namespace swarm::test {
namespace {

using Fixture = PlannerNodeFixture;

// Two robots rest closer to each other than plans may pass: whoever wants to go on parts from the other first.
TEST(GiveWay, PartsFromAPeerThatRestsTooClose) {
  const Eigen::Vector3d place(0.16, -0.35, 0.81);
  for (const Eigen::Vector3d& goal : {Eigen::Vector3d(6, 0, 1), kHome}) {
    Fixture f;
    f.send_peer(7, Trajectory::hover(1, f.now - 1s, place));
    f.send_own({Trajectory::hover(1, f.now - 1s, kHome), {}});
    f.send_goal(goal);
    f.send_map();
    ASSERT_EQ(f.node.plans(), 1);
    if (goal == kHome) {  // it has arrived: who wants to go on is the other
      EXPECT_TRUE(f.out.count(channel::kCandidate) == 0 || (end_of(f.planned()) - kHome).norm() < 0.2);
      continue;
    }
    const Trajectory plan = f.planned();
    double before = (kHome - place).norm();
    for (Utime t = plan.start_utime(); t < plan.end_utime(); t += 50ms) {
      const double distance = (plan.at(t).position - place).norm();
      EXPECT_GT(distance, std::min(before - 0.01, 0.8)) << "nearer, and nearer than plans may pass";
      before = std::max(before, distance);
    }
    EXPECT_GT(before, 0.8);
  }
}

// Head on with a peer in a tube where nobody can pass; the robot is held where it is.
class TubeFixture : public Fixture {
 public:
  explicit TubeFixture(int peer_id) : Fixture(tube_config()), peer_id_(peer_id) {
    for (const double side : {-1.5, 0.5}) occupy({-1, side, -1}, {3, side + 1, 3});
  }
  void go_on(double seconds) {
    for (const Utime until = now + to_duration(seconds); now < until; run_for(0.05)) {
      send_hover();
      send_peer(peer_id_, Trajectory::hover(1, now, peer));
      send_goal(kHome + Eigen::Vector3d(5, 0, 0));
      send_map();
    }
  }
  // How far the newest plan leads along the tube.
  double planned_x() const { return out.count(channel::kCandidate) > 0 ? end_of(planned()).x() - kHome.x() : 0.0; }

  Eigen::Vector3d peer = kHome + Eigen::Vector3d(0.9, 0, 0);

 private:
  static PlannerNodeConfig tube_config() {
    PlannerNodeConfig config = make_config();
    config.planner.limits.space_min.z() = 0.8;
    config.planner.limits.space_max.z() = 1.2;
    return config;
  }
  int peer_id_;
};

TEST(GiveWay, LetsAPeerWithTheRightOfWayPassWhereOnlyOneFitsThrough) {
  TubeFixture f(kRobot - 1);
  f.go_on(1.5);
  EXPECT_LT(std::abs(f.planned_x()), 0.5) << "nothing is to be done yet";
  f.go_on(2.0);
  EXPECT_LT(f.planned_x(), -0.5);
  f.peer = kHome + Eigen::Vector3d(-3.5, 0, 0);
  f.go_on(0.5);
  EXPECT_GT(f.planned_x(), 0.5) << "it has passed";
}

TEST(GiveWay, WithTheRightOfWayItGoesBackOnlyWhenNobodyElseDoes) {
  TubeFixture f(kRobot + 1);
  f.go_on(10.0);
  EXPECT_GT(f.planned_x(), -0.5);
  f.go_on(4.0);
  EXPECT_LT(f.planned_x(), -0.5);
}

// Whoever comes along slowly is let come.
TEST(GiveWay, WaitsAsLongAsThePeerComesNearer) {
  TubeFixture f(kRobot - 1);
  f.peer = kHome + Eigen::Vector3d(1.4, 0, 0);
  f.go_on(4.0);
  ASSERT_LT(f.planned_x(), -0.5);
  for (int i = 0; i < 9; ++i) {
    f.peer.x() -= 0.1;
    f.go_on(1.0);
    EXPECT_LT(f.planned_x(), -0.5) << i;
  }
}

TEST(GiveWay, WaitsForNobodyWhoDoesNotCome) {
  TubeFixture f(kRobot - 1);
  f.go_on(4.0);
  EXPECT_LT(f.planned_x(), -0.5);
  f.go_on(5.5);
  for (int i = 0; i < 40; ++i) {
    f.go_on(0.5);
    ASSERT_GT(f.planned_x(), -0.5) << i;
  }
  f.go_on(15.0);
  EXPECT_LT(f.planned_x(), -0.5) << "tried again half a minute later";
}

TEST(GiveWay, DoesNotGoBackAmongOthers) {
  TubeFixture f(kRobot - 1);
  f.send_peer(kRobot + 1, Trajectory::hover(1, f.now, kHome + Eigen::Vector3d(-4.0, 0, 0)));
  f.go_on(4.0);
  EXPECT_GT(f.planned_x(), -0.5);
}

}  // namespace
}  // namespace swarm::test
