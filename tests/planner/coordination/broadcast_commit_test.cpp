// The commit protocol, turn by turn: who answers what, when something is committed, and what is kept over a restart.
#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

TEST(BroadcastNode, HolderCommitsWhenAMajorityHasJudged) {
  Robot robot(0);
  robot.peers_agree = false;
  robot.run_for(0.001);
  robot.out.letters.clear();
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  const auto announced = robot.out.all<announcement_t>(channel::kAnnouncement, BusId::kSwarm);
  ASSERT_EQ(announced.size(), 1u);
  EXPECT_EQ(announced[0].pending_state, announcement_t::kAnnounced);
  EXPECT_EQ(announced[0].pending.seq, 2);
  EXPECT_EQ(to_utime(announced[0].header.utime), robot.now);
  robot.hear(1);
  robot.hear_verdict(1, 1, ack_t::kAck);  // of something older
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  robot.out.letters.clear();
  robot.hear_verdict(2, 2, ack_t::kNack);  // against which it has the right of way
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  // Nobody waits for that but the planner.
  EXPECT_EQ(robot.out.count(channel::kAnnouncement, BusId::kSwarm), 0);
  const auto own = robot.out.all<announcement_t>(channel::kOwnTrajectory);
  ASSERT_EQ(own.size(), 1u);
  EXPECT_EQ(own[0].pending_state, announcement_t::kCommitted);
  EXPECT_EQ(to_utime(own[0].header.utime), robot.now);
}

TEST(BroadcastNode, AskerCommitsOnTheHoldersAckOnly) {
  Robot robot(1);
  const Utime stamp = robot.now;
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  announcement_t message = robot.announced();
  EXPECT_EQ(message.pending_state, announcement_t::kAnnounced);
  EXPECT_EQ(to_utime(message.pending_stamp), stamp);
  const std::int32_t seq = message.pending.seq;
  robot.run_for(0.1);
  robot.hear(0);                                       // no verdict
  robot.hear_verdict(2, seq, ack_t::kAck);             // not the holder
  robot.hear_verdict(0, seq - 1, ack_t::kAck);         // of something older
  robot.hear_verdict(0, seq, ack_t::kAck, kBoot - 1);  // of what an earlier start announced
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  EXPECT_TRUE(robot.node.motion()->next.empty());
  robot.hear_verdict(0, seq, ack_t::kAck);
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  robot.run_for(0.05);
  message = robot.announced();
  EXPECT_EQ(message.pending_state, announcement_t::kCommitted);
  EXPECT_EQ(message.pending.seq, seq);
}

TEST(BroadcastNode, AcksAreVoidWhenTheHolderRestarts) {
  Robot robot(1);
  robot.hear_verdict(0, 2, ack_t::kAck);  // ahead of time: the peer forgets it with its restart
  Peer& holder = robot.peers.at(0);
  holder.about_us = {kBoot, 0, ack_t::kNone};
  ++holder.boot;
  robot.hear(0);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.announced().pending.seq, 2);
  EXPECT_EQ(robot.node.protocol().commits(), 0);
}

TEST(BroadcastNode, HoldersNackWithdrawsAndAskersNackDoesNot) {
  Robot robot(1);
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  robot.hear_verdict(2, 2, ack_t::kNack);
  EXPECT_EQ(robot.node.protocol().withdrawn(), 0);
  EXPECT_EQ(robot.announced().pending.seq, 2);
  robot.hear_verdict(0, 2, ack_t::kNack);
  EXPECT_EQ(robot.node.protocol().withdrawn(), 1);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kNone);
  robot.hear_verdict(0, 2, ack_t::kAck);  // too late: a number is never used again
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  EXPECT_EQ(robot.announced().pending.seq, 3);
  EXPECT_EQ(robot.node.protocol().commits(), 0);
}

TEST(BroadcastNode, WithdrawsAtTheBranchTime) {
  Robot robot(1);
  const Trajectory flight = robot.plan({1, 0, 1}, 0.123456);
  robot.propose(flight);
  robot.run_until(flight.start_utime() - 60us);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kAnnounced);
  robot.run_until(flight.start_utime());
  EXPECT_EQ(robot.node.protocol().withdrawn(), 1);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kNone);
  EXPECT_EQ(to_utime(robot.announced().header.utime), flight.start_utime());
  robot.hear_verdict(0, 2, ack_t::kAck);
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  EXPECT_EQ(robot.node.motion()->committed.seq(), 1);
}

TEST(BroadcastNode, ANewerPlanReplacesTheOneThatWaits) {
  Robot robot(1);
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  robot.propose(robot.plan({0, 1, 1}, 0.5));
  EXPECT_EQ(robot.node.protocol().withdrawn(), 1);
  robot.hear_verdict(0, 2, ack_t::kAck);
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  robot.agree();
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  EXPECT_EQ(robot.node.motion()->end_utime(), robot.now + 2500ms);
}

TEST(BroadcastNode, JudgesAtOnceAndForGood) {
  Robot robot(0);
  Peer& peer = robot.peers.at(1);
  const MotionState from = peer.committed.at(kStart);
  const auto judged = [&](const Eigen::Vector3d& to, Utime start) {
    const std::int32_t seq = peer.pending.seq() + 1;
    peer.pends(quintic_to(from, start, to, 9, 5, seq - 100), robot.now);
    robot.run_for(0.001);
    const int before = robot.out.count(channel::kAnnouncement, BusId::kSwarm);
    robot.hear(1);
    EXPECT_EQ(robot.out.count(channel::kAnnouncement, BusId::kSwarm), before + 1);
    EXPECT_EQ(robot.verdict_on(1).judged_seq, seq);
    EXPECT_EQ(robot.verdict_on(1).peer_boot, peer.boot);
    return robot.verdict_on(1).verdict;
  };
  const Utime soon = robot.now + 100ms;
  EXPECT_EQ(judged({20, 5, 1}, robot.now - to_duration(BroadcastConfig().clock_error_s)),
            ack_t::kNack);  // has begun already, by any clock
  EXPECT_EQ(judged({20, 5, 1}, robot.now), ack_t::kAck);
  EXPECT_EQ(judged({0.41, 0, 1}, soon), ack_t::kNack);  // radii and 2 cm
  EXPECT_EQ(judged({-1.0, 0, 1}, soon), ack_t::kNack);  // ends clear, but passes through
  EXPECT_EQ(judged({0.43, 0, 1}, soon), ack_t::kAck);
  robot.run_for(0.2);  // late by now, but it has its ack
  robot.hear(1);
  EXPECT_EQ(robot.verdict_on(1).verdict, ack_t::kAck);
  EXPECT_EQ(robot.verdict_on(2).judged_seq, 0);
  EXPECT_EQ(robot.verdict_on(2).verdict, ack_t::kNone);
}

TEST(BroadcastNode, TheOlderOfTwoPendingTrajectoriesWins) {
  struct Case {
    Duration stamp_difference;  // theirs minus ours
    int rival;
    bool we_win;
  };
  for (const Case& c : {Case{-1us, 2, false}, {1us, 2, true}, {0us, 2, true}, {0us, 0, false}, {1us, 0, true}}) {
    SCOPED_TRACE(testing::Message() << c.stamp_difference.count() << " us, robot " << c.rival);
    Robot robot(1);
    robot.propose(robot.plan({1, 0, 1}, 0.5));
    Peer& rival = robot.peers.at(c.rival);
    const Utime stamp = robot.now + c.stamp_difference;
    rival.pends(quintic_to(rival.committed.at(kStart), robot.now + 400ms, {1.2, 0, 1}, 9), stamp);
    robot.hear(c.rival);
    robot.run_for(0.02);  // with the next repetition: nobody waits for a verdict on what goes by right of way
    EXPECT_EQ(robot.verdict_on(c.rival).verdict, c.we_win ? ack_t::kNack : ack_t::kAck);
    EXPECT_EQ(robot.node.protocol().withdrawn(), c.we_win ? 0 : 1);
    EXPECT_EQ(robot.announced().pending.seq, c.we_win ? 2 : 0);
  }
  Robot robot(1);  // without conflict both go on
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  Peer& other = robot.peers.at(2);
  other.pends(quintic_to(other.committed.at(kStart), robot.now + 400ms, {5, 0, 1}, 9), robot.now - 1us);
  robot.hear(2);
  EXPECT_EQ(robot.verdict_on(2).verdict, ack_t::kAck);
  EXPECT_EQ(robot.announced().pending.seq, 2);
}

TEST(BroadcastNode, APromiseBindsUntilItIsNoLongerShown) {
  Robot robot(0);
  Peer& peer = robot.peers.at(1);
  peer.pends(quintic_to(peer.committed.at(kStart), robot.now + 200ms, {1.2, 0, 1}, 9), robot.now);
  robot.hear(1);
  ASSERT_EQ(robot.verdict_on(1).verdict, ack_t::kAck);
  robot.run_for(3.0);  // time does not free it
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  EXPECT_EQ(robot.node.rejected(Rejection::kConflict), 1);
  peer.pends_nothing();
  robot.hear(1);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
}

TEST(BroadcastNode, HolderDoesNotCommitAgainstWhatAnAskerCommittedMeanwhile) {
  Robot robot(1);  // asks 0, holds against 2
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  Peer& asker = robot.peers.at(2);
  const Trajectory flight = quintic_to(asker.committed.at(kStart), robot.now + 100ms, {1.2, 0, 1}, 9);
  asker.pends(flight, robot.now - 1us, announcement_t::kCommitted);
  robot.hear(2);
  robot.hear_verdict(0, 2, ack_t::kAck);
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  robot.run_for(0.6);
  EXPECT_EQ(robot.node.protocol().withdrawn(), 1);
}

TEST(BroadcastNode, GoesOnAfterARestartWithWhatItPromised) {
  Robot before(0);
  before.propose(before.plan({1, 0, 1}, 0.1));
  before.run_for(0.05);
  ASSERT_EQ(before.node.protocol().commits(), 1);
  const Motion promised = *before.node.motion();

  Robot after(0, false, before.promises, kBoot);
  after.now = before.now;
  after.send_state();
  EXPECT_TRUE(same(after.node.motion()->committed.to_wire(), promised.committed.to_wire()));
  EXPECT_TRUE(same(after.node.motion()->next.to_wire(), promised.next.to_wire()));
  EXPECT_EQ(after.announced().header.boot, kBoot + 1);

  // Nothing is committed before every peer has echoed the new start.
  after.run_for(0.1);
  for (const int other : {1, 2}) after.hear(other);
  after.propose(after.plan({0, 1, 1}));
  EXPECT_EQ(after.node.rejected(Rejection::kWaiting), 1);
  for (const int other : {1, 2}) {
    after.peers.at(other).about_us.peer_boot = kBoot + 1;
    after.hear(other);
  }
  after.propose(after.plan({0, 1, 1}));
  EXPECT_EQ(after.node.protocol().commits(), 1);
  EXPECT_GT(after.node.motion()->next.seq(), promised.next.seq());

  Robot carried(0, false, before.promises, kBoot);  // it stands somewhere else
  carried.send(channel::kRobotState, state_at(0, {5, 0, 1}, 0, carried.now));
  EXPECT_EQ(carried.node.motion()->at(carried.now).position, Eigen::Vector3d(5, 0, 1));
  EXPECT_GT(carried.node.motion()->committed.seq(), promised.next.seq());
  EXPECT_EQ(carried.announced().header.boot, kBoot + 1);

  Robot other(1, false, before.promises, kBoot);  // another robot's promise is none of ours
  other.send_state();
  EXPECT_EQ(other.announced().header.boot, kBoot);
}

TEST(BroadcastNode, CommitsNothingThatItCannotKeep) {
  struct FullDisk : MemoryPromiseStore {
    bool save(std::span<const std::uint8_t> bytes) override { return !full && MemoryPromiseStore::save(bytes); }
    bool full = false;
  } disk;
  Bench<BroadcastNode> robot(
      [] {
        BroadcastConfig config = Robot::make_config(0);
        config.roster.clear();
        return config;
      }(),
      disk, kBoot);
  robot.send(channel::kRobotState, state_at(0, {0, 0, 1}, 0, robot.now));
  std::int64_t seq = 0;
  const auto propose = [&] {
    candidate_t candidate{};
    candidate.header = make_header(0, 1, seq++, robot.now);
    const Utime start = robot.now + 100ms;
    candidate.trajectory = quintic_to(robot.node.motion()->at(start), start, {1, 0, 1}, 2.0).to_wire();
    robot.send(channel::kCandidate, candidate);
  };
  disk.full = true;
  propose();
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  EXPECT_EQ(robot.node.protocol().withdrawn(), 1);
  EXPECT_TRUE(robot.node.motion()->next.empty());
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kNoStorage);
  EXPECT_EQ(robot.node.activity(robot.now).text, "commits nothing: --state-dir : cannot be written");
  disk.full = false;
  propose();
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kFlying);
}

}  // namespace
}  // namespace swarm::test
