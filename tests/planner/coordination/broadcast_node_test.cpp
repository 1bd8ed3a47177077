// The commit protocol, turn by turn: one node among peers whose announcements the test writes. Long because every state
// and message of the protocol has its turn.
#include "planner_daemon/coordination/broadcast_node.h"

#include <cmath>
#include <map>
#include <numbers>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/crc32.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;
using sogm_swarm::broadcast_status_t;
using sogm_swarm::candidate_t;
using sogm_swarm::robot_state_t;
using sogm_swarm::setpoint_t;
using sogm_swarm::trajectory_t;

constexpr std::int32_t kBoot = 77;
constexpr std::uint8_t kRosterIds[] = {0, 0, 0, 1, 0, 2};
const auto kRosterCrc = static_cast<std::int32_t>(crc32(kRosterIds));

bool same(const trajectory_t& a, const trajectory_t& b) {
  return a.seq == b.seq && a.start_utime == b.start_utime && a.piece_us == b.piece_us && a.num_pieces == b.num_pieces &&
         std::equal(&a.knots[0][0], &a.knots[0][0] + 11 * 9, &b.knots[0][0]);
}

// A peer as its announcements show it.
struct Peer {
  int id;
  Trajectory committed;
  Trajectory pending = {};
  std::int8_t pending_state = announcement_t::kNone;
  std::int64_t stamp = 0;
  ack_t about_us{kBoot, 0, ack_t::kNone};  // to the robot under test
  std::int32_t boot = 9;
  std::int64_t seq = 0;
  std::int32_t least_delay_us = announcement_t::kUnknown;

  // To robot `to` of the roster 0, 1, 2.
  announcement_t message(std::int64_t utime, int to) {
    announcement_t message{};
    message.header = make_header(id, boot, seq++, utime);
    message.radius = 0.2f;
    message.committed = committed.to_wire();
    message.pending = pending.to_wire();
    message.pending_state = pending_state;
    message.pending_stamp = stamp;
    message.roster_crc = kRosterCrc;
    message.least_delay_us = least_delay_us;
    message.num_acks = 3;
    message.acks.assign(3, {-1, 0, ack_t::kNone});
    message.acks[static_cast<std::size_t>(to)] = about_us;
    return message;
  }
  void pends(const Trajectory& trajectory, std::int64_t its_stamp, std::int8_t state = announcement_t::kAnnounced) {
    pending = trajectory;
    pending.set_seq(pending.seq() + 100);
    pending_state = state;
    stamp = its_stamp;
  }
  void pends_nothing() { pending = {}, pending_state = announcement_t::kNone, stamp = 0; }
};

// Robot `id` at (0, 0, 1), which has heard robots 0, 1 and 2 hover 10 m apart, itself excepted.
struct Kept {
  MemoryPromiseStore promises;
};
class Robot : public Kept, public Bench<BroadcastNode> {
 public:
  explicit Robot(int id, bool started = true, MemoryPromiseStore store = {}, std::int32_t boot = kBoot)
      : Kept{store}, Bench(make_config(id), promises, boot), id_(id) {
    for (int other = 0; other < 3; ++other) {
      if (other != id) peers.emplace(other, Peer{other, Trajectory::hover(1, kStart_us, {10.0 + 10 * other, 0, 1})});
    }
    if (!started) return;
    send_state();
    for (auto& [other, peer] : peers) hear(other);
  }
  static BroadcastConfig make_config(int id) {
    BroadcastConfig config;
    config.robot_id = id;
    config.roster = {0, 1, 2};
    config.swarm_rate_hz = 100'000;
    return config;
  }

  void send_state() { send(channel::kRobotState, state_at(id_, {0, 0, 1}, next_state_++, now_us)); }
  void hear(int other) { send(channel::kTrajectory, peers.at(other).message(now_us, id_), BusId::kSwarm); }
  // `other` judges our pending trajectory `seq`.
  void hear_verdict(int other, std::int32_t seq, std::int8_t verdict, std::int32_t boot = kBoot) {
    peers.at(other).about_us = {boot, seq, verdict};
    hear(other);
  }
  // From the motion in force after `lead_s` to rest at `to`.
  Trajectory plan(const Eigen::Vector3d& to, double lead_s = 0.1, double seconds = 2.0) const {
    const std::int64_t start = now_us + std::llround(lead_s * 1e6);
    return quintic_to(node.motion()->at(start), start, to, seconds);
  }
  void propose(const Trajectory& trajectory, bool urgent = false) {
    candidate_t candidate{};
    candidate.urgent = urgent ? 1 : 0;
    candidate.header = make_header(id_, 1, next_candidate_++, std::min(now_us, trajectory.start_utime()));
    candidate.trajectory = trajectory.to_wire();
    send(channel::kCandidate, candidate);
  }
  // 50 us later, when it may have announced again.
  announcement_t announced() {
    run_for(50e-6);
    return out.newest<announcement_t>(channel::kTrajectory, BusId::kSwarm);
  }
  // Our verdict about robot `other`.
  ack_t verdict_on(int other) { return announced().acks[static_cast<std::size_t>(other)]; }

  std::map<int, Peer> peers;

 private:
  int id_;
  std::int64_t next_state_ = 0, next_candidate_ = 0;
};

TEST(BroadcastNode, HoversFromTheFirstStateOn) {
  Robot robot(1, false);
  robot.run_for(1.5);
  EXPECT_EQ(robot.out.letters.size(), 2u);  // two statuses, nothing else
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kNoState);
  auto state = state_at(1, {3, -2, 1.5}, 0, robot.now_us);
  state.yaw = 0.5;
  const std::int64_t arrival = robot.now_us;
  robot.send(channel::kRobotState, state);
  const announcement_t message = robot.announced();
  EXPECT_EQ(message.header.utime, arrival);
  EXPECT_EQ(message.radius, 0.2f);
  EXPECT_TRUE(same(message.committed, Trajectory::hover(1, arrival, {3, -2, 1.5}).to_wire()));
  EXPECT_EQ(message.pending_state, announcement_t::kNone);
  EXPECT_EQ(message.roster_crc, kRosterCrc);
  ASSERT_EQ(message.acks.size(), 3u);
  for (const ack_t& ack : message.acks) EXPECT_EQ(ack.peer_boot, -1);  // nobody was heard
  robot.run_for(1.0);
  robot.send_state();  // somewhere else: what is committed stays
  robot.run_for(0.1);
  for (const setpoint_t& setpoint : robot.out.all<setpoint_t>(channel::kSetpoint)) {
    EXPECT_LT((Eigen::Vector3d(setpoint.position) - Eigen::Vector3d(3, -2, 1.5)).norm(), 1e-9);
    EXPECT_LT(Eigen::Vector3d(setpoint.velocity).norm(), 1e-9);
    EXPECT_EQ(setpoint.yaw, 0.5);
  }
}

TEST(BroadcastNode, AnnouncesItsWholeStateSteadilyOnBothBuses) {
  Robot robot(1);
  robot.run_for(0.5);  // what is new is repeated sooner
  robot.out.letters.clear();
  robot.run_for(1.0);
  const auto swarm = robot.out.all<announcement_t>(channel::kTrajectory, BusId::kSwarm);
  const auto own = robot.out.all<announcement_t>(channel::kOwnTrajectory);
  ASSERT_EQ(swarm.size(), 20u);
  ASSERT_EQ(own.size(), 20u);
  for (std::size_t i = 0; i < 20; ++i) {
    EXPECT_EQ(encoded(swarm[i]), encoded(own[i]));
    EXPECT_EQ(swarm[i].acks.size(), 3u);
    const auto steps = static_cast<std::int64_t>(i);
    EXPECT_EQ(swarm[i].header.utime, swarm[0].header.utime + 50'000 * steps);
    EXPECT_EQ(swarm[i].header.seq, swarm[0].header.seq + steps);
  }
}

TEST(BroadcastNode, SetpointsAreTheCommittedMotionAt100Hz) {
  Robot robot(0);
  const Trajectory flight = robot.plan({1.0, 1.0, 1.5}, 0.123);
  robot.propose(flight);
  const trajectory_t announced = robot.announced().pending;
  trajectory_t expected = flight.to_wire();
  expected.seq = announced.seq;
  EXPECT_TRUE(same(announced, expected));  // what is announced is what was planned, but for its number
  robot.out.letters.clear();
  robot.run_for(3.0);
  const Motion flown{Trajectory::hover(1, kStart_us, {0, 0, 1}), Trajectory::from_wire(announced)};
  const auto setpoints = robot.out.all<setpoint_t>(channel::kSetpoint);
  ASSERT_EQ(setpoints.size(), 300u);
  double yaw = 0.0;
  for (const setpoint_t& setpoint : setpoints) {
    EXPECT_EQ(setpoint.header.utime % 10'000, 0);
    const MotionState state = flown.at(setpoint.header.utime);
    EXPECT_EQ(Eigen::Vector3d(setpoint.position), state.position);
    EXPECT_EQ(Eigen::Vector3d(setpoint.velocity), state.velocity);
    EXPECT_EQ(Eigen::Vector3d(setpoint.acceleration), state.acceleration);
    EXPECT_EQ(Eigen::Vector3d(setpoint.jerk), state.jerk);
    EXPECT_LE(std::abs(setpoint.yaw_rate), 1.5 + 1e-9);
    EXPECT_NEAR(setpoint.yaw, yaw + 0.01 * setpoint.yaw_rate, 1e-9);
    yaw = setpoint.yaw;
  }
  EXPECT_NEAR(yaw, std::numbers::pi / 4, 1e-6);  // it has turned into its direction of flight
  EXPECT_LT((Eigen::Vector3d(setpoints.back().position) - Eigen::Vector3d(1, 1, 1.5)).norm(), 1e-6);
}

TEST(BroadcastNode, RejectsCandidatesByReason) {
  const auto expect_rejected = [](Robot& robot, Rejection reason, const Trajectory& trajectory) {
    const std::int32_t before = robot.node.rejected(reason);
    const Motion motion = *robot.node.motion();
    const int accepted = robot.node.rejected(Rejection::kNone);
    robot.propose(trajectory);
    EXPECT_EQ(robot.node.rejected(reason), before + 1) << to_string(reason);
    EXPECT_EQ(robot.node.rejected(Rejection::kNone), accepted) << to_string(reason);
    EXPECT_EQ(robot.node.refused().total(), 0);
    EXPECT_TRUE(same(robot.node.motion()->committed.to_wire(), motion.committed.to_wire()));
    EXPECT_EQ(robot.node.motion()->next.seq(), motion.next.seq());
    EXPECT_EQ(robot.announced().pending.seq, motion.next.seq());
  };
  Robot fresh(0, false);
  MotionState rest;
  rest.position = {0, 0, 1};
  fresh.propose(quintic_to(rest, fresh.now_us + 100'000, {1, 0, 1}, 2));
  EXPECT_EQ(fresh.node.rejected(Rejection::kNoCommitted), 1);
  fresh.send_state();
  fresh.hear(1);
  expect_rejected(fresh, Rejection::kWaiting, fresh.plan({1, 0, 1}));
  fresh.hear(2);
  fresh.propose(fresh.plan({1, 0, 1}));
  EXPECT_EQ(fresh.node.rejected(Rejection::kNone), 1);
  expect_rejected(fresh, Rejection::kBusy, fresh.plan({1, 0, 1}));

  Robot robot(0);
  expect_rejected(robot, Rejection::kTime, robot.plan({1, 0, 1}, 0.0));
  expect_rejected(robot, Rejection::kTime, robot.plan({1, 0, 1}, -0.01));
  expect_rejected(robot, Rejection::kTime, robot.plan({1, 0, 1}, 2.000001));
  const Trajectory good = robot.plan({1, 0, 1});
  const auto with_first_knot = [&](const Eigen::Vector3d& dp, const Eigen::Vector3d& dv, const Eigen::Vector3d& da) {
    MotionState first = good.knot(0);
    first.position += dp, first.velocity += dv, first.acceleration += da;
    Trajectory bad = good;
    bad.set_knot(0, first);
    return bad;
  };
  const Eigen::Vector3d none(0, 0, 0);
  expect_rejected(robot, Rejection::kDiscontinuous, with_first_knot({0, 1.2e-4, 0}, none, none));
  expect_rejected(robot, Rejection::kDiscontinuous, with_first_knot(none, {0, 0, 1.2e-3}, none));
  expect_rejected(robot, Rejection::kDiscontinuous, with_first_knot(none, none, {1.2e-2, 0, 0}));
  expect_rejected(robot, Rejection::kLimits, robot.plan({0, 4, 1}, 0.1, 3.0));     // 2.5 m/s, 2.6 m/s^2
  expect_rejected(robot, Rejection::kLimits, robot.plan({0, 0, 1.7}, 0.1, 0.75));  // 1.75 m/s, 7.2 m/s^2
  expect_rejected(robot, Rejection::kConflict, robot.plan({19.7, 0, 1}, 0.1, 20.0));
  robot.propose(good);
  EXPECT_EQ(robot.node.rejected(Rejection::kNone), 1);

  // What a peer will fly and what it was promised count as much as what it flies.
  for (const std::int8_t state : {announcement_t::kCommitted, announcement_t::kAnnounced}) {
    Robot other(0);
    Peer& peer = other.peers.at(1);
    peer.pends(quintic_to(peer.committed.at(0), other.now_us + 100'000, {1.3, 0, 1}, 20), other.now_us, state);
    other.hear(1);
    expect_rejected(other, Rejection::kConflict, other.plan({1, 0, 1}));
    EXPECT_EQ(other.node.rejected(Rejection::kConflict), 1);
    other.propose(other.plan({0.8, 0, 1}));
    EXPECT_EQ(other.node.rejected(Rejection::kNone), 1);
  }
}

TEST(BroadcastNode, HolderCommitsAtOnce) {
  Robot robot(0);
  robot.run_for(0.001);
  robot.out.letters.clear();
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  const auto messages = robot.out.all<announcement_t>(channel::kTrajectory, BusId::kSwarm);
  ASSERT_EQ(messages.size(), 1u);
  EXPECT_EQ(messages[0].pending_state, announcement_t::kCommitted);
  EXPECT_EQ(messages[0].pending.seq, 2);
  EXPECT_EQ(messages[0].header.utime, robot.now_us);
}

TEST(BroadcastNode, AskerCommitsOnTheHoldersAckOnly) {
  Robot robot(1);
  const std::int64_t stamp = robot.now_us;
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  announcement_t message = robot.announced();
  EXPECT_EQ(message.pending_state, announcement_t::kAnnounced);
  EXPECT_EQ(message.pending_stamp, stamp);
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
  message = robot.announced();
  EXPECT_EQ(message.pending_state, announcement_t::kCommitted);
  EXPECT_EQ(message.pending.seq, seq);
  EXPECT_NEAR(message.header.utime, robot.now_us, 50);
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
  robot.run_until(flight.start_utime() - 60);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kAnnounced);
  robot.run_until(flight.start_utime());
  EXPECT_EQ(robot.node.protocol().withdrawn(), 1);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kNone);
  EXPECT_EQ(robot.announced().header.utime, flight.start_utime());
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
  robot.hear_verdict(0, 3, ack_t::kAck);
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  EXPECT_EQ(robot.node.motion()->end_utime(), robot.now_us + 2'500'000);
}

TEST(BroadcastNode, JudgesAtOnceAndForGood) {
  Robot robot(0);
  Peer& peer = robot.peers.at(1);
  const MotionState from = peer.committed.at(0);
  const auto judged = [&](const Eigen::Vector3d& to, std::int64_t start) {
    const std::int32_t seq = peer.pending.seq() + 1;
    peer.pends(quintic_to(from, start, to, 20, 5, seq - 100), robot.now_us);
    robot.run_for(0.001);
    const int before = robot.out.count(channel::kTrajectory, BusId::kSwarm);
    robot.hear(1);
    EXPECT_EQ(robot.out.count(channel::kTrajectory, BusId::kSwarm), before + 1);
    EXPECT_EQ(robot.verdict_on(1).judged_seq, seq);
    EXPECT_EQ(robot.verdict_on(1).peer_boot, peer.boot);
    return robot.verdict_on(1).verdict;
  };
  const std::int64_t soon = robot.now_us + 100'000;
  EXPECT_EQ(judged({20, 5, 1}, robot.now_us), ack_t::kNack);  // has begun already
  EXPECT_EQ(judged({0.41, 0, 1}, soon), ack_t::kNack);        // radii and 2 cm
  EXPECT_EQ(judged({-1.0, 0, 1}, soon), ack_t::kNack);        // ends clear, but passes through
  EXPECT_EQ(judged({0.43, 0, 1}, soon), ack_t::kAck);
  robot.run_for(0.2);  // late by now, but it has its ack
  robot.hear(1);
  EXPECT_EQ(robot.verdict_on(1).verdict, ack_t::kAck);
  EXPECT_EQ(robot.verdict_on(2).judged_seq, 0);
  EXPECT_EQ(robot.verdict_on(2).verdict, ack_t::kNone);
}

TEST(BroadcastNode, TheOlderOfTwoPendingTrajectoriesWins) {
  struct Case {
    std::int64_t stamp_difference;  // theirs minus ours
    int rival;
    bool we_win;
  };
  for (const Case& c : {Case{-1, 2, false}, {1, 2, true}, {0, 2, true}, {0, 0, false}, {1, 0, true}}) {
    SCOPED_TRACE(testing::Message() << c.stamp_difference << " us, robot " << c.rival);
    Robot robot(1);
    robot.propose(robot.plan({1, 0, 1}, 0.5));
    Peer& rival = robot.peers.at(c.rival);
    const std::int64_t stamp = robot.now_us + c.stamp_difference;
    rival.pends(quintic_to(rival.committed.at(0), robot.now_us + 400'000, {1.2, 0, 1}, 40), stamp);
    robot.hear(c.rival);
    EXPECT_EQ(robot.verdict_on(c.rival).verdict, c.we_win ? ack_t::kNack : ack_t::kAck);
    EXPECT_EQ(robot.node.protocol().withdrawn(), c.we_win ? 0 : 1);
    EXPECT_EQ(robot.announced().pending.seq, c.we_win ? 2 : 0);
  }
  Robot robot(1);  // without conflict both go on
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  Peer& other = robot.peers.at(2);
  other.pends(quintic_to(other.committed.at(0), robot.now_us + 400'000, {5, 0, 1}, 40), robot.now_us - 1);
  robot.hear(2);
  EXPECT_EQ(robot.verdict_on(2).verdict, ack_t::kAck);
  EXPECT_EQ(robot.announced().pending.seq, 2);
}

TEST(BroadcastNode, APromiseBindsUntilItIsNoLongerShown) {
  Robot robot(0);
  Peer& peer = robot.peers.at(1);
  peer.pends(quintic_to(peer.committed.at(0), robot.now_us + 200'000, {1.2, 0, 1}, 20), robot.now_us);
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
  const Trajectory flight = quintic_to(asker.committed.at(0), robot.now_us + 100'000, {1.2, 0, 1}, 20);
  asker.pends(flight, robot.now_us - 1, announcement_t::kCommitted);
  robot.hear(2);
  robot.hear_verdict(0, 2, ack_t::kAck);
  EXPECT_EQ(robot.node.protocol().commits(), 0);
  robot.run_for(0.6);
  EXPECT_EQ(robot.node.protocol().withdrawn(), 1);
}

TEST(BroadcastNode, SwitchesExactlyAtTheStart) {
  Robot robot(0);
  const Trajectory flight = robot.plan({1, 0, 1}, 0.123457);
  robot.propose(flight);
  robot.run_until(flight.start_utime() - 1);
  EXPECT_EQ(robot.node.motion()->committed.seq(), 1);
  EXPECT_EQ(robot.node.motion()->next.seq(), 2);
  robot.run_until(flight.start_utime());
  EXPECT_EQ(robot.node.motion()->committed.seq(), 2);
  EXPECT_TRUE(robot.node.motion()->next.empty());
  const announcement_t message = robot.announced();
  EXPECT_NEAR(message.header.utime, flight.start_utime(), 50);
  EXPECT_EQ(message.committed.seq, 2);
  EXPECT_EQ(message.pending_state, announcement_t::kNone);
  robot.run_for(0.5);  // and the next one may leave it in mid-flight
  robot.propose(robot.plan({0, 1, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 2);
}

TEST(BroadcastNode, RelaysPeersByteForByteAndNotItself) {
  Robot robot(1);
  robot.peers.at(0).pends(quintic_to(robot.peers.at(0).committed.at(0), robot.now_us + 100'000, {10, 3, 1}, 5), 1);
  const Bytes bytes = encoded(robot.peers.at(0).message(robot.now_us, 1));
  robot.out.letters.clear();
  robot.deliver(BusId::kSwarm, channel::kTrajectory, bytes);
  ASSERT_EQ(robot.out.count(channel::kPeerTrajectory), 1);
  const auto relayed = std::find_if(robot.out.letters.begin(), robot.out.letters.end(),
                                    [](const auto& letter) { return letter.channel == channel::kPeerTrajectory; });
  EXPECT_EQ(relayed->bus, BusId::kOnboard);
  EXPECT_EQ(relayed->bytes, bytes);
  robot.deliver(BusId::kSwarm, channel::kTrajectory, encoded(robot.announced()));
  EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), 1);
  EXPECT_EQ(robot.node.refused().total(), 0);
}

TEST(BroadcastNode, RefusalsAreCountedAndChangeNothing) {
  Robot robot(1);
  robot.run_for(0.1);
  const Bytes before = encoded(robot.announced());
  robot.out.letters.clear();
  std::array<int, kNumRefusals> expected{};
  const auto expect_refused = [&](Refusal reason, BusId bus, const char* channel, const Bytes& bytes) {
    robot.deliver(bus, channel, bytes);
    ++expected[static_cast<std::size_t>(reason)];
    for (int i = 0; i < kNumRefusals; ++i) {
      ASSERT_EQ(robot.node.refused()[static_cast<Refusal>(i)], expected[static_cast<std::size_t>(i)])
          << channel << ", " << to_string(reason) << " expected, " << to_string(static_cast<Refusal>(i)) << " counted";
    }
    EXPECT_TRUE(robot.out.letters.empty()) << channel << ", " << to_string(reason);
  };
  candidate_t candidate{};
  candidate.header = make_header(1, 1, 7, robot.now_us);
  candidate.trajectory = robot.plan({1, 0, 1}).to_wire();
  const auto refuse_each = [&](BusId bus, const char* channel, const auto& message) {
    const auto changed = [&](const auto& change) {
      auto copy = message;
      change(copy);
      return encoded(copy);
    };
    Bytes damaged = encoded(message), longer = encoded(message);
    damaged[damaged.size() / 2] ^= 1;
    longer.push_back(0);
    expect_refused(Refusal::kSize, bus, channel, {});
    expect_refused(Refusal::kSize, bus, channel, longer);
    expect_refused(Refusal::kFingerprint, bus, channel, Bytes(longer.size(), 0x5a));
    expect_refused(Refusal::kCrc, bus, channel, damaged);
    expect_refused(Refusal::kVersion, bus, channel, changed([](auto& m) { ++m.header.schema_version; }));
    expect_refused(Refusal::kRobot, bus, channel, changed([](auto& m) { m.header.robot_id = 5; }));
    expect_refused(Refusal::kTime, bus, channel, changed([](auto& m) { m.header.utime -= 1'000'001; }));
    expect_refused(Refusal::kTime, bus, channel, changed([](auto& m) { m.header.utime += 100'001; }));
  };
  candidate.trajectory.start_utime += 200'000;  // after every header.utime used here
  refuse_each(BusId::kOnboard, channel::kCandidate, candidate);
  refuse_each(BusId::kOnboard, channel::kRobotState, state_at(1, {5, 5, 5}, 9, robot.now_us));
  announcement_t heard = robot.peers.at(2).message(robot.now_us, 1);
  heard.pending = Trajectory::hover(50, robot.now_us + 100'000, {0, 0, 1}).to_wire();
  heard.pending_state = announcement_t::kAnnounced;
  refuse_each(BusId::kSwarm, channel::kTrajectory, heard);
  heard.header.seq = 0;  // as the one heard already
  expect_refused(Refusal::kSequence, BusId::kSwarm, channel::kTrajectory, encoded(heard));
  expect_refused(Refusal::kSequence, BusId::kOnboard, channel::kRobotState,
                 encoded(state_at(1, {5, 5, 5}, 0, robot.now_us)));
  candidate.trajectory.knots[0][0] = NAN;
  expect_refused(Refusal::kValue, BusId::kOnboard, channel::kCandidate, encoded(candidate));
  EXPECT_EQ(robot.node.rejected(Rejection::kNone), 0);
  robot.run_for(0.05);  // the same state as before is announced
  announcement_t after = robot.announced();
  announcement_t unchanged;
  ASSERT_EQ(decode(before, &unchanged), Refusal::kNone);
  after.header = unchanged.header;
  EXPECT_EQ(encoded(after), encoded(unchanged));
  robot.run_for(1.0);
  const auto status = robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus);
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), status.refused));
}

TEST(BroadcastNode, NewsAreRepeatedSoonAndNeverFasterThanTheSwarmMay) {
  Robot robot(1);
  robot.run_for(0.5);
  robot.out.letters.clear();
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  robot.run_for(0.21);
  EXPECT_EQ(robot.out.count(channel::kTrajectory, BusId::kSwarm), 11);  // every 20 ms

  BroadcastConfig config = Robot::make_config(1);
  config.swarm_rate_hz = 100;  // three robots: 30 ms
  MemoryPromiseStore store;
  Bench<BroadcastNode> slow(config, store, kBoot);
  slow.send(channel::kRobotState, state_at(1, {0, 0, 1}, 0, slow.now_us));
  Peer peer{0, Trajectory::hover(1, kStart_us, {10, 0, 1})};
  for (int i = 0; i < 300; ++i) {  // a new trajectory every millisecond
    peer.pends(quintic_to(peer.committed.at(0), slow.now_us + 500'000, {9, 0, 1}, 5, 5, i + 1), slow.now_us);
    slow.send(channel::kTrajectory, peer.message(slow.now_us, 1), BusId::kSwarm);
    slow.run_for(0.001);
  }
  EXPECT_EQ(slow.out.count(channel::kTrajectory, BusId::kSwarm), 11);  // at once, then every 30 ms
  EXPECT_GT(slow.out.newest<announcement_t>(channel::kTrajectory, BusId::kSwarm).acks[0].judged_seq, 350);
}

TEST(BroadcastNode, AnnouncementsOfAnotherRosterAreRefused) {
  Robot robot(1);
  announcement_t message = robot.peers.at(0).message(robot.now_us, 1);
  message.roster_crc ^= 1;
  robot.send(channel::kTrajectory, message, BusId::kSwarm);
  message = robot.peers.at(0).message(robot.now_us, 1);
  message.acks.push_back({-1, 0, ack_t::kNone});
  message.num_acks = 4;
  robot.send(channel::kTrajectory, message, BusId::kSwarm);
  EXPECT_EQ(robot.node.refused()[Refusal::kRobot], 2);
  EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), 2);  // of the start
}

TEST(BroadcastNode, GoesOnAfterARestartWithWhatItPromised) {
  Robot before(0);
  before.propose(before.plan({1, 0, 1}, 0.1));
  before.run_for(0.05);
  ASSERT_EQ(before.node.protocol().commits(), 1);
  const Motion promised = *before.node.motion();

  Robot after(0, false, before.promises, kBoot);
  after.now_us = before.now_us;
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
  carried.send(channel::kRobotState, state_at(0, {5, 0, 1}, 0, carried.now_us));
  EXPECT_EQ(carried.node.motion()->at(carried.now_us).position, Eigen::Vector3d(5, 0, 1));
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
  robot.send(channel::kRobotState, state_at(0, {0, 0, 1}, 0, robot.now_us));
  std::int64_t seq = 0;
  const auto propose = [&] {
    candidate_t candidate{};
    candidate.header = make_header(0, 1, seq++, robot.now_us);
    const std::int64_t start = robot.now_us + 100'000;
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
  disk.full = false;
  propose();
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kFlying);
}

TEST(BroadcastNode, CommitsNothingWhileClocksDisagree) {
  Robot robot(0);
  robot.send(channel::kTrajectory, robot.peers.at(1).message(robot.now_us + 10'001, 0), BusId::kSwarm);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.rejected(Rejection::kClock), 1);
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kClock);
  robot.run_for(0.001);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
}

// A peer whose clock is behind or ahead is found out though its messages take longer than that; delays alone are not.
TEST(BroadcastNode, CommitsNothingWhileAPeersClockIsWrong) {
  for (const int ahead_ms : {-20, 0, 20}) {
    SCOPED_TRACE(ahead_ms);
    Robot robot(0, false);
    robot.send_state();
    robot.hear(2);
    constexpr int kDelay_ms = 30;
    for (int i = 0; i < 3 * ClockOffset::kEnough; ++i) {
      Peer& peer = robot.peers.at(1);
      peer.least_delay_us = 1000 * (kDelay_ms + ahead_ms);  // of our announcements
      const std::int64_t sent = robot.now_us + 1000 * (ahead_ms - kDelay_ms);
      robot.send(channel::kTrajectory, peer.message(sent, 0), BusId::kSwarm);
      robot.run_for(0.02);
    }
    const auto status = robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus);
    EXPECT_NEAR(status.max_clock_offset_ms, std::abs(ahead_ms), 1e-3);
    EXPECT_EQ(status.state, ahead_ms == 0 ? broadcast_status_t::kFlying : broadcast_status_t::kClock);
    robot.propose(robot.plan({1, 0, 1}));
    EXPECT_EQ(robot.node.rejected(Rejection::kClock), ahead_ms == 0 ? 0 : 1);
    EXPECT_EQ(robot.node.protocol().commits(), ahead_ms == 0 ? 1 : 0);
    robot.run_for(0.3);
    robot.propose(robot.plan({1, 0, 1}), true);  // the last resort
    robot.run_for(0.1);
    EXPECT_EQ(robot.node.protocol().forced(), ahead_ms == 0 ? 0 : 1);
    std::vector<std::int32_t> told;
    for (const announcement_t& message : robot.out.all<announcement_t>(channel::kTrajectory, BusId::kSwarm)) {
      if (message.header.seq % 3 == 1) {
        told.push_back(message.least_delay_us);
      } else {
        EXPECT_EQ(message.least_delay_us, announcement_t::kUnknown);
      }
    }
    EXPECT_EQ(told.front(), announcement_t::kUnknown);
    EXPECT_EQ(told.back(), 1000 * (kDelay_ms - ahead_ms));
  }
}

// What was announced before a clock was found wrong is not committed after it.
TEST(BroadcastNode, WhatWaitsIsNotCommittedWhileClocksDisagree) {
  for (const bool disagree : {false, true}) {
    Robot robot(1);
    robot.propose(robot.plan({1, 0, 1}, 0.5));
    if (disagree) robot.send(channel::kTrajectory, robot.peers.at(2).message(robot.now_us + 20'000, 1), BusId::kSwarm);
    robot.hear_verdict(0, 2, ack_t::kAck);
    EXPECT_EQ(robot.node.protocol().commits(), disagree ? 0 : 1);
  }
}

// A forced motion may have ended closer than it should: nobody is stuck there, as long as they do not get nearer.
TEST(BroadcastNode, RobotsThatAreTooCloseMayPart) {
  Robot robot(0);
  robot.peers.at(1).committed = Trajectory::hover(2, robot.now_us, {0.41, 0, 1});
  robot.hear(1);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.rejected(Rejection::kConflict), 1);
  robot.propose(robot.plan({-1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  EXPECT_EQ(robot.node.protocol().forced(), 0);
}

TEST(BroadcastNode, WhatIsUrgentIsCommittedAtTheLastMomentWithoutAnAnswer) {
  Robot robot(1);
  const Trajectory flight = robot.plan({1, 0, 1}, 0.5);
  robot.propose(flight, true);
  robot.run_until(flight.start_utime() - 10'100);
  EXPECT_EQ(robot.announced().pending_state, announcement_t::kAnnounced);
  robot.run_until(flight.start_utime() - 9'900);
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
  after.now_us = robot.now_us;
  after.send(channel::kRobotState, state_at(1, {1, 0, 1}, 0, after.now_us));
  EXPECT_EQ(after.announced().forced_seq, 2);
}

TEST(BroadcastNode, WhatIsUrgentIsNotForcedWhenPeersAgreeInTime) {
  Robot robot(1);
  robot.propose(robot.plan({1, 0, 1}, 0.5), true);
  robot.hear_verdict(0, 2, ack_t::kAck);
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
      holder.pends(quintic_to(holder.committed.at(robot.now_us), robot.now_us + 600'000, {1, 0.1, 1}, 2.0),
                   robot.now_us + 1);
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

TEST(BroadcastNode, StatusTellsWhatHappened) {
  Robot robot(1, false);
  robot.send_state();
  robot.hear(0);
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kWaiting);
  robot.hear(2);
  robot.peers.at(0).seq += 3;  // three lost
  robot.hear(0);
  robot.propose(robot.plan({1, 0, 1}));
  robot.hear_verdict(0, 2, ack_t::kAck);
  robot.propose(robot.plan({1, 0, 1}));  // busy
  robot.run_for(0.3);
  robot.propose(robot.plan({0, 1, 1}));  // nobody answers
  robot.run_for(0.7);
  const auto status = robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus);
  EXPECT_EQ(status.state, broadcast_status_t::kFlying);
  EXPECT_EQ(status.candidates, 3);
  EXPECT_EQ(status.commits, 1);
  EXPECT_EQ(status.withdrawn, 1);
  EXPECT_EQ(status.rejected[static_cast<int>(Rejection::kBusy)], 1);
  EXPECT_EQ(status.rejected[static_cast<int>(Rejection::kNone)], 2);
  EXPECT_EQ(status.lost, 3);
  EXPECT_EQ(status.peers_heard, 2);
  EXPECT_NEAR(status.max_age_ms, 1000, 1);
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).peers_heard, 0);
}

}  // namespace
}  // namespace swarm::test
