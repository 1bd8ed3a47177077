// Robots that were given another roster: drawn for the planner and kept off, but neither answered nor waited for.
#include "planner_daemon/coordination/strangers.h"

#include "lcmtypes/bus/limits.h"
#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

// Announces that it hovers at `place`, with a roster of itself alone.
announcement_t stranger(int id, std::int64_t seq, Utime utime, const Eigen::Vector3d& place) {
  Peer peer{id, Trajectory::hover(1, kStart, place)};
  peer.seq = seq;
  announcement_t message = peer.message(utime, 0);
  message.roster_crc = 1;
  message.num_acks = 1;
  message.acks.assign(1, {-1, 0, ack_t::kNone});
  return message;
}

TEST(Strangers, AreDrawnAndKeptOffButNotWaitedFor) {
  Robot robot(0);
  robot.send(channel::kAnnouncement, stranger(7, 0, robot.now, {1, 0, 1}), BusId::kSwarm);
  robot.run_for(0.001);
  const auto drawn = robot.out.newest<announcement_t>(channel::kPeerTrajectory);
  EXPECT_EQ(drawn.header.robot_id, 7);
  EXPECT_EQ(drawn.committed.knots[0][0], 1.0);
  robot.propose(robot.plan({2, 0, 1}, 0.1, 4.0));
  EXPECT_EQ(robot.node.rejected(Rejection::kConflict), 1) << "that leads through it";
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  robot.propose(robot.plan({0, 2, 1}, 0.1, 4.0));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  EXPECT_EQ(robot.node.activity(robot.now).text,
            "ready: commits what the planner sends and robots agree to; keeps off strangers 7, who are given another "
            "roster");
}

TEST(Strangers, WhatIsPendingIsNotCommittedIntoOne) {
  Robot robot(2);
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  const std::int32_t seq = robot.announced().pending.seq;
  robot.send(channel::kAnnouncement, stranger(7, 0, robot.now, {1, 0, 1}), BusId::kSwarm);
  robot.hear_verdict(0, seq, ack_t::kAck), robot.hear_verdict(1, seq, ack_t::kAck);
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  robot.send(channel::kAnnouncement, stranger(7, 1, robot.now, {1, 5, 1}), BusId::kSwarm);
  EXPECT_EQ(robot.node.protocol().commits(), 1) << "it has gone on";
}

TEST(Strangers, OldAndForeignTimesChangeNothing) {
  Robot robot(0);
  const auto hear = [&](std::int64_t seq, Duration late, const Eigen::Vector3d& place) {
    robot.send(channel::kAnnouncement, stranger(7, seq, robot.now - late, place), BusId::kSwarm);
  };
  hear(5, 2s, {1, 0, 1}), hear(5, -1s, {1, 0, 1});
  EXPECT_EQ(robot.node.refused()[Refusal::kTime], 2);
  hear(5, 0s, {9, 0, 1}), hear(5, 0s, {1, 0, 1}), hear(4, 0s, {1, 0, 1});
  EXPECT_EQ(robot.node.refused()[Refusal::kSequence], 2);
  robot.propose(robot.plan({2, 0, 1}, 0.1, 4.0));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
}

TEST(Strangers, AreOnlySoMany) {
  Robot robot(0);
  for (int id = 10; id < 10 + kMaxStrangers + 3; ++id)
    robot.send(channel::kAnnouncement, stranger(id, 0, robot.now, {id + 0.0, 40, 1}), BusId::kSwarm);
  EXPECT_EQ(robot.node.refused()[Refusal::kRobot], 3);
  robot.run_for(0.05);
  int drawn = 0;
  for (const announcement_t& message : robot.out.all<announcement_t>(channel::kPeerTrajectory))
    drawn += message.header.robot_id >= 10 ? 1 : 0;
  EXPECT_EQ(drawn, kMaxStrangers);
}

TEST(Strangers, AreToldToThePlannerNoMoreOftenThanItNeeds) {
  Robot robot(0);
  for (int seq = 0; seq < 100; ++seq) {
    robot.send(channel::kAnnouncement, stranger(7, seq, robot.now, {5, seq / 100.0, 1}), BusId::kSwarm);
    robot.run_for(0.001);
  }
  robot.run_for(0.05);
  std::vector<announcement_t> drawn = robot.out.all<announcement_t>(channel::kPeerTrajectory);
  std::erase_if(drawn, [](const announcement_t& message) { return message.header.robot_id != 7; });
  EXPECT_GE(drawn.size(), 5u);
  EXPECT_LE(drawn.size(), 7u);
  EXPECT_NEAR(drawn.back().committed.knots[0][1], 0.99, 1e-4) << "the newest";
}

// A planner that started since knows nothing of those that have fallen silent.
TEST(Strangers, AreToldAgainWhenTheyAreSilent) {
  Robot robot(0);
  robot.send(channel::kAnnouncement, stranger(7, 0, robot.now, {5, 0, 1}), BusId::kSwarm);
  robot.run_for(5.0);
  robot.out.letters.clear();
  robot.run_for(1.0);
  const auto drawn = robot.out.newest<announcement_t>(channel::kPeerTrajectory);
  EXPECT_EQ(drawn.header.robot_id, 7);
  EXPECT_NEAR(to_seconds(robot.now - to_utime(drawn.header.utime)), 0.0, 0.6);
}

// It crosses the robot's way after four seconds, by whatever clock.
TEST(Strangers, MoveWhenTheyDidThoughTheClockIsSet) {
  for (const Duration step : {0us, Duration(3s), Duration(-3s)}) {
    Robot robot(0);
    MotionState from;
    from.position = {2, -8, 1};
    announcement_t message = stranger(7, 0, robot.now, from.position);
    message.committed = quintic_to(from, robot.now, {2, 8, 1}, 8.0).to_wire();
    robot.send(channel::kAnnouncement, message, BusId::kSwarm);
    robot.run_for(1.0);
    robot.wall_ahead = step;
    robot.step();
    robot.propose(robot.plan({4, 0, 1}, 0.1, 5.8), true);
    EXPECT_EQ(robot.node.rejected(Rejection::kConflict), 1) << to_seconds(step);
    robot.propose(robot.plan({4, 0, 1}, 0.1, 2.0), true);
    EXPECT_EQ(robot.node.rejected(Rejection::kConflict), 1) << to_seconds(step);
  }
}

TEST(Strangers, WhoIsWaitedForMayBeOne) {
  Robot robot(0, false);
  robot.send_state();
  robot.hear(2);
  robot.send(channel::kAnnouncement, stranger(1, 0, robot.now, {5, 0, 1}), BusId::kSwarm);
  EXPECT_EQ(robot.node.activity(robot.now).text, "waits for robots 1 (is given another roster)");
  robot.peers.at(1).boot = 10;  // it is started again, with the right one
  robot.hear(1);
  EXPECT_EQ(robot.node.activity(robot.now).text, "ready: commits what the planner sends and robots agree to");
  robot.propose(robot.plan({5, 0, 1}, 0.1, 6.0));
  EXPECT_EQ(robot.node.protocol().commits(), 1) << "it is not where it was";
}

TEST(Strangers, APeerIsNoneBeforeItStartsAgain) {
  Robot robot(0);
  announcement_t message = stranger(1, 100, robot.now, {1, 0, 1});
  robot.send(channel::kAnnouncement, message, BusId::kSwarm);
  EXPECT_EQ(robot.node.refused()[Refusal::kRobot], 1);
  ++message.header.boot;
  robot.send(channel::kAnnouncement, message, BusId::kSwarm);
  EXPECT_EQ(robot.node.refused()[Refusal::kRobot], 1);
  robot.propose(robot.plan({2, 0, 1}, 0.1, 4.0));
  EXPECT_EQ(robot.node.rejected(Rejection::kConflict), 1);
}

}  // namespace
}  // namespace swarm::test
