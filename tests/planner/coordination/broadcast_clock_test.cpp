// Setpoints while the wall clock is set: they go on at their rate, along what was committed, and never jump. And what
// wrong clocks of peers hinder. Long because clocks go wrong in many ways: back, ahead, drifting, one's own, a peer's.
#include <vector>

#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

using sogm_swarm::setpoint_t;

const Eigen::Vector3d kHome(0, 0, 1);

// A robot without peers: what it proposes is committed at once.
struct Loner : Kept, Bench<BroadcastNode> {
  Loner() : Bench(make_config(), promises, 77) { send(channel::kRobotState, state_at(0, kHome, 0, now)); }
  static BroadcastConfig make_config() {
    BroadcastConfig config;
    config.roster = {0};
    return config;
  }
  // By the wall clock, as planners do.
  void propose(const Eigen::Vector3d& to, double seconds = 2.5) {
    const Utime start = now + 100ms;
    Trajectory trajectory = quintic_to(node.motion()->at(start), start, to, seconds);
    trajectory.shift(wall_ahead);
    candidate_t candidate{};
    candidate.header = make_header(0, 1, candidates++, now + wall_ahead);
    candidate.trajectory = trajectory.to_wire();
    send(channel::kCandidate, candidate);
  }

  std::int64_t candidates = 0;
};

// One step, when it is wanted; true when the clock's step was taken.
bool turn(Bench<BroadcastNode>& robot) {
  const bool is_asked = robot.wall_ahead != 0us;
  robot.now = robot.wake;
  robot.step();
  return is_asked && robot.wall_ahead == 0us;
}
broadcast_status_t status_of(const Bench<BroadcastNode>& robot) {
  return robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus);
}

TEST(BroadcastClock, SetpointsGoOnWhenTheWallClockIsSet) {
  for (const Duration step :
       {Duration(-5s), -5'003'217us, Duration(500ms), Duration(-1s), Duration(10s), Duration(-25ms)}) {
    SCOPED_TRACE(step.count());
    Loner robot;
    robot.run_for(0.2);
    robot.propose({2, 0, 1});
    const Utime start = robot.now;
    robot.run_for(1.0);
    const Motion motion = *robot.node.motion();
    const Utime end = motion.end_utime();
    ASSERT_GT(motion.at(robot.now).velocity.norm(), 1.0);
    robot.wall_ahead = step;
    robot.step();
    robot.propose({0, 0, 1});
    EXPECT_EQ(robot.node.rejected(Rejection::kClock), 1);

    Duration shift{};
    Utime last = robot.now, taken{};
    int setpoints = robot.out.count(channel::kSetpoint), begun_with = setpoints;
    while (robot.now - shift < start + 5s) {
      if (turn(robot)) shift = step, taken = robot.now - shift;
      if (robot.out.count(channel::kSetpoint) == setpoints) continue;
      ++setpoints;
      const auto setpoint = robot.out.newest<setpoint_t>(channel::kSetpoint);
      const Utime really = to_utime(setpoint.header.utime) - shift;
      EXPECT_LE(really - last, 20ms);
      EXPECT_LT((Eigen::Vector3d(setpoint.position) - motion.at(really).position).norm(), 1e-4);
      last = really;
    }
    EXPECT_NEAR(setpoints - begun_with, 400, 2);
    EXPECT_GE(taken, end);
    EXPECT_LE(taken, end + 10ms);
    int doubtful = 0;
    for (const auto& status : robot.out.all<broadcast_status_t>(channel::kBroadcastStatus))
      doubtful += status.state == broadcast_status_t::kClock;
    EXPECT_GE(doubtful, 1);

    // Whatever it is bound to now has begun, and survives a crash.
    const auto told = robot.out.newest<announcement_t>(channel::kOwnTrajectory);
    EXPECT_LE(to_utime(told.committed.start_utime), robot.now);
    EXPECT_EQ(load_promise(robot.promises, 0, 1).motion->seq(), told.committed.seq);
    EXPECT_EQ(status_of(robot).state, broadcast_status_t::kFlying);
    robot.propose({0, 0, 1});
    EXPECT_EQ(robot.node.protocol().commits(), 2);
    robot.run_for(3.0);
    EXPECT_LT((robot.node.motion()->at(robot.now).position - kHome).norm(), 1e-3);
  }
}

// The robot's other daemons follow the wall clock at once. An obstacle is evaded all the same: what they say, and what
// they hear of motions, is in that time; peers and setpoints do not notice.
TEST(BroadcastClock, WhatIsUrgentIsCommittedWhileItMoves) {
  for (const Duration step : {Duration(3s), Duration(-3s), Duration(-50ms), Duration(1h)}) {
    SCOPED_TRACE(step.count());
    Robot robot(0);
    robot.propose(robot.plan({2, 0, 1}));
    for (int other : {1, 2}) robot.hear_verdict(other, 2, ack_t::kAck);
    robot.run_for(1.0);
    for (int other : {1, 2}) robot.hear(other);
    ASSERT_EQ(robot.node.protocol().commits(), 1);
    robot.wall_ahead = step;
    robot.step();
    const auto ahead = [&](Trajectory trajectory) { return trajectory.shift(step), trajectory; };
    const Trajectory escape = robot.plan({1, 1, 1});
    const auto say = [&](bool urgent) {
      candidate_t candidate{};
      candidate.urgent = urgent ? 1 : 0;
      candidate.header = make_header(0, 1, 100 + (urgent ? 1 : 0), robot.now + step);
      candidate.trajectory = ahead(escape).to_wire();
      robot.send(channel::kCandidate, candidate);
    };
    say(false);
    EXPECT_EQ(robot.node.rejected(Rejection::kClock), 1);
    say(true);
    EXPECT_EQ(robot.node.rejected(Rejection::kClock), 1);
    while (robot.node.protocol().forced() == 0 && robot.now < escape.start_utime()) turn(robot);
    ASSERT_EQ(robot.node.protocol().forced(), 1);
    EXPECT_EQ(robot.wall_ahead, step) << "it moves, and is by the clock that peers know";
    const auto swarm = robot.out.newest<announcement_t>(channel::kAnnouncement, BusId::kSwarm);
    const auto onboard = robot.out.newest<announcement_t>(channel::kOwnTrajectory);
    EXPECT_EQ(swarm.pending.start_utime, to_us(escape.start_utime()));
    EXPECT_EQ(onboard.pending.start_utime, to_us(escape.start_utime() + step));
    EXPECT_EQ(onboard.committed.start_utime, swarm.committed.start_utime + step.count());
    EXPECT_EQ(onboard.header.utime, swarm.header.utime + step.count());
    EXPECT_EQ(onboard.pending_stamp, swarm.pending_stamp + step.count());

    // Multicast returns both; neither is a twin's.
    robot.send(channel::kAnnouncement, swarm, BusId::kSwarm);
    robot.send(channel::kOwnTrajectory, onboard);
    EXPECT_NE(status_of(robot).state, broadcast_status_t::kTwin);
    robot.hear(1);
    const auto relayed = robot.out.newest<announcement_t>(channel::kPeerTrajectory);
    EXPECT_EQ(relayed.header.utime, to_us(robot.now + step));
    EXPECT_EQ(relayed.committed.start_utime, to_us(robot.peers.at(1).committed.start_utime() + step));

    const Motion motion = *robot.node.motion();
    while (robot.wall_ahead != 0us && robot.now < motion.end_utime() + 1s) {
      const int setpoints = robot.out.count(channel::kSetpoint);
      turn(robot);
      if (robot.wall_ahead == 0us || robot.out.count(channel::kSetpoint) == setpoints) continue;
      const auto setpoint = robot.out.newest<setpoint_t>(channel::kSetpoint);
      EXPECT_LT((Eigen::Vector3d(setpoint.position) - motion.at(to_utime(setpoint.header.utime)).position).norm(),
                1e-4);
    }
    EXPECT_EQ(robot.wall_ahead, 0us) << "it rests";
    EXPECT_GE(robot.now - step, escape.end_utime());
    EXPECT_LT((robot.node.motion()->at(robot.now).position - Eigen::Vector3d(1, 1, 1)).norm(), 1e-3);
  }
}

// Whoever leaves its course while the clock is set is noticed: the robot's states are in the new time.
TEST(BroadcastClock, TracksTheRobotWhileTheClockIsSet) {
  Loner robot;
  robot.propose({2, 0, 1});
  robot.run_for(1.0);
  robot.wall_ahead = -5s;
  robot.step();
  auto state =
      state_at(0, robot.node.motion()->at(robot.now).position + Eigen::Vector3d(0, 0.07, 0), 1, robot.now - 5s);
  robot.send(channel::kRobotState, state);
  robot.run_for(1.0);
  EXPECT_NEAR(status_of(robot).tracking_error, 0.07, 1e-3);
}

TEST(BroadcastClock, AStepThatIsTakenBackIsForgotten) {
  Loner robot;
  robot.propose({2, 0, 1});
  robot.run_for(1.0);
  EXPECT_FALSE(robot.node.on_clock_step(robot.now, 3s));
  robot.propose({0, 0, 1});
  EXPECT_EQ(robot.node.rejected(Rejection::kClock), 1);
  EXPECT_FALSE(robot.node.on_clock_step(robot.now, 0us));
  robot.propose({0, 0, 1});
  EXPECT_EQ(robot.node.protocol().commits(), 2);
}

// A log that is played again asks nobody.
TEST(BroadcastClock, UnaskedItGoesOnAtItsRate) {
  for (const Duration step : {-5s, 10s}) {
    SCOPED_TRACE(step.count());
    Loner robot;
    robot.run_for(1.0);
    robot.now += step;
    robot.step();
    const int setpoints = robot.out.count(channel::kSetpoint), statuses = robot.out.count(channel::kBroadcastStatus);
    const int announcements = robot.out.count(channel::kOwnTrajectory);
    robot.run_for(3.0);
    EXPECT_NEAR(robot.out.count(channel::kSetpoint) - setpoints, 300, 1);
    EXPECT_NEAR(robot.out.count(channel::kBroadcastStatus) - statuses, 3, 1);
    const int due = step < 0s ? 60 : 30;  // it began to hover in the future, or long ago
    EXPECT_NEAR(robot.out.count(channel::kOwnTrajectory) - announcements, due, 1);
    for (const auto& setpoint : robot.out.all<setpoint_t>(channel::kSetpoint))
      EXPECT_LT((Eigen::Vector3d(setpoint.position) - kHome).norm(), 1e-9);
  }
}

// What peers do, they do when they did, and each must be heard again by the new clock: else a robot whose clock is
// wrong would fly through where a peer is.
TEST(BroadcastClock, PeersMoveWhenTheyDidAndAreAwaited) {
  for (const Duration step : {5s, -60s}) {
    SCOPED_TRACE(step.count());
    CommitProtocol ours({.robot_id = 0, .roster = {0, 1}}), theirs({.robot_id = 1, .roster = {0, 1}});
    ours.start({Trajectory::hover(1, kStart, kHome), {}});
    Motion flies{Trajectory::hover(1, kStart, {3, 0, 1}), {}};
    flies.next = quintic_to(flies.committed.at(kStart), kStart + 100ms, {3, 2, 1}, 2.0);
    theirs.start(flies);
    std::int64_t seq = 0;
    const auto say = [&](const CommitProtocol& from, int id, CommitProtocol* to, Utime utime) {
      announcement_t message = from.state();
      message.header = make_header(id, 1, seq++, utime);
      ASSERT_TRUE(to->is_of_roster(message));
      to->receive(utime, message, [](const announcement_t&) { return true; });
    };
    say(ours, 0, &theirs, kStart);
    say(theirs, 1, &ours, kStart);
    ASSERT_TRUE(ours.all_hear());
    const Motion before = ours.peers().at(1).motion;
    const Utime now = kStart + 1s, then = now + step;
    ours.set_clock(then, step);
    EXPECT_FALSE(ours.all_hear());
    const Motion& after = ours.peers().at(1).motion;
    for (Duration t{}; t < 3s; t += 50ms) EXPECT_EQ(after.at(then + t).position, before.at(now + t).position);
    const Trajectory plan = quintic_to(ours.motion()->at(then), then + 200ms, {1, 0, 1}, 2.0);
    EXPECT_EQ(ours.propose(then, plan), Rejection::kWaiting);
    say(theirs, 1, &ours, then);
    EXPECT_TRUE(ours.all_hear());
  }
}

// A clock that was set back, and then a crash: what was promised has been flown and is not flown again.
TEST(BroadcastClock, APromiseFromTheFutureIsNotFlownAgain) {
  Loner robot;
  robot.run_for(0.2);
  robot.propose({2, 0, 1});
  robot.run_for(0.3);
  const Eigen::Vector3d place = robot.node.motion()->at(robot.now).position;
  ASSERT_LT((place - kHome).norm(), 0.4);  // so near to where the trajectory begins that it might begin again
  Bench<BroadcastNode> again(Loner::make_config(), robot.promises, 78);
  again.now = robot.now - 60s;
  again.send(channel::kRobotState, state_at(0, place, 0, again.now));
  const Motion motion = *again.node.motion();
  for (Duration t{}; t < 70s; t += 100ms) {
    EXPECT_EQ(motion.at(again.now + t).velocity, Eigen::Vector3d::Zero());
    EXPECT_LT((motion.at(again.now + t).position - place).norm(), 1e-4);
  }
  EXPECT_GT(motion.seq(), robot.node.motion()->seq());
  EXPECT_TRUE(again.node.on_clock_step(again.now + 1s, 60s));
}

TEST(BroadcastClock, WhatIsAnnouncedIsWithdrawnWhenTheClockIsSet) {
  CommitProtocol protocol({.robot_id = 1, .roster = {0, 1}});
  protocol.start({Trajectory::hover(4, kStart, kHome), {}});
  const Trajectory plan = quintic_to(protocol.motion()->at(kStart), kStart + 500ms, {1, 0, 1}, 2.0);
  ASSERT_EQ(protocol.propose(kStart, plan, true), Rejection::kNone);
  const std::int32_t seq = protocol.pending().seq();
  (void)protocol.take_news();
  protocol.set_clock(kStart + 200ms, 100ms);
  EXPECT_TRUE(protocol.pending().empty());
  EXPECT_EQ(protocol.motion()->seq(), 4);  // over in the new time as in the old
  EXPECT_EQ(protocol.take_news(), CommitProtocol::News::kMore);
  protocol.set_clock(kStart - 5s, -5200ms);
  EXPECT_GT(protocol.motion()->seq(), seq);
  EXPECT_EQ(protocol.motion()->committed.start_utime(), kStart - 5s);
  EXPECT_LT((protocol.motion()->at(kStart).position - kHome).norm(), 1e-6);
}

TEST(BroadcastNode, CommitsNothingWhileClocksDisagree) {
  Robot robot(0);
  robot.send(channel::kAnnouncement, robot.peers.at(1).message(robot.now + 10'001us, 0), BusId::kSwarm);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.rejected(Rejection::kClock), 1);
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kClock);
  robot.run_for(0.001);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
}

// What was recorded before a clock was set back and is played again comes from the future, but says nothing new; nor
// does it make anybody doubt.
TEST(BroadcastNode, RecordedAnnouncementsRaiseNoDoubt) {
  Robot robot(0);
  const Bytes recorded = packed(robot.peers.at(1).message(robot.now + 30s, 0));
  ++robot.peers.at(1).boot;
  robot.peers.at(1).seq = 0;
  robot.hear(1);
  for (int i = 0; i < 100; ++i) {
    robot.deliver(BusId::kSwarm, channel::kAnnouncement, recorded);
    robot.run_for(0.01);
  }
  EXPECT_EQ(robot.node.refused()[Refusal::kSequence], 100);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
}

// A peer whose clock is behind or ahead is found out though its messages take longer than that; delays alone are not.
TEST(BroadcastNode, CommitsNothingWhileAPeersClockIsWrong) {
  for (const Duration ahead : {-20ms, 0ms, 20ms}) {
    SCOPED_TRACE(to_ms(ahead));
    Robot robot(0, false);
    robot.peers_agree = false;
    robot.send_state();
    robot.hear(2);
    constexpr Duration kDelay = 30ms;
    const auto agree = [&] {
      for (const int other : {1, 2})
        robot.peers.at(other).about_us = {kBoot, robot.node.protocol().pending().seq(), ack_t::kAck};
      robot.send(channel::kAnnouncement, robot.peers.at(1).message(robot.now + ahead - kDelay, 0), BusId::kSwarm);
      robot.hear(2);
    };
    for (int i = 0; i < 3 * ClockOffset::kEnough; ++i) {
      Peer& peer = robot.peers.at(1);
      peer.least_delay_us = static_cast<std::int32_t>((kDelay + ahead).count());  // of our announcements
      const Utime sent = robot.now + ahead - kDelay;
      robot.send(channel::kAnnouncement, peer.message(sent, 0), BusId::kSwarm);
      robot.run_for(0.02);
    }
    const auto status = robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus);
    EXPECT_NEAR(status.max_clock_offset_ms, std::abs(to_ms(ahead)), 1e-3);
    EXPECT_EQ(status.state, ahead == 0us ? broadcast_status_t::kFlying : broadcast_status_t::kClock);
    robot.propose(robot.plan({1, 0, 1}));
    if (ahead == 0us) agree();
    EXPECT_EQ(robot.node.rejected(Rejection::kClock), ahead == 0us ? 0 : 1);
    EXPECT_EQ(robot.node.protocol().commits(), ahead == 0us ? 1 : 0);
    robot.run_for(0.3);
    robot.propose(robot.plan({1, 0, 1}), true);  // the last resort
    if (ahead == 0us) agree();
    robot.run_for(0.1);
    EXPECT_EQ(robot.node.protocol().forced(), ahead == 0us ? 0 : 1);
    std::vector<std::int32_t> told;
    for (const announcement_t& message : robot.out.all<announcement_t>(channel::kAnnouncement, BusId::kSwarm)) {
      if (message.header.seq % 3 == 1) {
        told.push_back(message.least_delay_us);
      } else {
        EXPECT_EQ(message.least_delay_us, announcement_t::kUnknown);
      }
    }
    EXPECT_EQ(told.front(), announcement_t::kUnknown);
    EXPECT_EQ(Duration(told.back()), kDelay - ahead);
  }
}

// Nothing that a peer promised is known by a clock that is wrong. But where it is, is: the planner is told in our time.
TEST(BroadcastNode, PlannersHearWherePeersAreWhoseClocksAreWrong) {
  for (const Duration ahead : {Duration(3600s), Duration(50ms), Duration(-3600s), Duration(-3s)}) {
    SCOPED_TRACE(to_ms(ahead));
    Robot robot(0);
    robot.run_for(0.1);
    Peer& peer = robot.peers.at(1);
    const int relayed = robot.out.count(channel::kPeerTrajectory);
    const Motion known = robot.node.protocol().peers().at(1).motion;
    const Trajectory moves = quintic_to(known.at(robot.now), robot.now, {21, 0, 1}, 2.0);
    peer.committed = moves;
    peer.committed.shift(ahead);
    const announcement_t message = peer.message(robot.now + ahead, 0);
    robot.send(channel::kAnnouncement, message, BusId::kSwarm);
    robot.run_for(0.01);
    EXPECT_EQ(robot.node.refused()[Refusal::kTime], 1);
    EXPECT_TRUE(same(robot.node.protocol().peers().at(1).motion.committed.to_wire(), known.committed.to_wire()));
    if (ahead == -3s) {  // that may be the network
      EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), relayed);
      continue;
    }
    ASSERT_EQ(robot.out.count(channel::kPeerTrajectory), relayed + 1);
    const auto told = robot.out.newest<announcement_t>(channel::kPeerTrajectory);
    EXPECT_TRUE(same(told.committed, moves.to_wire()));
    EXPECT_EQ(to_utime(told.header.utime), robot.now - 10ms);
    EXPECT_EQ(std::pair(told.header.boot, told.header.seq), std::pair(message.header.boot, message.header.seq));
    robot.send(channel::kAnnouncement, message, BusId::kSwarm);  // again
    robot.run_for(0.01);
    EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), relayed + 1);
  }
}

// Whose own clock was set hears all others elsewhen.
TEST(BroadcastNode, PlannersHearWherePeersAreAfterTheirClockWasSet) {
  Robot robot(0);
  robot.run_for(0.1);
  robot.wall_ahead = 3s;
  for (int i = 0; robot.wall_ahead != 0us; ++i) {
    ASSERT_LT(i, 100);
    robot.now = robot.wake;
    robot.step();
  }
  const auto hear_late = [&] {
    robot.run_for(0.1);
    robot.send(channel::kAnnouncement, robot.peers.at(1).message(robot.now - 3s, 0), BusId::kSwarm);
    robot.run_for(0.01);
    return robot.out.count(channel::kPeerTrajectory);
  };
  const int relayed = robot.out.count(channel::kPeerTrajectory);
  EXPECT_EQ(hear_late(), relayed + 1);
  robot.run_for(10.0);
  EXPECT_EQ(hear_late(), relayed + 1);
}

// What was announced before a clock was found wrong is not committed after it.
TEST(BroadcastNode, WhatWaitsIsNotCommittedWhileClocksDisagree) {
  for (const bool disagree : {false, true}) {
    Robot robot(1);
    robot.propose(robot.plan({1, 0, 1}, 0.5));
    if (disagree) robot.send(channel::kAnnouncement, robot.peers.at(2).message(robot.now + 20ms, 1), BusId::kSwarm);
    if (!disagree) robot.hear_verdict(2, 2, ack_t::kAck);
    robot.hear_verdict(0, 2, ack_t::kAck);
    EXPECT_EQ(robot.node.protocol().commits(), disagree ? 0 : 1);
  }
}

}  // namespace
}  // namespace swarm::test
