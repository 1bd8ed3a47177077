// Setpoints while the wall clock is set: they go on at their rate, along what was committed, and never jump.
#include <string>

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/coordination/broadcast_node.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::announcement_t;
using sogm_swarm::broadcast_status_t;
using sogm_swarm::candidate_t;
using sogm_swarm::setpoint_t;

const Eigen::Vector3d kHome(0, 0, 1);

struct Kept {
  MemoryPromiseStore promises;
};

// A robot without peers: what it proposes is committed at once.
struct Loner : Kept, Bench<BroadcastNode> {
  Loner() : Bench(make_config(), promises, 77) { send(channel::kRobotState, state_at(0, kHome, 0, now_us)); }
  static BroadcastConfig make_config() {
    BroadcastConfig config;
    config.roster = {0};
    return config;
  }
  void propose(const Eigen::Vector3d& to, double seconds = 2.5) {
    const std::int64_t start_us = now_us + 100'000;
    candidate_t candidate{};
    candidate.header = make_header(0, 1, candidates++, now_us);
    candidate.trajectory = quintic_to(node.motion()->at(start_us), start_us, to, seconds).to_wire();
    send(channel::kCandidate, candidate);
  }
  // One step, when it is wanted; true when the clock's step was taken.
  bool turn() {
    const bool is_asked = wall_ahead_us != 0;
    now_us = wake_us;
    step();
    return is_asked && wall_ahead_us == 0;
  }
  broadcast_status_t status() const { return out.newest<broadcast_status_t>(channel::kBroadcastStatus); }

  std::int64_t candidates = 0;
};

TEST(BroadcastClock, SetpointsGoOnWhenTheWallClockIsSet) {
  for (const std::int64_t step_us : {-5'000'000, -5'003'217, 500'000, -1'000'000, 10'000'000, -25'000}) {
    SCOPED_TRACE(step_us);
    Loner robot;
    robot.run_for(0.2);
    robot.propose({2, 0, 1});
    const std::int64_t start_us = robot.now_us;
    robot.run_for(1.0);
    const Motion motion = *robot.node.motion();
    const std::int64_t end_us = motion.end_utime();
    ASSERT_GT(motion.at(robot.now_us).velocity.norm(), 1.0);
    robot.wall_ahead_us = step_us;
    robot.step();
    robot.propose({0, 0, 1});
    EXPECT_EQ(robot.node.rejected(Rejection::kClock), 1);

    std::int64_t shift_us = 0, last_us = robot.now_us, taken_us = 0;
    int setpoints = robot.out.count(channel::kSetpoint), begun_with = setpoints;
    while (robot.now_us - shift_us < start_us + 5'000'000) {
      if (robot.turn()) shift_us = step_us, taken_us = robot.now_us - shift_us;
      if (robot.out.count(channel::kSetpoint) == setpoints) continue;
      ++setpoints;
      const auto setpoint = robot.out.newest<setpoint_t>(channel::kSetpoint);
      const std::int64_t really_us = setpoint.header.utime - shift_us;
      EXPECT_LE(really_us - last_us, 20'000);
      EXPECT_LT((Eigen::Vector3d(setpoint.position) - motion.at(really_us).position).norm(), 1e-4);
      last_us = really_us;
    }
    EXPECT_NEAR(setpoints - begun_with, 400, 2);
    EXPECT_GE(taken_us, end_us);
    EXPECT_LE(taken_us, end_us + 10'000);
    int doubtful = 0;
    for (const auto& status : robot.out.all<broadcast_status_t>(channel::kBroadcastStatus))
      doubtful += status.state == broadcast_status_t::kClock;
    EXPECT_GE(doubtful, 1);

    // Whatever it is bound to now has begun, and survives a crash.
    const auto told = robot.out.newest<announcement_t>(channel::kOwnTrajectory);
    EXPECT_LE(told.committed.start_utime, robot.now_us);
    EXPECT_EQ(load_promise(robot.promises, 0, 1).motion->seq(), told.committed.seq);
    EXPECT_EQ(robot.status().state, broadcast_status_t::kFlying);
    robot.propose({0, 0, 1});
    EXPECT_EQ(robot.node.protocol().commits(), 2);
    robot.run_for(3.0);
    EXPECT_LT((robot.node.motion()->at(robot.now_us).position - kHome).norm(), 1e-3);
  }
}

TEST(BroadcastClock, AStepThatIsTakenBackIsForgotten) {
  Loner robot;
  robot.propose({2, 0, 1});
  robot.run_for(1.0);
  EXPECT_FALSE(robot.node.on_clock_step(robot.now_us, 3'000'000));
  robot.propose({0, 0, 1});
  EXPECT_EQ(robot.node.rejected(Rejection::kClock), 1);
  EXPECT_FALSE(robot.node.on_clock_step(robot.now_us, 0));
  robot.propose({0, 0, 1});
  EXPECT_EQ(robot.node.protocol().commits(), 2);
}

// A log that is played again asks nobody.
TEST(BroadcastClock, UnaskedItGoesOnAtItsRate) {
  for (const std::int64_t step_us : {-5'000'000, 10'000'000}) {
    SCOPED_TRACE(step_us);
    Loner robot;
    robot.run_for(1.0);
    robot.now_us += step_us;
    robot.step();
    const int setpoints = robot.out.count(channel::kSetpoint), statuses = robot.out.count(channel::kBroadcastStatus);
    const int announcements = robot.out.count(channel::kOwnTrajectory);
    robot.run_for(3.0);
    EXPECT_NEAR(robot.out.count(channel::kSetpoint) - setpoints, 300, 1);
    EXPECT_NEAR(robot.out.count(channel::kBroadcastStatus) - statuses, 3, 1);
    EXPECT_NEAR(robot.out.count(channel::kOwnTrajectory) - announcements, 65, 6);
    for (const auto& setpoint : robot.out.all<setpoint_t>(channel::kSetpoint))
      EXPECT_LT((Eigen::Vector3d(setpoint.position) - kHome).norm(), 1e-9);
  }
}

// What peers do, they do when they did, and each must be heard again by the new clock: else a robot whose clock is
// wrong would fly through where a peer is.
TEST(BroadcastClock, PeersMoveWhenTheyDidAndAreAwaited) {
  for (const std::int64_t step_us : {5'000'000, -60'000'000}) {
    SCOPED_TRACE(step_us);
    CommitProtocol ours({.robot_id = 0, .roster = {0, 1}}), theirs({.robot_id = 1, .roster = {0, 1}});
    ours.start({Trajectory::hover(1, kStart_us, kHome), {}});
    Motion flies{Trajectory::hover(1, kStart_us, {3, 0, 1}), {}};
    flies.next = quintic_to(flies.committed.at(kStart_us), kStart_us + 100'000, {3, 2, 1}, 2.0);
    theirs.start(flies);
    std::int64_t seq = 0;
    const auto say = [&](const CommitProtocol& from, int id, CommitProtocol* to, std::int64_t now_us) {
      announcement_t message = from.state();
      message.header = make_header(id, 1, seq++, now_us);
      ASSERT_TRUE(to->receive(now_us, message));
    };
    say(ours, 0, &theirs, kStart_us);
    say(theirs, 1, &ours, kStart_us);
    ASSERT_TRUE(ours.all_hear());
    const Motion before = ours.peers().at(1).motion;
    const std::int64_t now_us = kStart_us + 1'000'000, then_us = now_us + step_us;
    ours.set_clock(then_us, step_us);
    EXPECT_FALSE(ours.all_hear());
    const Motion& after = ours.peers().at(1).motion;
    for (std::int64_t t = 0; t < 3'000'000; t += 50'000)
      EXPECT_EQ(after.at(then_us + t).position, before.at(now_us + t).position);
    const Trajectory plan = quintic_to(ours.motion()->at(then_us), then_us + 200'000, {1, 0, 1}, 2.0);
    EXPECT_EQ(ours.propose(then_us, plan), Rejection::kWaiting);
    say(theirs, 1, &ours, then_us);
    EXPECT_TRUE(ours.all_hear());
  }
}

// A clock that was set back, and then a crash: what was promised has been flown and is not flown again.
TEST(BroadcastClock, APromiseFromTheFutureIsNotFlownAgain) {
  Loner robot;
  robot.run_for(0.2);
  robot.propose({2, 0, 1});
  robot.run_for(0.3);
  const Eigen::Vector3d place = robot.node.motion()->at(robot.now_us).position;
  ASSERT_LT((place - kHome).norm(), 0.4);  // so near to where the trajectory begins that it might begin again
  Bench<BroadcastNode> again(Loner::make_config(), robot.promises, 78);
  again.now_us = robot.now_us - 60'000'000;
  again.send(channel::kRobotState, state_at(0, place, 0, again.now_us));
  const Motion motion = *again.node.motion();
  for (std::int64_t t = 0; t < 70'000'000; t += 100'000) {
    EXPECT_EQ(motion.at(again.now_us + t).velocity, Eigen::Vector3d::Zero());
    EXPECT_LT((motion.at(again.now_us + t).position - place).norm(), 1e-6);
  }
  EXPECT_GT(motion.seq(), robot.node.motion()->seq());
  EXPECT_TRUE(again.node.on_clock_step(again.now_us + 1'000'000, 60'000'000));
}

TEST(BroadcastClock, WhatIsAnnouncedIsWithdrawnWhenTheClockIsSet) {
  CommitProtocol protocol({.robot_id = 1, .roster = {0, 1}});
  protocol.start({Trajectory::hover(4, kStart_us, kHome), {}});
  const Trajectory plan = quintic_to(protocol.motion()->at(kStart_us), kStart_us + 500'000, {1, 0, 1}, 2.0);
  ASSERT_EQ(protocol.propose(kStart_us, plan, true), Rejection::kNone);
  const std::int32_t seq = protocol.pending().seq();
  (void)protocol.take_news();
  protocol.set_clock(kStart_us + 200'000, 100'000);
  EXPECT_TRUE(protocol.pending().empty());
  EXPECT_EQ(protocol.motion()->seq(), 4);  // over in the new time as in the old
  EXPECT_TRUE(protocol.take_news());
  protocol.set_clock(kStart_us - 5'000'000, -5'200'000);
  EXPECT_GT(protocol.motion()->seq(), seq);
  EXPECT_EQ(protocol.motion()->committed.start_utime(), kStart_us - 5'000'000);
  EXPECT_LT((protocol.motion()->at(kStart_us).position - kHome).norm(), 1e-6);
}

}  // namespace
}  // namespace swarm::test
