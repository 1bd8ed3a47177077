// The last resort: what is committed without everybody's word, and how robots part that came too close by it.
#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

TEST(BroadcastNode, WhatIsUrgentIsCommittedAtTheLastMomentWithoutAnAnswer) {
  Robot robot(1);
  const Trajectory flight = robot.plan({1, 0, 1}, 0.5);
  robot.propose(flight, true);
  robot.run_until(flight.start_utime() - 10'100us);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kAnnounced);
  robot.run_until(flight.start_utime() - 9'900us);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kCommitted);
  EXPECT_EQ(robot.announced().forced_seq, 2);
  EXPECT_EQ(robot.node.motion()->next.start_utime(), flight.start_utime());
  robot.run_for(1.0);
  EXPECT_EQ(robot.node.motion()->committed.seq(), 2);
  const auto status = robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus);
  EXPECT_EQ(status.forced, 1);
  EXPECT_EQ(status.commits, 1);
  EXPECT_EQ(robot.announced().forced_seq, 2);

  Robot after(1, false, robot.promises, kBoot);  // nor is it forgotten in a crash
  after.now = robot.now;
  after.send(channel::kRobotState, state_at(1, {1, 0, 1}, 0, after.now));
  EXPECT_EQ(after.announced().forced_seq, 2);
}

TEST(BroadcastNode, WhatIsUrgentIsNotForcedWhenPeersAgreeInTime) {
  Robot robot(1);
  robot.propose(robot.plan({1, 0, 1}, 0.5), true);
  robot.agree();
  robot.run_for(0.05);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kCommitted);
  EXPECT_EQ(robot.announced().forced_seq, 0);
  EXPECT_EQ(robot.node.protocol().forced(), 0);
}

TEST(BroadcastNode, WhatIsUrgentKeepsOffEverythingKnown) {
  for (const bool known : {false, true}) {  // that the holder wants to pass there: nobody has promised it
    Robot robot(1);
    Peer& holder = robot.peers.at(0);
    const Trajectory flight = robot.plan({1, 0, 1}, 0.5);
    robot.propose(flight, true);
    if (known) {
      holder.pends(quintic_to(holder.committed.at(robot.now), robot.now + 600ms, {1, 0.1, 1}, 2.0), robot.now + 1us);
      robot.hear(0);
    }
    const int steps = robot.steps;
    robot.run_until(flight.start_utime());
    EXPECT_LT(robot.steps, steps + 200);  // it does not try over and over
    EXPECT_EQ(robot.node.protocol().forced(), known ? 0 : 1);
    EXPECT_EQ(robot.node.protocol().withdrawn(), known ? 1 : 0);
  }
}

// Nobody has been heard since the start, and something comes.
TEST(BroadcastNode, WhatIsUrgentWaitsForNoStrangers) {
  Robot robot(1, false);
  robot.send_state();
  robot.propose(robot.plan({1, 0, 1}, 0.3));
  EXPECT_EQ(robot.node.rejected(Rejection::kWaiting), 1);
  robot.propose(robot.plan({1, 0, 1}, 0.3), true);
  robot.run_for(0.3);
  EXPECT_EQ(robot.node.protocol().forced(), 1);
}

// A forced motion may have ended closer than it should: nobody is stuck there, as long as they do not get nearer.
TEST(BroadcastNode, RobotsThatAreTooCloseMayPart) {
  Robot robot(0);
  robot.peers.at(1).committed = Trajectory::hover(2, robot.now, {0.41, 0, 1});
  robot.hear(1);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.rejected(Rejection::kConflict), 1);
  robot.propose(robot.plan({-1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  EXPECT_EQ(robot.node.protocol().forced(), 0);
}

}  // namespace
}  // namespace swarm::test
