// Whom the broadcast daemon takes for whom: later starts of its robot, and others that speak as it.
#include <gtest/gtest.h>

#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

// The disk lost what was promised, or the clock was set back: peers know later starts of this robot than this one, and
// would refuse it as an old one.
TEST(BroadcastIdentity, StartsAgainWherePeersKnowALaterStart) {
  Robot robot(0, false);
  robot.send_state();
  robot.peers.at(1).about_us.peer_boot = kBoot + 5;
  robot.peers.at(2).about_us.peer_boot = kBoot + 9;
  robot.hear(1);
  EXPECT_EQ(robot.announced().header.boot, kBoot + 6);
  robot.hear(2);
  robot.hear(2);  // has not heard of it yet
  const announcement_t said = robot.announced();
  EXPECT_EQ(said.header.boot, kBoot + 10);
  EXPECT_EQ(load_promise(robot.promises, 0, 1).boot, kBoot + 11);
  robot.send(channel::kAnnouncement, said, BusId::kSwarm);  // multicast returns it
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.rejected(Rejection::kWaiting), 1);
  for (const int id : {1, 2}) {
    robot.peers.at(id).about_us.peer_boot = kBoot + 10;
    robot.hear(id);
  }
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  EXPECT_EQ(robot.announced().header.boot, kBoot + 10);
  // It has flown, so it was known: somebody else is taken for it.
  robot.peers.at(1).about_us.peer_boot = kBoot + 11;
  robot.hear(1);
  robot.run_for(1.0);
  EXPECT_EQ(robot.announced().header.boot, kBoot + 10);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kTwin);
}

TEST(BroadcastIdentity, DoesNotRaceATwinForTheLaterStart) {
  Robot robot(0, false);
  robot.send_state();
  for (int i = 0; i < 10; ++i) {
    robot.peers.at(1).about_us.peer_boot = robot.announced().header.boot + 1;
    robot.hear(1);
  }
  EXPECT_EQ(robot.announced().header.boot, kBoot + 4);  // two peers, two starts
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kTwin);
}

// A copied memory card, a wrong id, a second set of daemons: whoever speaks under this robot's id.
TEST(BroadcastIdentity, CommitsNothingBesideATwin) {
  Robot robot(1);
  robot.run_for(1.0);
  const auto state = [&] { return robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state; };
  Peer twin{1, Trajectory::hover(1, kStart, {3, 3, 1})};
  // Neither are the own announcements, which multicast returns, nor what an earlier start sent before this one.
  for (const auto& own : robot.out.all<announcement_t>(channel::kAnnouncement, BusId::kSwarm))
    robot.send(channel::kAnnouncement, own, BusId::kSwarm);
  twin.boot = kBoot - 1;
  robot.send(channel::kAnnouncement, twin.message(kStart - 1ms, 1), BusId::kSwarm);
  robot.run_for(1.0);
  EXPECT_EQ(state(), broadcast_status_t::kFlying);
  for (const std::int32_t boot : {kBoot - 1, kBoot, kBoot + 1}) {  // the same: two clones started at once
    SCOPED_TRACE(boot);
    twin.boot = boot;
    robot.hear(0), robot.hear(2);
    robot.propose(robot.plan({1, 0, 1}));
    const std::int32_t seq = robot.announced().pending.seq;
    robot.send(channel::kAnnouncement, twin.message(robot.now, 1), BusId::kSwarm);
    const std::int32_t commits = robot.node.protocol().commits(), rejected = robot.node.rejected(Rejection::kTwin);
    robot.hear_verdict(0, seq, ack_t::kAck), robot.hear_verdict(2, seq, ack_t::kAck);
    robot.run_for(1.0);
    EXPECT_EQ(state(), broadcast_status_t::kTwin);
    robot.propose(robot.plan({1, 0, 1}), true);
    robot.run_for(0.3);
    EXPECT_EQ(robot.node.rejected(Rejection::kTwin), rejected + 1);
    EXPECT_EQ(robot.node.protocol().commits(), commits);
    const int setpoints = robot.out.count(channel::kSetpoint);
    robot.run_for(1.0);
    EXPECT_EQ(robot.out.count(channel::kSetpoint), setpoints + 100) << "on another bus, they lead another robot";
    robot.run_for(1.0);
    EXPECT_EQ(state(), broadcast_status_t::kFlying) << "the twin is gone";
  }
}

TEST(BroadcastIdentity, OfTwoOnOneBusTheOlderLeadsTheRobot) {
  for (const std::int32_t boot : {kBoot - 1, kBoot + 1}) {
    SCOPED_TRACE(boot);
    Robot robot(1);
    robot.run_for(1.0);
    Peer twin{1, Trajectory::hover(1, kStart, {3, 3, 1})};
    twin.boot = boot;
    robot.send(channel::kOwnTrajectory, twin.message(robot.now, 1));
    const int setpoints = robot.out.count(channel::kSetpoint);
    robot.run_for(1.0);
    EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kTwin);
    EXPECT_EQ(robot.out.count(channel::kSetpoint) - setpoints, boot < kBoot ? 0 : 100);
    robot.run_for(3.0);
    EXPECT_GE(robot.out.count(channel::kSetpoint) - setpoints, 200) << "the twin is gone";
  }
}

// For as long as it would have been by the old clock.
TEST(BroadcastIdentity, ATwinIsForgottenInTimeWhereTheClockIsSetBack) {
  Robot robot(1);
  robot.run_for(1.0);
  Peer twin{1, Trajectory::hover(1, kStart, {3, 3, 1})};
  twin.boot = kBoot - 1;
  robot.send(channel::kOwnTrajectory, twin.message(robot.now, 1));
  robot.run_for(1.9);
  const int setpoints = robot.out.count(channel::kSetpoint);
  robot.wall_ahead = -5s;
  robot.step();
  robot.run_for(0.2);
  EXPECT_NEAR(robot.out.count(channel::kSetpoint) - setpoints, 10, 2);
}

}  // namespace
}  // namespace swarm::test
