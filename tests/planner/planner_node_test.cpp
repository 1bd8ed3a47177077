// The planner daemon's node: when it plans, from what and towards what, and what it makes of bad input.
// Long because every message and every limit of its configuration is refused once.
#include "planner_daemon/planner_node.h"

#include <random>

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/coordination/deconfliction.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::announcement_t;
using sogm_swarm::candidate_t;
using sogm_swarm::corridors_t;
using sogm_swarm::goal_t;
using sogm_swarm::planner_status_t;
using sogm_swarm::sogm_t;

constexpr int kRobot = 3;
const Eigen::Vector3d kHome(0, 0, 1);

// Robot 3 at rest at kHome, in a window of 10 x 10 x 4 m around it.
class Fixture : public Bench<PlannerNode> {
 public:
  explicit Fixture(const PlannerNodeConfig& config = make_config(), Planner::Stopwatch stopwatch = nullptr,
                   bool publish_durations = true)
      : Bench(config, 5, std::move(stopwatch), publish_durations) {
    map.reset({.resolution_m = 0.1, .origin = {-50, -50, -10}, .size = {100, 100, 40}}, 20, 0, 100'000);
  }
  static PlannerNodeConfig make_config() {
    PlannerNodeConfig config;
    config.robot_id = kRobot;
    config.planner.limits.space_min = {-8, -8, 0.2};
    config.planner.limits.space_max = {8, 8, 3.8};
    return config;
  }

  // `map` as the map daemon sends it, built `age_s` ago.
  std::vector<sogm_t> map_parts(double age_s = 0.0) {
    map.start_utime = now_us - std::llround(age_s * 1e6);
    const auto parts = encoder_.encode(map, make_header(kRobot, 1, map_seq_++, map.start_utime));
    return {parts.begin(), parts.end()};
  }
  void send_map(double age_s = 0.0) {
    for (const sogm_t& part : map_parts(age_s)) send(channel::kSogm, part);
  }
  void send_own(const Motion& motion) {
    send(channel::kOwnTrajectory, announcement(kRobot, motion.committed, motion.next, announcement_t::kCommitted));
  }
  void send_hover() { send_own({Trajectory::hover(1, now_us, kHome), {}}); }
  void send_peer(int id, const Trajectory& committed, const Trajectory& pending = {},
                 std::int8_t state = announcement_t::kCommitted) {
    send(channel::kPeerTrajectory, announcement(id, committed, pending, state));
  }
  void send_goal(const Eigen::Vector3d& position) {
    goal_t goal{};
    goal.header = make_header(kRobot, 1, goal_seq_++, now_us);
    Eigen::Map<Eigen::Vector3d>(goal.position) = position;
    send(channel::kGoal, goal);
  }
  announcement_t announcement(int id, const Trajectory& committed, const Trajectory& pending, std::int8_t state,
                              std::int64_t stamp = 0) {
    announcement_t message{};
    message.header = make_header(id, 1, announcement_seq_++, now_us);
    message.radius = 0.2f;
    message.committed = committed.to_wire();
    message.pending = pending.to_wire();
    message.pending_state = pending.empty() ? announcement_t::kNone : state;
    message.pending_stamp = stamp;
    return message;
  }
  void start(const Eigen::Vector3d& goal) {
    send_hover();
    send_goal(goal);
    send_map();
  }
  void occupy(const Eigen::Vector3d& low, const Eigen::Vector3d& high, int first_frame = 0) {
    for (int frame = first_frame; frame < map.num_frames; ++frame) {
      for (double x = low.x() + 0.05; x < high.x(); x += 0.1) {
        for (double y = low.y() + 0.05; y < high.y(); y += 0.1) {
          for (double z = low.z() + 0.05; z < high.z(); z += 0.1) {
            const Eigen::Vector3i voxel = map.geometry.voxel_of({x, y, z});
            if (map.geometry.contains(voxel)) {
              map.column(frame, voxel.x(), voxel.y())[voxel.z() / 64] |= std::uint64_t{1} << voxel.z() % 64;
            }
          }
        }
      }
    }
  }
  Trajectory planned() const { return Trajectory::from_wire(out.newest<candidate_t>(channel::kCandidate).trajectory); }
  planner_status_t status() const { return out.newest<planner_status_t>(channel::kPlannerStatus); }

  Sogm map;

 private:
  SogmEncoder encoder_;
  std::int64_t map_seq_ = 0, announcement_seq_ = 0, goal_seq_ = 0;
};

Eigen::Vector3d end_of(const Trajectory& trajectory) {
  return trajectory.at(trajectory.end_utime()).position;
}

TEST(PlannerNode, StatusNamesWhatIsMissing) {
  Fixture f;
  EXPECT_EQ(f.status().state, planner_status_t::kNoMap);
  const auto state_after_a_second = [&f] {
    f.run_for(0.9);
    f.send_map();
    f.run_for(0.1);
    return f.status().state;
  };
  EXPECT_EQ(state_after_a_second(), planner_status_t::kNoCommitted);
  EXPECT_EQ(f.node.plans(), 0);
  f.send_hover();
  EXPECT_EQ(state_after_a_second(), planner_status_t::kPlanning);  // of the plan itself, made without a goal
  EXPECT_EQ(f.node.plans(), 2);
  f.run_for(0.15);
  EXPECT_EQ(state_after_a_second(), planner_status_t::kPlanning);
  f.run_for(1.0);
  EXPECT_EQ(f.status().state, planner_status_t::kStaleMap);
  EXPECT_EQ(f.status().plans, f.node.plans());
}

TEST(PlannerNode, StatusNamesAMissingGoal) {
  PlannerNodeConfig config = Fixture::make_config();
  config.stale_map_s = 10.0;
  Fixture f(config);
  f.send_hover();
  f.send_map();
  f.run_for(1.5);
  EXPECT_EQ(f.status().state, planner_status_t::kNoGoal);
  f.send_goal({1, 0, 1});
  f.run_for(1.0);
  EXPECT_EQ(f.status().state, planner_status_t::kPlanning);
}

// What becomes of a plan: announced, then committed after `answer_s`, or withdrawn when it should begin.
void carry_out(Fixture& f, double answer_s, bool commits) {
  static std::int32_t seq = 100;
  Trajectory plan = f.planned();
  plan.set_seq(++seq);
  const Trajectory hover = Trajectory::hover(1, f.now_us, kHome);
  const std::int64_t stamp = f.now_us;
  f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kAnnounced, stamp));
  f.run_for(answer_s);
  if (commits) {
    f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kCommitted, stamp));
  } else {
    f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, {}, announcement_t::kNone));
  }
}

double lead_s(Fixture& f) {
  f.run_for(2.0);  // whatever was committed has begun
  f.send_hover();
  f.send_map();
  return 1e-6 * static_cast<double>(f.planned().start_utime() - f.now_us);
}

TEST(PlannerNode, WaitsForAnAnnouncedPlan) {
  PlannerNodeConfig config = Fixture::make_config();
  config.lead_s = 0.3;
  Fixture f(config);
  f.start({2, 0, 1});
  ASSERT_EQ(f.node.plans(), 1);
  Trajectory plan = f.planned();
  plan.set_seq(7);
  const Trajectory hover = Trajectory::hover(1, f.now_us, kHome);
  f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kAnnounced));
  f.run_for(0.1);
  f.send_map();
  EXPECT_EQ(f.node.plans(), 1);
  f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, {}, announcement_t::kNone));  // refused by a peer
  f.run_for(0.01);
  EXPECT_EQ(f.node.plans(), 2);

  plan = f.planned();
  plan.set_seq(8);
  f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kAnnounced));
  f.run_for(0.1);
  f.send_map();
  EXPECT_EQ(f.node.plans(), 2);
  f.run_for(0.22);  // nothing more is heard: its time has passed
  EXPECT_EQ(f.node.plans(), 3);
}

// Where the robot hovers, something will be `s` seconds from now on.
void send_threat(Fixture& f, double s) {
  f.map.reset(f.map.geometry, f.map.num_frames, 0, f.map.frame_duration_us);
  f.occupy(kHome - Eigen::Vector3d(0.3, 0.3, 1), kHome + Eigen::Vector3d(0.3, 0.3, 1), static_cast<int>(s * 10));
  f.send_map();
}

TEST(PlannerNode, PlansAreUrgentWhereTheRobotWouldBeHitSoon) {
  for (const double s : {0.9, 1.4}) {
    Fixture f;
    f.send_hover();
    f.send_goal(kHome);
    send_threat(f, s);
    ASSERT_EQ(f.node.plans(), 1);
    EXPECT_EQ(f.out.newest<candidate_t>(channel::kCandidate).urgent, s < 1.0 ? 1 : 0);
    EXPECT_GT((end_of(f.planned()) - kHome).norm(), 0.4);  // out of the way in any case
  }
}

// Peers are silent, so plans begin late; what is urgent begins as early as ever.
TEST(PlannerNode, WhatIsUrgentWaitsForNoAnswers) {
  Fixture f;
  f.start({2, 0, 1});
  for (int i = 0; i < 40; ++i) {
    carry_out(f, CommitDelay::kLongest_s, false);
    (void)lead_s(f);
  }
  ASSERT_NEAR(lead_s(f), Fixture::make_config().lead_s + CommitDelay::kLongest_s, 1e-6);
  Trajectory plan = f.planned();
  plan.set_seq(7);
  const Trajectory hover = Trajectory::hover(1, f.now_us, kHome);
  f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kAnnounced, f.now_us));
  const int plans = f.node.plans();
  f.run_for(0.1);
  f.send_map();
  EXPECT_EQ(f.node.plans(), plans);  // it waits for the plan that was announced
  f.run_for(0.1);
  send_threat(f, 1.9);
  EXPECT_EQ(f.node.plans(), plans + 1);
  EXPECT_EQ(f.out.newest<candidate_t>(channel::kCandidate).urgent, 1);
  EXPECT_LT(f.planned().start_utime(), f.now_us + 950'000);  // a second before it comes
  f.run_for(0.03);
  send_threat(f, 1.8);
  EXPECT_EQ(f.node.plans(), plans + 1);  // not before the period is over
  f.run_for(0.02);
  EXPECT_EQ(f.node.plans(), plans + 2);  // it was not announced
  plan = f.planned();
  plan.set_seq(8);
  f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kAnnounced, f.now_us));
  f.run_until(plan.start_utime() - 5'000);
  send_threat(f, 1.0);
  EXPECT_EQ(f.node.plans(), plans + 2);  // an urgent plan is waited for
}

// The more time there is until then, the more there is for answers.
TEST(PlannerNode, UrgentPlansBeginInTime) {
  for (const double s : {0.3, 0.9, 1.3, 1.9}) {
    SCOPED_TRACE(s);
    Fixture f;
    f.start(kHome);
    for (int i = 0; i < 10; ++i) {  // answers take 0.4 s
      carry_out(f, 0.4, true);
      (void)lead_s(f);
    }
    for (int i = 0; i < 5; ++i) {  // and then none come
      carry_out(f, CommitDelay::kLongest_s, false);
      (void)lead_s(f);
    }
    f.run_for(0.1);
    send_threat(f, s);
    const double begins_s = 1e-6 * static_cast<double>(f.planned().start_utime() - f.now_us);
    ASSERT_EQ(f.out.newest<candidate_t>(channel::kCandidate).urgent, 1);
    const double plan_s = Fixture::make_config().lead_s;
    if (s < 0.6) {
      EXPECT_NEAR(begins_s, plan_s + 0.02, 1e-6);
    } else {
      EXPECT_NEAR(begins_s, s - (s < 1.0 ? 0.6 : 1.0), s < 1.5 && s > 1.0 ? 0.3 : 0.021);
    }
  }
}

// Who is not heard may have stepped aside: the way past it leads farther off.
TEST(PlannerNode, KeepsFarFromSilentPeers) {
  double nearest[2] = {INFINITY, INFINITY};
  for (const bool silent : {false, true}) {
    Fixture f;
    const Eigen::Vector3d place(2.5, 0.3, 1);
    f.send_peer(7, Trajectory::hover(1, f.now_us, place));
    if (silent) f.run_for(0.6);
    f.start({5, 0, 1});
    const Trajectory plan = f.planned();
    for (std::int64_t t = plan.start_utime(); t < plan.end_utime(); t += 10'000)
      nearest[silent] = std::min(nearest[silent], (plan.at(t).position - place).norm());
  }
  EXPECT_LT(nearest[0], 0.9);
  EXPECT_GT(nearest[1], nearest[0] + 0.3);
}

// Two robots rest closer to each other than plans may pass: whoever wants to go on parts from the other first.
TEST(PlannerNode, PartsFromAPeerThatRestsTooClose) {
  const Eigen::Vector3d place(0.16, -0.35, 0.81);
  for (const Eigen::Vector3d& goal : {Eigen::Vector3d(6, 0, 1), kHome}) {
    Fixture f;
    f.send_peer(7, Trajectory::hover(1, f.now_us - 1'000'000, place));
    f.send_own({Trajectory::hover(1, f.now_us - 1'000'000, kHome), {}});
    f.send_goal(goal);
    f.send_map();
    ASSERT_EQ(f.node.plans(), 1);
    if (goal == kHome) {  // it has arrived: who wants to go on is the other
      EXPECT_TRUE(f.out.count(channel::kCandidate) == 0 || (end_of(f.planned()) - kHome).norm() < 0.2);
      continue;
    }
    const Trajectory plan = f.planned();
    double before = (kHome - place).norm();
    for (std::int64_t t = plan.start_utime(); t < plan.end_utime(); t += 50'000) {
      const double distance = (plan.at(t).position - place).norm();
      EXPECT_GT(distance, before - 0.01);
      before = std::max(before, distance);
    }
    EXPECT_GT(before, 0.8);
  }
}

// A plan that was forced was not answered: the next one that is urgent only steps aside.
TEST(PlannerNode, WithoutAnswersItOnlyStepsAside) {
  for (const bool answered : {true, false}) {
    Fixture f;
    f.start({3, 0, 1});
    Trajectory plan = f.planned();
    plan.set_seq(7);
    announcement_t message =
        f.announcement(kRobot, Trajectory::hover(1, f.now_us, kHome), plan, announcement_t::kCommitted, f.now_us);
    message.forced_seq = answered ? 0 : 7;
    f.send(channel::kOwnTrajectory, message);
    f.run_until(plan.start_utime() + 20'000);
    f.send_hover();
    send_threat(f, 0.9);
    ASSERT_EQ(f.node.plans(), 2);
    EXPECT_EQ(f.out.newest<candidate_t>(channel::kCandidate).urgent, 1);
    EXPECT_EQ((end_of(f.planned()) - kHome).x() > 1.2, answered) << end_of(f.planned()).transpose();
  }
}

TEST(PlannerNode, PlansFartherAheadWherePeersAnswerLate) {
  const double plan_s = Fixture::make_config().lead_s, usual_s = plan_s + 0.005 + 0.01;
  Fixture f;
  f.start({2, 0, 1});
  for (int i = 0; i < 10; ++i) {
    carry_out(f, 0.005, true);
    ASSERT_NEAR(lead_s(f), usual_s, 1e-6);
  }
  double lead = usual_s;
  for (int i = 0; i < 12; ++i) {  // too late, until the plans begin late enough
    const bool in_time = lead > 0.2;
    carry_out(f, in_time ? 0.2 : lead + 0.01, in_time);
    const double next = lead_s(f);
    if (!in_time) {
      EXPECT_NEAR(next, plan_s + 1.25 * lead, 1e-3);
    }
    lead = next;
  }
  EXPECT_GT(lead, 0.2);
  EXPECT_LT(lead, 0.6);
  for (int i = 0; i < 40; ++i) {
    carry_out(f, 0.005, true);
    lead = lead_s(f);
  }
  EXPECT_NEAR(lead, usual_s, 0.01);
  for (int i = 0; i < 40; ++i) {
    carry_out(f, lead + 0.01, false);
    lead = lead_s(f);
  }
  EXPECT_NEAR(lead, plan_s + CommitDelay::kLongest_s, 1e-6);
}

TEST(PlannerNode, PlansOncePerNewMap) {
  Fixture f;
  f.send_hover();
  f.send_goal({1, 0, 1});
  f.run_for(0.5);
  EXPECT_EQ(f.node.plans(), 0);
  for (int i = 1; i <= 5; ++i) {
    f.send_map();
    EXPECT_EQ(f.node.plans(), i);
    f.run_for(0.1);
    f.send_goal({1, 0, 1});
    f.send_hover();
    f.run_for(0.1);
    EXPECT_EQ(f.node.plans(), i);
    EXPECT_EQ(f.out.count(channel::kCandidate), i);
  }
  EXPECT_EQ(f.node.missed(), 0);
  EXPECT_EQ(f.status().rate_hz, 5.0f);
}

TEST(PlannerNode, KeepsThePeriodAndCountsMapsThatItMissed) {
  PlannerNodeConfig config = Fixture::make_config();
  config.period_s = 0.1;
  Fixture f(config);
  f.start({1, 0, 1});
  const std::int64_t first_us = f.now_us;
  for (int i = 0; i < 3; ++i) {
    f.run_for(0.02);
    f.send_map();
  }
  EXPECT_EQ(f.node.plans(), 1);
  EXPECT_EQ(f.node.missed(), 2);
  EXPECT_EQ(f.wake_us, first_us + 100'000);
  f.run_until(first_us + 99'999);
  EXPECT_EQ(f.node.plans(), 1);
  f.run_until(first_us + 100'000);
  EXPECT_EQ(f.node.plans(), 2);
  EXPECT_EQ(f.status().missed, 2);
}

TEST(PlannerNode, DoesNotPlanWithStaleMaps) {
  Fixture f;
  f.send_hover();
  f.send_map(0.36);
  EXPECT_EQ(f.node.plans(), 0);
  f.run_for(1.0);
  EXPECT_EQ(f.node.plans(), 0);
  EXPECT_EQ(f.status().state, planner_status_t::kStaleMap);
  f.send_map(0.35);
  EXPECT_EQ(f.node.plans(), 1);
}

TEST(PlannerNode, LeavesTheCommittedMotionAfterTheLead) {
  Fixture f;
  MotionState rest;
  rest.position = kHome;
  const Trajectory flown = quintic_to(rest, f.now_us - 300'000, {0, 1.5, 1}, 3.0);
  f.send_own({flown, {}});
  f.send_goal({1.5, 1.5, 1});
  f.send_map();
  const Trajectory planned = f.planned();
  EXPECT_EQ(planned.start_utime(), f.now_us + 35'000);
  const MotionState branch = flown.at(planned.start_utime()), first = planned.knot(0);
  EXPECT_LT((branch.position - first.position).norm(), 1e-5);
  EXPECT_LT((branch.velocity - first.velocity).norm(), 1e-5);
  EXPECT_LT((branch.acceleration - first.acceleration).norm(), 1e-5);
  EXPECT_GT(branch.velocity.norm(), 0.05);  // it was no hover
  for (std::int64_t t = planned.start_utime(); t < planned.end_utime(); t += 10'000) {
    EXPECT_LE(planned.at(t).velocity.cwiseAbs().maxCoeff(), 2.0 * 1.01);
    EXPECT_LE(planned.at(t).acceleration.cwiseAbs().maxCoeff(), 6.0 * 1.01);
  }
  EXPECT_EQ(f.out.newest<candidate_t>(channel::kCandidate).header.robot_id, kRobot);
}

TEST(PlannerNode, WaitsForACommittedTrajectoryThatHasNotBegun) {
  Fixture f;
  const Trajectory hover = Trajectory::hover(1, f.now_us, kHome);
  const Trajectory next = quintic_to(hover.at(0), f.now_us + 150'000, {0, 1, 1}, 2.0, 5, 2);
  f.send_own({hover, next});
  f.send_goal({1, 0, 1});
  f.send_map();
  EXPECT_EQ(f.node.plans(), 0);
  EXPECT_EQ(f.wake_us, next.start_utime());
  f.run_until(next.start_utime() - 1);
  EXPECT_EQ(f.node.plans(), 0);
  f.run_until(next.start_utime());
  ASSERT_EQ(f.node.plans(), 1);
  const Trajectory planned = f.planned();
  EXPECT_LT((planned.knot(0).acceleration - next.at(planned.start_utime()).acceleration).norm(), 1e-5);
  EXPECT_GT(planned.knot(0).acceleration.norm(), 0.05);
}

TEST(PlannerNode, FollowsTheGoal) {
  Fixture f;
  for (const Eigen::Vector3d& goal : {Eigen::Vector3d(1, 0, 1), Eigen::Vector3d(-0.5, 1.2, 1.4), kHome}) {
    f.send_hover();
    f.send_goal(goal);
    f.send_map();
    EXPECT_LT((end_of(f.planned()) - goal).norm(), 0.05) << goal.transpose();
    f.run_for(0.1);
  }
  f.send_goal({40, 0, 1});  // out of sight
  f.send_map();
  EXPECT_GT(end_of(f.planned()).x(), 2.0);
  EXPECT_EQ(f.node.plans(), 4);
}

TEST(PlannerNode, WithoutAGoalItHoldsItsPlaceButStepsAside) {
  Fixture f;
  f.send_hover();
  f.send_map();
  EXPECT_LT((end_of(f.planned()) - kHome).norm(), 0.05);
  // A peer comes by, over the robot's place. Whatever is planned is committed.
  Motion peer{Trajectory::hover(1, f.now_us, {-2, 0, 1}), {}}, own{Trajectory::hover(1, f.now_us, kHome), {}};
  peer.next = quintic_to(peer.committed.at(0), f.now_us + 50'000, {2, 0, 1}, 3.0);
  double nearest = INFINITY;
  while (f.now_us < peer.end_utime()) {
    const int candidates = f.out.count(channel::kCandidate);
    f.send_peer(7, peer.committed, peer.next, announcement_t::kAnnounced);
    f.send_own(own);
    f.send_map();
    if (f.out.count(channel::kCandidate) > candidates) own.next = f.planned();
    for (int i = 0; i < 5; ++i) {
      f.run_for(0.01);
      nearest = std::min(nearest, (own.at(f.now_us).position - peer.at(f.now_us).position).norm());
    }
    if (!own.next.empty()) own = {own.next, {}};
  }
  EXPECT_GT(nearest, 0.4);
  EXPECT_LT((own.at(f.now_us).position - kHome).norm(), 0.1);  // and back it is
}

TEST(PlannerNode, KeepsClearOfPeersAndObstacles) {
  const Eigen::Vector3d goal(2, 0, 1), middle(1, 0, 1);
  Fixture alone, with_obstacle;
  alone.start(goal);
  const Trajectory straight = alone.planned();  // through the middle
  std::int64_t middle_us = straight.start_utime();
  while (straight.at(middle_us).position.x() < middle.x()) middle_us += 10'000;
  with_obstacle.occupy(middle - Eigen::Vector3d(0.2, 0.2, 5), middle + Eigen::Vector3d(0.2, 0.2, 5));
  with_obstacle.start(goal);
  const Trajectory around = with_obstacle.planned();
  for (std::int64_t t = around.start_utime(); t <= around.end_utime(); t += 10'000) {
    EXPECT_GT((around.at(t).position - middle).norm(), 0.4);
  }
  // A peer that stands in the middle; one that will be there at the same time, bound to it or not yet.
  const Motion stands{Trajectory::hover(1, kStart_us, middle), {}};
  Motion crosses{Trajectory::hover(1, kStart_us, {1, -1.5, 1}), {}};
  const std::int64_t leaves_us = kStart_us + 10'000;
  crosses.next =
      quintic_to(crosses.committed.at(0), leaves_us, {1, 1.5, 1}, 2e-6 * static_cast<double>(middle_us - leaves_us));
  for (const std::int8_t state : {announcement_t::kNone, announcement_t::kAnnounced, announcement_t::kCommitted}) {
    SCOPED_TRACE(static_cast<int>(state));
    const Motion& theirs = state == announcement_t::kNone ? stands : crosses;
    Fixture f;
    f.send_peer(1, theirs.committed, theirs.next, state);
    f.start(goal);
    const Trajectory planned = f.planned();
    EXPECT_TRUE(motions_separated({planned, {}}, theirs, planned.start_utime(), 0.42));
    EXPECT_FALSE(motions_separated({straight, {}}, theirs, planned.start_utime(), 0.42));
  }
}

TEST(PlannerNode, PublishesTheCorridorsOfItsPlan) {
  Fixture f;
  f.occupy({0.8, -0.2, -1}, {1.2, 0.2, 3});
  f.start({2, 0, 1});
  const auto corridors = f.out.newest<corridors_t>(channel::kCorridors);
  const auto candidate = f.out.newest<candidate_t>(channel::kCandidate);
  const Trajectory planned = f.planned();
  EXPECT_EQ(corridors.trajectory_seq, candidate.trajectory.seq);
  EXPECT_EQ(f.status().outcome, planner_status_t::kSmooth);
  std::vector<int> faces(static_cast<std::size_t>(planned.num_pieces()), 0);
  for (const auto& face : corridors.faces) {
    ASSERT_LT(face.piece, planned.num_pieces());
    ++faces[static_cast<std::size_t>(face.piece)];
    const Eigen::Vector3d normal = Eigen::Vector3f(face.normal).cast<double>();
    for (int k = 0; k <= 20; ++k) {
      const std::int64_t t = planned.start_utime() + face.piece * planned.piece_us() + k * planned.piece_us() / 20;
      EXPECT_LE(normal.dot(planned.at(t).position), face.offset + 1e-3) << "piece " << face.piece << ", " << k;
    }
  }
  for (const int count : faces) EXPECT_GE(count, 4);  // fewer do not bound anything
}

TEST(PlannerNode, TakesMapsInSeveralParts) {
  Fixture f;
  std::mt19937_64 random(1);
  for (int frame = 0; frame < f.map.num_frames; ++frame) {  // noise that does not compress, behind the robot
    for (int x = 0; x < 30; ++x) {
      for (int y = 0; y < 100; ++y) *f.map.column(frame, x, y) = random() & ((std::uint64_t{1} << 40) - 1);
    }
  }
  f.send_hover();
  f.send_goal({1, 0, 1});
  const std::vector<sogm_t> parts = f.map_parts();
  ASSERT_GE(parts.size(), 4u);
  for (std::size_t i = parts.size(); i-- > 0;) {
    EXPECT_EQ(f.node.plans(), 0);
    f.send(channel::kSogm, parts[i]);
    f.run_for(0.001);
  }
  EXPECT_EQ(f.node.plans(), 1);
  EXPECT_LT((end_of(f.planned()) - Eigen::Vector3d(1, 0, 1)).norm(), 0.05);
  const std::vector<sogm_t> incomplete = f.map_parts();
  f.run_for(0.05);
  for (std::size_t i = 1; i < incomplete.size(); ++i) f.send(channel::kSogm, incomplete[i]);
  EXPECT_EQ(f.node.plans(), 1);
  f.send_map();
  EXPECT_EQ(f.node.plans(), 2);
  EXPECT_EQ(f.node.refused().total(), 0);
}

TEST(PlannerNode, DurationsArePublishedOrZero) {
  for (const bool publish : {true, false}) {
    std::int64_t ns = 0;
    Fixture f(
        Fixture::make_config(), [&ns] { return ns += 2'000'000; }, publish);
    f.start({1, 0, 1});
    const planner_status_t status = f.status();
    for (const float ms :
         {status.compose_ms, status.search_ms, status.corridor_ms, status.optimize_ms, status.check_ms}) {
      EXPECT_EQ(ms, publish ? 2.0f : 0.0f);
    }
    EXPECT_EQ(status.total_ms, publish ? 10.0f : 0.0f);
    EXPECT_EQ(f.node.newest_plan().step_ms[0], 2.0);
    EXPECT_GT(status.expansions, 0);
  }
}

TEST(PlannerNode, RefusalsAreCountedAndChangeNothing) {
  Fixture f, untouched;
  for (Fixture* each : {&f, &untouched}) each->start({1.5, 0.5, 1});
  std::array<int, kNumRefusals> expected{};
  const auto expect_refused = [&](Refusal reason, const char* channel, const Bytes& bytes) {
    f.deliver(BusId::kOnboard, channel, bytes);
    ++expected[static_cast<std::size_t>(reason)];
    for (int i = 0; i < kNumRefusals; ++i) {
      ASSERT_EQ(f.node.refused()[static_cast<Refusal>(i)], expected[static_cast<std::size_t>(i)])
          << channel << ", " << to_string(reason) << " expected, " << to_string(static_cast<Refusal>(i)) << " counted";
    }
  };
  const auto refuse_each = [&](const char* channel, const auto& message, bool timed, int wrong_robot) {
    const auto changed = [&](const auto& change) {
      auto copy = message;
      change(copy);
      return encoded(copy);
    };
    Bytes damaged = encoded(message);
    damaged[damaged.size() / 2] ^= 1;
    expect_refused(Refusal::kSize, channel, {});
    expect_refused(Refusal::kFingerprint, channel, Bytes(damaged.size(), 0x5a));
    expect_refused(Refusal::kCrc, channel, damaged);
    expect_refused(Refusal::kVersion, channel, changed([](auto& m) { m.header.schema_version = 2; }));
    expect_refused(Refusal::kRobot, channel,
                   changed([&](auto& m) { m.header.robot_id = static_cast<std::int16_t>(wrong_robot); }));
    if (!timed) return;
    expect_refused(Refusal::kTime, channel, changed([](auto& m) { m.header.utime -= 1'000'001; }));
    expect_refused(Refusal::kTime, channel, changed([](auto& m) { m.header.utime += 100'001; }));
  };
  const Trajectory elsewhere = Trajectory::hover(4, f.now_us, {0.5, 0.2, 1});
  goal_t goal{};
  goal.header = make_header(kRobot, 1, 50, f.now_us);
  goal.position[0] = -3;
  f.map.words.assign(f.map.words.size(), 0);
  f.occupy({0.4, -5, -1}, {0.6, 5, 3});
  const std::vector<sogm_t> wall = f.map_parts();
  ASSERT_EQ(wall.size(), 1u);
  refuse_each(channel::kSogm, wall[0], true, kRobot + 1);
  refuse_each(channel::kGoal, goal, false, kRobot + 1);
  refuse_each(channel::kOwnTrajectory, f.announcement(kRobot, elsewhere, {}, 0), false, kRobot + 1);
  refuse_each(channel::kPeerTrajectory, f.announcement(1, elsewhere, {}, 0), true, kRobot);
  goal.header.seq = 0;
  expect_refused(Refusal::kSequence, channel::kGoal, encoded(goal));
  goal.position[0] = INFINITY;
  expect_refused(Refusal::kValue, channel::kGoal, encoded(goal));
  f.deliver(BusId::kOnboard, "OTHER", Bytes(100, 1));

  for (Fixture* each : {&f, &untouched}) each->run_for(0.1);
  f.map.words.assign(f.map.words.size(), 0);
  for (Fixture* each : {&f, &untouched}) each->send_map();
  EXPECT_EQ(f.node.plans(), 2);
  EXPECT_EQ(encoded(f.out.newest<candidate_t>(channel::kCandidate)),
            encoded(untouched.out.newest<candidate_t>(channel::kCandidate)));
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), f.status().refused));
}

TEST(PlannerNode, BeforeTheFirstPlanTheNewestIsNone) {
  const Fixture f;
  EXPECT_TRUE(f.node.newest_plan().trajectory.empty());
  EXPECT_FALSE(f.node.newest_plan().fly);
  EXPECT_EQ(f.node.newest_plan().expansions, 0);
}

TEST(PlannerNode, AClockThatIsSetStopsNeitherPlansNorStatuses) {
  for (const std::int64_t step_us : {-5'000'000, 10'000'000}) {
    SCOPED_TRACE(step_us);
    Fixture f;
    const auto plan_for = [&f](double seconds) {
      for (int i = 0; i < std::lround(20 * seconds); ++i) {
        f.send_hover();
        f.send_map();
        f.run_for(0.05);
      }
    };
    f.start({3, 0, 1});
    f.send_peer(1, Trajectory::hover(1, f.now_us, {5, 5, 1}));
    plan_for(1.0);
    const int plans = f.node.plans(), maps = f.node.missed() + plans;
    f.now_us += step_us;
    f.step();
    EXPECT_EQ(f.node.plans(), plans);  // with a map of another time
    f.run_for(3.0);
    EXPECT_EQ(f.node.plans(), plans);
    EXPECT_EQ(f.status().state, planner_status_t::kStaleMap);
    EXPECT_GE(f.out.count(channel::kPlannerStatus), plans + 3);
    f.send_goal({3, 0.1, 1});
    plan_for(1.0);
    EXPECT_GE(f.node.plans(), plans + 19);
    EXPECT_EQ(f.node.missed() + f.node.plans(), maps + 20);
    EXPECT_LE(f.status().rate_hz, 21.0f);
    EXPECT_TRUE(f.node.newest_request().peers->at(0).silent);
  }
}

// A budget that would take a gigabyte is a slip of the pen.
TEST(PlannerNodeConfig, TheBudgetIsBounded) {
  const auto parse = [](const char* budget) {
    PlannerNodeConfig config;
    OptionSet options("planner_daemon", "");
    declare(options, config);
    const char* arguments[] = {"", "--max-expansions", budget};
    std::ostringstream out;
    (void)options.parse(3, arguments, out);
  };
  EXPECT_NO_THROW(parse("5000"));
  EXPECT_THROW(parse("5001"), OptionError);
}

TEST(PlannerNodeConfig, ImpossibleCombinationsAreRefusedByName) {
  const auto complaint = [](const std::function<void(PlannerNodeConfig&)>& change) -> std::string {
    PlannerNodeConfig config = Fixture::make_config();
    change(config);
    try {
      PlannerNode node(config, 1, nullptr);
    } catch (const OptionError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(complaint([](PlannerNodeConfig&) {}), "");
  const auto names = [](const std::string& text, const char* name) { return text.find(name) != std::string::npos; };
  EXPECT_TRUE(names(complaint([](auto& c) { c.planner.limits.space_min.z() = 3.8; }), "space-min"));
  EXPECT_TRUE(names(complaint([](auto& c) { c.planner.space.emergency_clearance_m = 0.2; }), "emergency-clearance"));
  EXPECT_TRUE(names(complaint([](auto& c) { c.planner.search.num_pieces = 2; }), "pieces"));
}

}  // namespace
}  // namespace swarm::test
