// The planner daemon's node: when it plans, and from when on its plans are to be flown.
#include "planner_daemon/coordination/commit_delay.h"
#include "tests/support/planner_node_fixture.h"

namespace swarm::test {
namespace {

using Fixture = PlannerNodeFixture;

constexpr double kPlan_s = PlanDelay::kMargin_s;  // plans are announced as soon as they are begun

// What becomes of a plan: announced, then committed after `answer_s`, or withdrawn when it should begin.
void carry_out(Fixture& f, double answer_s, bool commits) {
  static std::int32_t seq = 100;
  Trajectory plan = f.planned();
  plan.set_seq(++seq);
  const Trajectory hover = Trajectory::hover(1, f.now, kHome);
  const Utime stamp = f.now;
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
  return to_seconds(f.planned().start_utime() - f.now);
}

TEST(PlannerNode, WaitsForAnAnnouncedPlan) {
  PlannerNodeConfig config = Fixture::make_config();
  config.lead_s = 0.3;
  Fixture f(config);
  f.start({2, 0, 1});
  ASSERT_EQ(f.node.plans(), 1);
  Trajectory plan = f.planned();
  plan.set_seq(7);
  const Trajectory hover = Trajectory::hover(1, f.now, kHome);
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
  f.map.reset(f.map.geometry, f.map.num_frames, Utime(), f.map.frame_duration);
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
  ASSERT_NEAR(lead_s(f), kPlan_s + CommitDelay::kLongest_s, 1e-6);
  Trajectory plan = f.planned();
  plan.set_seq(7);
  const Trajectory hover = Trajectory::hover(1, f.now, kHome);
  f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kAnnounced, f.now));
  const int plans = f.node.plans();
  f.run_for(0.1);
  f.send_map();
  EXPECT_EQ(f.node.plans(), plans);  // it waits for the plan that was announced
  f.run_for(0.1);
  send_threat(f, 1.9);
  EXPECT_EQ(f.node.plans(), plans + 1);
  EXPECT_EQ(f.out.newest<candidate_t>(channel::kCandidate).urgent, 1);
  EXPECT_LT(f.planned().start_utime(), f.now + 950ms);  // a second before it comes
  f.run_for(0.03);
  send_threat(f, 1.8);
  EXPECT_EQ(f.node.plans(), plans + 1);  // not before the period is over
  f.run_for(0.02);
  EXPECT_EQ(f.node.plans(), plans + 2);  // it was not announced
  plan = f.planned();
  plan.set_seq(8);
  f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kAnnounced, f.now));
  f.run_until(plan.start_utime() - 5ms);
  send_threat(f, 1.0);
  EXPECT_EQ(f.node.plans(), plans + 2);  // an urgent plan is waited for
}

// The more time there is until then, the more there is for answers.
TEST(PlannerNode, UrgentPlansBeginInTime) {
  for (const double s : {0.3, 0.9, 1.3, 1.9}) {
    SCOPED_TRACE(s);
    Fixture f;
    f.start({0.5, 0, 1});
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
    const double begins_s = to_seconds(f.planned().start_utime() - f.now);
    ASSERT_EQ(f.out.newest<candidate_t>(channel::kCandidate).urgent, 1);
    if (s < 0.6) {
      EXPECT_NEAR(begins_s, kPlan_s + 0.02, 1e-6);
    } else {
      EXPECT_NEAR(begins_s, s - (s < 1.0 ? 0.6 : 1.0), s < 1.5 && s > 1.0 ? 0.3 : 0.021);
    }
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
        f.announcement(kRobot, Trajectory::hover(1, f.now, kHome), plan, announcement_t::kCommitted, f.now);
    message.forced_seq = answered ? 0 : 7;
    f.send(channel::kOwnTrajectory, message);
    f.run_until(plan.start_utime() + 20ms);
    f.send_hover();
    send_threat(f, 0.9);
    ASSERT_EQ(f.node.plans(), 2);
    EXPECT_EQ(f.out.newest<candidate_t>(channel::kCandidate).urgent, 1);
    EXPECT_EQ((end_of(f.planned()) - kHome).x() > 1.2, answered) << end_of(f.planned()).transpose();
  }
}

TEST(PlannerNode, PlansFartherAheadWherePeersAnswerLate) {
  const double usual_s = kPlan_s + 0.005 + CommitDelay::kMargin_s;
  Fixture f;
  f.start({2, 0, 1});
  for (int i = 0; i < 10; ++i) {
    carry_out(f, 0.005, true);
    ASSERT_NEAR(lead_s(f), usual_s, 1e-6);
  }
  double lead = usual_s;
  for (int i = 0; i < 16; ++i) {  // too late, until the plans begin late enough
    const bool in_time = lead > 0.2;
    carry_out(f, in_time ? 0.2 : lead + 0.01, in_time);
    const double next = lead_s(f);
    if (!in_time) {
      EXPECT_NEAR(next, kPlan_s + 1.25 * lead, 1e-3);
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
  EXPECT_NEAR(lead, kPlan_s + CommitDelay::kLongest_s, 1e-6);
}

TEST(PlanDelay, IsTheLongestButOneOfTheNewest) {
  PlanDelay delay(0.025);
  EXPECT_EQ(delay.lead_s(), 0.025);
  delay.took(0.017);
  EXPECT_NEAR(delay.lead_s(), 0.017 + PlanDelay::kMargin_s, 1e-12);
  delay.took(0.002);
  EXPECT_NEAR(delay.lead_s(), 0.002 + PlanDelay::kMargin_s, 1e-12);
  delay.took(0.009);
  EXPECT_NEAR(delay.lead_s(), 0.009 + PlanDelay::kMargin_s, 1e-12);
  for (const double unlikely : {-0.001, 1.5, std::nan("")}) delay.took(unlikely);
  EXPECT_NEAR(delay.lead_s(), 0.009 + PlanDelay::kMargin_s, 1e-12);
  for (int i = 0; i < 16; ++i) delay.took(0.003);
  EXPECT_NEAR(delay.lead_s(), 0.003 + PlanDelay::kMargin_s, 1e-12);
}

// As late as announcements of its plans were lately, those that build heuristics apart.
TEST(PlannerNode, PlansAsFarAheadAsPlanningTakes) {
  Fixture f;
  f.start({2, 0, 1});
  EXPECT_NEAR(to_seconds(f.planned().start_utime() - f.now), Fixture::make_config().lead_s + CommitDelay::kMargin_s,
              1e-6);
  for (int i = 0; i < 3; ++i) {
    Trajectory plan = f.planned();
    plan.set_seq(100 + i);
    f.run_for(0.008);
    const Trajectory hover = Trajectory::hover(1, f.now, kHome);
    f.send(channel::kOwnTrajectory, f.announcement(kRobot, hover, plan, announcement_t::kCommitted, f.now));
    EXPECT_NEAR(lead_s(f), 0.008 + PlanDelay::kMargin_s + CommitDelay::kMargin_s, 1e-6) << i;
  }
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
  const Utime first = f.now;
  for (int i = 0; i < 3; ++i) {
    f.run_for(0.02);
    f.send_map();
  }
  EXPECT_EQ(f.node.plans(), 1);
  EXPECT_EQ(f.node.missed(), 2);
  EXPECT_EQ(f.wake, first + 100ms);
  f.run_until(first + 99'999us);
  EXPECT_EQ(f.node.plans(), 1);
  f.run_until(first + 100ms);
  EXPECT_EQ(f.node.plans(), 2);
  EXPECT_EQ(f.status().missed, 2);
}

// Half the plans of a flight are better by nothing that counts.
TEST(PlannerNode, PlansLessOftenWhileNothingAsksForIt) {
  PlannerNodeConfig config = Fixture::make_config();
  config.calm_period_s = 0.2;
  Fixture f(config);
  f.start(kHome);
  const auto plans_of_four_maps = [&f](const Trajectory& flown = {}) {
    const int plans = f.node.plans();
    for (int i = 0; i < 4; ++i) {
      f.run_for(0.05);
      if (flown.empty()) {
        f.send_hover();
      } else {
        f.send_own({flown, {}});
      }
      f.send_map();
    }
    return f.node.plans() - plans;
  };
  EXPECT_EQ(plans_of_four_maps(), 1);
  EXPECT_EQ(plans_of_four_maps(), 1);
  EXPECT_EQ(f.node.missed(), 0) << "those maps need not be planned with";
  f.send_peer(1, Trajectory::hover(1, f.now, kHome + Eigen::Vector3d(0.3, 0, 0)));
  EXPECT_GE(plans_of_four_maps(), 4) << "a peer is too close to where it hovers";
  f.send_peer(1, Trajectory::hover(2, f.now, {5, 5, 1}));
  EXPECT_LE(plans_of_four_maps(), 2);
  const auto free = f.map;
  f.occupy(kHome - Eigen::Vector3d(0.1, 0.1, 0.1), kHome + Eigen::Vector3d(0.1, 0.1, 0.1), 19);
  EXPECT_GE(plans_of_four_maps(), 4) << "something will be where it hovers";
  f.map = free;
  EXPECT_LE(plans_of_four_maps(), 2);
  EXPECT_EQ(plans_of_four_maps(), 1);

  f.send_goal({0, 1, 1});
  const Trajectory first = f.planned();
  EXPECT_GT(first.start_utime(), f.now) << "another goal";
  EXPECT_GE(plans_of_four_maps(), 4) << "what was planned is not flown";
  EXPECT_LE(plans_of_four_maps(f.planned()), 1);

  Sogm seen;
  seen.reset({.resolution_m = 0.1, .origin = {-64, -64, -32}, .size = {128, 128, 64}}, 2, f.now, 100ms);
  SogmEncoder encoder;
  for (const sogm_t& part : encoder.encode(seen, make_header(kRobot, 1, 1, f.now))) f.send(channel::kSeenSpace, part);
  const Trajectory flown = f.planned();
  EXPECT_GE(plans_of_four_maps(flown), 4) << "who sees by itself knows less";
}

// A plan that is due between two maps would be made of an old one, again and again.
TEST(PlannerNode, CalmPlansAreMadeOfMapsThatHaveJustCome) {
  PlannerNodeConfig config = Fixture::make_config();
  config.calm_period_s = 0.23;
  Fixture f(config);
  f.start(kHome);
  const int first = f.node.plans();
  for (int i = 0; i < 40; ++i) {
    const int plans = f.node.plans();
    f.run_for(0.05);
    EXPECT_EQ(f.node.plans(), plans) << i;
    f.send_hover();
    f.send_map();
  }
  EXPECT_EQ(f.node.plans() - first, 8);  // the fifth map is the nearest
}

TEST(PlannerNode, LeavesTheCommittedMotionAfterTheLead) {
  Fixture f;
  MotionState rest;
  rest.position = kHome;
  const Trajectory flown = quintic_to(rest, f.now - 300ms, {0, 1.5, 1}, 3.0);
  f.send_own({flown, {}});
  f.send_goal({1.5, 1.5, 1});
  f.send_map();
  const Trajectory planned = f.planned();
  EXPECT_EQ(planned.start_utime(), f.now + 28ms);
  const MotionState branch = flown.at(planned.start_utime()), first = planned.knot(0);
  EXPECT_LT((branch.position - first.position).norm(), 1e-4);  // rounded
  EXPECT_LT((branch.velocity - first.velocity).norm(), 1e-3);
  EXPECT_LT((branch.acceleration - first.acceleration).norm(), 1e-2);
  EXPECT_GT(branch.velocity.norm(), 0.05);  // it was no hover
  for (Utime t = planned.start_utime(); t < planned.end_utime(); t += 10ms) {
    EXPECT_LE(planned.at(t).velocity.cwiseAbs().maxCoeff(), 2.0 * 1.01);
    EXPECT_LE(planned.at(t).acceleration.cwiseAbs().maxCoeff(), 6.0 * 1.01);
  }
  EXPECT_EQ(f.out.newest<candidate_t>(channel::kCandidate).header.robot_id, kRobot);
}

TEST(PlannerNode, WaitsForACommittedTrajectoryThatHasNotBegun) {
  Fixture f;
  const Trajectory hover = Trajectory::hover(1, f.now, kHome);
  const Trajectory next = quintic_to(hover.at({}), f.now + 150ms, {0, 1, 1}, 2.0, 5, 2);
  f.send_own({hover, next});
  f.send_goal({1, 0, 1});
  f.send_map();
  EXPECT_EQ(f.node.plans(), 0);
  EXPECT_EQ(f.wake, next.start_utime());
  f.run_until(next.start_utime() - 1us);
  EXPECT_EQ(f.node.plans(), 0);
  f.run_until(next.start_utime());
  ASSERT_EQ(f.node.plans(), 1);
  const Trajectory planned = f.planned();
  EXPECT_LT((planned.knot(0).acceleration - next.at(planned.start_utime()).acceleration).norm(), 1e-2);
  EXPECT_GT(planned.knot(0).acceleration.norm(), 0.05);
}

}  // namespace
}  // namespace swarm::test
