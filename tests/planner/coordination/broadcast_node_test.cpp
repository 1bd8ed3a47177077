// What the broadcast daemon says and does with what it hears: announcements, setpoints, statuses and refusals. Long
// because every message that it hears and says is tried.
#include "planner_daemon/coordination/broadcast_node.h"

#include <array>
#include <cmath>
#include <numbers>

#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

using sogm_swarm::setpoint_t;

TEST(BroadcastNode, HoversFromTheFirstStateOn) {
  Robot robot(1, false);
  robot.run_for(1.5);
  EXPECT_EQ(robot.out.letters.size(), 4u);  // statuses of both kinds, nothing else
  EXPECT_EQ(robot.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kNoState);
  auto state = state_at(1, {3, -2, 1.5}, 0, robot.now);
  state.yaw = 0.5;
  const Utime arrival = robot.now;
  robot.send(channel::kRobotState, state);
  const announcement_t message = robot.announced();
  EXPECT_EQ(to_utime(message.header.utime), arrival);
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
  Robot robot(0);
  robot.run_for(0.5);  // what is new is repeated sooner
  const auto expect_steady = [&](Duration period) {
    SCOPED_TRACE(to_ms(period));
    robot.out.letters.clear();
    robot.run_for(1.0);
    const auto swarm = robot.out.all<announcement_t>(channel::kAnnouncement, BusId::kSwarm);
    const auto own = robot.out.all<announcement_t>(channel::kOwnTrajectory);
    ASSERT_EQ(swarm.size(), static_cast<std::size_t>(1s / period));
    ASSERT_EQ(own.size(), swarm.size());
    for (std::size_t i = 0; i < swarm.size(); ++i) {
      announcement_t same = own[i];
      EXPECT_EQ(same.header.utime, swarm[i].header.utime);
      same.header = swarm[i].header;
      EXPECT_EQ(encoded(same), encoded(swarm[i]));
      EXPECT_EQ(swarm[i].acks.size(), 3u);
      const auto steps = static_cast<std::int64_t>(i);
      EXPECT_EQ(to_utime(swarm[i].header.utime), to_utime(swarm[0].header.utime) + steps * period);
      EXPECT_EQ(swarm[i].header.seq, swarm[0].header.seq + steps);
    }
  };
  expect_steady(100ms);  // at rest
  robot.propose(robot.plan({1, 0, 1}, 0.1));
  robot.run_for(0.5);
  expect_steady(50ms);
}

TEST(BroadcastNode, AtRestItAnswersAtOnceWhomItKeepsWaiting) {
  for (const int asker : {0, 2}) {
    SCOPED_TRACE(asker);
    Robot robot(1);
    robot.run_for(0.5);
    robot.out.letters.clear();
    Peer& peer = robot.peers.at(asker);
    const auto says = [&] { return robot.out.count(channel::kAnnouncement, BusId::kSwarm); };
    peer.pends(quintic_to(peer.committed.at(kStart), robot.now + 900ms, {9, 0, 1}, 5), robot.now);
    robot.hear(asker);
    robot.run_for(50e-6);
    EXPECT_EQ(says(), 1);
    robot.run_for(0.019);
    EXPECT_EQ(says(), 1);
    robot.hear(asker);  // which waits still
    robot.run_for(0.002);
    EXPECT_EQ(says(), 2);
    robot.run_for(0.19);
    EXPECT_EQ(says(), 3);
    peer.pending_state = announcement_t::kCommitted;
    robot.hear(asker);
    robot.out.letters.clear();
    robot.run_for(1.0);
    EXPECT_EQ(says(), 10);
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
  const Motion flown{Trajectory::hover(1, kStart, {0, 0, 1}), Trajectory::from_wire(announced)};
  const auto setpoints = robot.out.all<setpoint_t>(channel::kSetpoint);
  ASSERT_EQ(setpoints.size(), 300u);
  double yaw = 0.0;
  for (const setpoint_t& setpoint : setpoints) {
    EXPECT_EQ(Duration(setpoint.header.utime) % 10ms, 0us);
    const MotionState state = flown.at(to_utime(setpoint.header.utime));
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

TEST(BroadcastNode, ASlowRobotLooksToWhereItFlies) {
  const auto yaw_after = [](double y) {
    Robot robot(0);
    robot.propose(robot.plan({0, y, 1}, 0.1, 6.0));  // never faster than 0.05 m/s
    robot.run_for(6.5);
    EXPECT_NEAR(robot.node.motion()->at(robot.now).position.y(), y, 1e-3);
    return robot.out.newest<setpoint_t>(channel::kSetpoint).yaw;
  };
  EXPECT_NEAR(yaw_after(-0.15), -std::numbers::pi / 2, 1e-6);
  EXPECT_EQ(yaw_after(-0.04), 0.0) << "it stays where it is, nearly";
}

TEST(BroadcastNode, LooksAroundACornerBeforeItFliesThere) {
  Robot robot(0);
  Trajectory around(1, robot.now + 100ms, 1500ms, 2);
  MotionState place;
  for (int i = 0; i < 3; ++i) {  // ahead, then to the left
    place.position = Eigen::Vector3d(i > 0 ? 1 : 0, i > 1 ? 1 : 0, 1);
    around.set_knot(i, place);
  }
  robot.propose(around);
  robot.run_for(1.4);
  const auto setpoint = robot.out.newest<setpoint_t>(channel::kSetpoint);
  EXPECT_GT(setpoint.velocity[0], 0.01);
  EXPECT_LT(setpoint.velocity[1], 1e-6);
  EXPECT_GT(setpoint.yaw, 1.0);
  robot.run_for(1.0);
  EXPECT_NEAR(robot.out.newest<setpoint_t>(channel::kSetpoint).yaw, std::numbers::pi / 2, 0.01);
}

TEST(BroadcastNode, SwitchesExactlyAtTheStart) {
  Robot robot(0);
  const Trajectory flight = robot.plan({1, 0, 1}, 0.123457);
  robot.propose(flight);
  robot.run_until(flight.start_utime() - 1us);
  EXPECT_EQ(robot.node.motion()->committed.seq(), 1);
  EXPECT_EQ(robot.node.motion()->next.seq(), 2);
  robot.run_until(flight.start_utime());
  EXPECT_EQ(robot.node.motion()->committed.seq(), 2);
  EXPECT_TRUE(robot.node.motion()->next.empty());
  robot.run_for(0.05);  // nobody waits for it
  const announcement_t message = robot.announced();
  EXPECT_EQ(message.committed.seq, 2);
  EXPECT_EQ(message.pending_state, announcement_t::kNone);
  robot.run_for(0.5);  // and the next one may leave it in mid-flight
  robot.propose(robot.plan({0, 1, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 2);
}

TEST(BroadcastNode, NewsAreRepeatedSoonAndNeverFasterThanTheSwarmMay) {
  Robot robot(1);
  robot.run_for(0.5);
  robot.out.letters.clear();
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  robot.run_for(0.0801);
  EXPECT_EQ(robot.out.count(channel::kAnnouncement, BusId::kSwarm), 11);  // every 8 ms

  BroadcastConfig config = Robot::make_config(1);
  config.swarm_rate_hz = 100;  // three robots: 30 ms
  MemoryPromiseStore store;
  Bench<BroadcastNode> slow(config, store, kBoot);
  slow.send(channel::kRobotState, state_at(1, {0, 0, 1}, 0, slow.now));
  Peer peer{2, Trajectory::hover(1, kStart, {10, 0, 1})};
  for (int i = 0; i < 300; ++i) {  // a new trajectory every millisecond
    peer.pends(quintic_to(peer.committed.at(kStart), slow.now + 500ms, {9, 0, 1}, 5, 5, i + 1), slow.now);
    slow.send(channel::kAnnouncement, peer.message(slow.now, 1), BusId::kSwarm);
    slow.run_for(0.001);
  }
  // One of its own, then answers, of which several wait for each other; scattered, but no more often on average.
  EXPECT_GE(slow.out.count(channel::kAnnouncement, BusId::kSwarm), 7);
  EXPECT_LE(slow.out.count(channel::kAnnouncement, BusId::kSwarm), 12);
  EXPECT_GT(slow.out.newest<announcement_t>(channel::kAnnouncement, BusId::kSwarm).acks[2].judged_seq, 350);
}

// A robot that need not answer for a peer to go on says what it judged by and by.
TEST(BroadcastNode, AnswersAtOnceWhereItIsWaitedFor) {
  const auto answers_at_once = [](int id, int asker) {
    Robot robot(id);
    robot.run_for(0.001);
    robot.out.letters.clear();
    auto& peer = robot.peers.at(asker);
    peer.pends(quintic_to(peer.committed.at(kStart), robot.now + 500ms, {10, 3, 1}, 5), robot.now);
    robot.hear(asker);
    robot.run_for(0.001);
    return robot.out.count(channel::kAnnouncement, BusId::kSwarm) == 1;
  };
  EXPECT_TRUE(answers_at_once(0, 1));
  EXPECT_TRUE(answers_at_once(0, 2));
  EXPECT_TRUE(answers_at_once(1, 2));
  EXPECT_TRUE(answers_at_once(1, 0)) << "the two are a majority";
  EXPECT_FALSE(answers_at_once(2, 0)) << "without it";
  EXPECT_FALSE(answers_at_once(2, 1));
}

TEST(BroadcastNode, RelaysPeersAndNotItself) {
  Robot robot(1);
  robot.peers.at(0).pends(quintic_to(robot.peers.at(0).committed.at(kStart), robot.now + 100ms, {10, 3, 1}, 5),
                          to_utime(1));
  const announcement_t message = robot.peers.at(0).message(robot.now, 1);
  robot.out.letters.clear();
  robot.send(channel::kAnnouncement, message, BusId::kSwarm);
  ASSERT_EQ(robot.out.count(channel::kPeerTrajectory), 1);
  const auto relayed = std::find_if(robot.out.letters.begin(), robot.out.letters.end(),
                                    [](const auto& letter) { return letter.channel == channel::kPeerTrajectory; });
  EXPECT_EQ(relayed->bus, BusId::kOnboard);
  EXPECT_EQ(relayed->bytes, encoded(message)) << "unpacked, byte for byte";
  robot.run_for(0.1);
  robot.send(channel::kAnnouncement, robot.announced(), BusId::kSwarm);
  EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), 1);
  EXPECT_EQ(robot.node.refused().total(), 0);
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
  fresh.propose(quintic_to(rest, fresh.now + 100ms, {1, 0, 1}, 2));
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
  expect_rejected(robot, Rejection::kTime, robot.plan({1, 0, 1}, 0.1, 9.95));
  const Trajectory good = robot.plan({1, 0, 1});
  const auto with_first_knot = [&](const Eigen::Vector3d& dp, const Eigen::Vector3d& dv, const Eigen::Vector3d& da) {
    MotionState first = good.knot(0);
    first.position += dp, first.velocity += dv, first.acceleration += da;
    Trajectory bad = good;
    bad.set_knot(0, first);
    return bad;
  };
  const Eigen::Vector3d none(0, 0, 0);
  expect_rejected(robot, Rejection::kDiscontinuous, with_first_knot({0, 2e-4, 0}, none, none));
  expect_rejected(robot, Rejection::kDiscontinuous, with_first_knot(none, {0, 0, 2e-3}, none));
  expect_rejected(robot, Rejection::kDiscontinuous, with_first_knot(none, none, {2e-2, 0, 0}));
  expect_rejected(robot, Rejection::kLimits, robot.plan({0, 4, 1}, 0.1, 3.0));     // 2.5 m/s, 2.6 m/s^2
  expect_rejected(robot, Rejection::kLimits, robot.plan({0, 0, 1.7}, 0.1, 0.75));  // 1.75 m/s, 7.2 m/s^2
  const Utime soon = robot.now + 100ms;
  const Trajectory leap = quintic_to(robot.node.motion()->at(soon), soon, {1, 0, 1}, 0.01, 1);
  expect_rejected(robot, Rejection::kLimits, leap);  // 188 m/s, but at rest at both knots
  Robot gentle(0, true, {}, kBoot, {.j_max_mps3 = 20.0});
  expect_rejected(gentle, Rejection::kLimits, gentle.plan({0.4, 0, 1}, 0.1, 1.0));  // 24 m/s^3
  MotionLimits upright;
  upright.kind = "thrust";
  upright.thrust.tilt_deg = 20.0;
  Robot stiff(0, true, {}, kBoot, upright);
  expect_rejected(stiff, Rejection::kLimits, stiff.plan({0, 2.7, 1}, 0.1, 2.0));  // 3.9 m/s^2: 21.6 degrees
  robot.peers.at(1).committed = Trajectory::hover(2, kStart, {10, 0, 1});
  robot.hear(1);
  expect_rejected(robot, Rejection::kConflict, robot.plan({9.7, 0, 1}, 0.1, 9.8));
  robot.propose(good);
  EXPECT_EQ(robot.node.rejected(Rejection::kNone), 1);

  // What a peer will fly and what it was promised count as much as what it flies.
  for (const std::int8_t state : {announcement_t::kCommitted, announcement_t::kAnnounced}) {
    Robot other(0);
    Peer& peer = other.peers.at(1);
    peer.pends(quintic_to(peer.committed.at(kStart), other.now + 100ms, {1.3, 0, 1}, 9), other.now, state);
    other.hear(1);
    expect_rejected(other, Rejection::kConflict, other.plan({1, 0, 1}));
    EXPECT_EQ(other.node.rejected(Rejection::kConflict), 1);
    other.propose(other.plan({0.8, 0, 1}));
    EXPECT_EQ(other.node.rejected(Rejection::kNone), 1);
  }
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
    if (reason == Refusal::kTime && bus == BusId::kSwarm)  // where the peer is, is told the planner
      std::erase_if(robot.out.letters, [](const auto& letter) { return letter.channel == channel::kPeerTrajectory; });
    EXPECT_TRUE(robot.out.letters.empty()) << channel << ", " << to_string(reason);
  };
  candidate_t candidate{};
  candidate.header = make_header(1, 1, 7, robot.now);
  candidate.trajectory = robot.plan({1, 0, 1}).to_wire();
  const auto refuse_each = [&](BusId bus, const char* channel, const auto& message) {
    const auto changed = [&](const auto& change) {
      auto copy = message;
      change(copy);
      return encoded_for(channel, copy);
    };
    Bytes damaged = encoded_for(channel, message), longer = encoded_for(channel, message);
    damaged[damaged.size() / 2] ^= 1;
    longer.push_back(0);
    expect_refused(Refusal::kSize, bus, channel, {});
    expect_refused(Refusal::kSize, bus, channel, longer);
    expect_refused(Refusal::kFingerprint, bus, channel, Bytes(longer.size(), 0x5a));
    expect_refused(Refusal::kCrc, bus, channel, damaged);
    expect_refused(Refusal::kVersion, bus, channel, changed([](auto& m) { ++m.header.schema_version; }));
    if (bus == BusId::kOnboard)  // on the other one they are strangers
      expect_refused(Refusal::kRobot, bus, channel, changed([](auto& m) { m.header.robot_id = 5; }));
    expect_refused(Refusal::kTime, bus, channel, changed([](auto& m) { m.header.utime -= 1'000'001; }));
    expect_refused(Refusal::kTime, bus, channel, changed([](auto& m) { m.header.utime += 100'001; }));
  };
  candidate.trajectory.start_utime += 200'000;  // after every header.utime used here
  refuse_each(BusId::kOnboard, channel::kCandidate, candidate);
  refuse_each(BusId::kOnboard, channel::kRobotState, state_at(1, {5, 5, 5}, 9, robot.now));
  announcement_t heard = robot.peers.at(2).message(robot.now, 1);
  heard.pending = Trajectory::hover(50, robot.now + 100ms, {0, 0, 1}).to_wire();
  heard.pending_state = announcement_t::kAnnounced;
  refuse_each(BusId::kSwarm, channel::kAnnouncement, heard);
  heard.header.seq = 0;  // as the one heard already
  expect_refused(Refusal::kSequence, BusId::kSwarm, channel::kAnnouncement, packed(heard));
  expect_refused(Refusal::kSequence, BusId::kOnboard, channel::kRobotState,
                 encoded(state_at(1, {5, 5, 5}, 0, robot.now)));
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

TEST(BroadcastNode, APeerThatSpeaksToAnotherRosterIsRefused) {
  Robot robot(1);
  announcement_t message = robot.peers.at(0).message(robot.now, 1);
  message.roster_crc ^= 1;
  robot.send(channel::kAnnouncement, message, BusId::kSwarm);
  message = robot.peers.at(0).message(robot.now, 1);
  message.acks.push_back({-1, 0, ack_t::kNone});
  message.num_acks = 4;
  message.header.seq = std::int64_t{1} << 40;
  robot.send(channel::kAnnouncement, message, BusId::kSwarm);
  EXPECT_EQ(robot.node.refused()[Refusal::kRobot], 2);
  EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), 2);  // of the start
  robot.hear(0);
  EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), 3) << "what was refused has used up its number";
}

// Nobody commits to a motion so long; to judge it takes time.
TEST(BroadcastNode, RefusesMotionsThatNobodyMayFly) {
  Robot robot(0);
  Peer& peer = robot.peers.at(1);
  peer.pends(quintic_to(peer.committed.at(kStart), robot.now + 100ms, {1.3, 0, 1}, 9.91), robot.now);
  robot.hear(1);
  EXPECT_EQ(robot.node.refused()[Refusal::kInconsistent], 1);
  peer.pends(quintic_to(peer.committed.at(kStart), robot.now + 100ms, {1.3, 0, 1}, 9.89), robot.now);
  robot.hear(1);
  EXPECT_EQ(robot.node.refused().total(), 1);
}

// However fast peers speak: of each the newest counts, about as often as it may speak, and setpoints keep their rate.
// What it said last is not lost.
TEST(BroadcastNode, JudgesTheNewestOfAFlood) {
  MemoryPromiseStore promises;
  BroadcastConfig config = Robot::make_config(0);
  config.swarm_rate_hz = 1000;  // three robots: one announcement of each in 3 ms
  Bench<BroadcastNode> robot(config, promises, kBoot);
  robot.send(channel::kRobotState, state_at(0, {0, 0, 1}, 0, robot.now));
  Peer peer{1, Trajectory::hover(1, kStart, {20, 0, 1})}, other{2, Trajectory::hover(1, kStart, {30, 0, 1})};
  const int setpoints = robot.out.count(channel::kSetpoint);
  Utime last_setpoint = robot.now;
  for (int i = 0; i < 20'000; ++i) {  // in a second, a new trajectory each time
    peer.pends(quintic_to(peer.committed.at(kStart), robot.now + 100ms, {20, 1, 1}, 2.0, 5, i + 1), robot.now);
    robot.node.on_message(robot.now, BusId::kSwarm, channel::kAnnouncement, packed(peer.message(robot.now, 0)),
                          robot.out);
    if (i % 3 == 0) robot.step();
    const int before = robot.out.count(channel::kSetpoint);
    robot.run_for(50e-6);
    if (robot.out.count(channel::kSetpoint) == before) continue;
    EXPECT_LE(robot.now - last_setpoint, 11ms);
    last_setpoint = robot.now;
  }
  EXPECT_NEAR(robot.out.count(channel::kSetpoint) - setpoints, 100, 1);
  const int relayed = robot.out.count(channel::kPeerTrajectory);
  EXPECT_NEAR(relayed, 1000 / 1.5, 5);
  EXPECT_EQ(robot.node.lost(), 0);
  EXPECT_EQ(robot.node.refused().total(), 0);
  robot.send(channel::kAnnouncement, other.message(robot.now, 0), BusId::kSwarm);
  EXPECT_EQ(robot.out.newest<announcement_t>(channel::kPeerTrajectory).header.robot_id, 2) << "waits for another";
  robot.run_for(0.01);
  EXPECT_EQ(robot.node.protocol().peers().at(1).judged_seq, peer.pending.seq());
}

// Of many peers at once few are judged before the robot's own work is done.
TEST(BroadcastNode, JudgesFewPeersAtOnce) {
  MemoryPromiseStore promises;
  BroadcastConfig config;
  config.roster = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  Bench<BroadcastNode> robot(config, promises, kBoot);
  robot.send(channel::kRobotState, state_at(0, {0, 0, 1}, 0, robot.now));
  Bytes roster;
  for (const int id : config.roster) roster.insert(roster.end(), {0, static_cast<std::uint8_t>(id)});
  for (int id = 1; id < 10; ++id) {
    announcement_t message = Peer{id, Trajectory::hover(1, kStart, {20.0 + id, 0, 1})}.message(robot.now, 0);
    message.roster_crc = static_cast<std::int32_t>(crc32(roster));
    message.num_acks = 10;
    message.acks.assign(10, {-1, 0, ack_t::kNone});
    robot.node.on_message(robot.now, BusId::kSwarm, channel::kAnnouncement, packed(message), robot.out);
  }
  for (const int relayed : {4, 8, 9}) {
    robot.step();
    EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), relayed);
    EXPECT_EQ(robot.wake == robot.now + 1us, relayed < 9);
  }
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
  robot.agree();
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
  robot.peers.at(0).seq = std::numeric_limits<std::int64_t>::max() - 1;
  robot.hear(0);
  EXPECT_EQ(robot.node.lost(), 1'000'000);  // of a peer, at most
}

}  // namespace
}  // namespace swarm::test
