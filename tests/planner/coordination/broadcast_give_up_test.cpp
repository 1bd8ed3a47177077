// A robot that others do not hear any more: it is given up, the others go on around it, and it may come back.
#include "lcmtypes/bus/packed_announcement.h"
#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

using sogm_swarm::last_words_t;

// Robot 0 of three, which gives up whom it does not hear.
class Survivor : public Robot {
 public:
  explicit Survivor(MemoryPromiseStore store = {}) : Robot(0, false, store, kBoot, {}, 2.0) { send_state(); }
  // Robot `other` speaks on, and silent ones do not.
  void fly_with(int other, double seconds) {
    for (const Utime end = now + to_duration(seconds); now < end;) {
      hear(other);
      run_for(0.1);
      send_state();
    }
  }
  ack_t about(int other) { return verdict_on(other); }
  // Peer `voter` gives up robot `other`, of which it knows announcements up to `seq`.
  void votes(int voter, int other, std::int32_t boot, std::int32_t seq) {
    announcement_t message = peers.at(voter).message(now, 0);
    message.acks[static_cast<std::size_t>(other)] = {boot, seq, ack_t::kGivenUp};
    send(channel::kAnnouncement, message, BusId::kSwarm);
  }
};

TEST(BroadcastGiveUp, GoesOnWhereTheMajorityDoesNotHearOne) {
  Survivor robot;
  robot.hear(1), robot.hear(2);
  robot.fly_with(1, 1.8);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kNone);
  EXPECT_EQ(robot.node.protocol().state().acks[2].peer_boot, 9);
  robot.fly_with(1, 0.5);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kGivenUp);
  EXPECT_EQ(robot.about(2).judged_seq, 0);
  EXPECT_FALSE(robot.node.protocol().peers().at(2).given_up) << "alone it is no majority";
  robot.votes(1, 2, 9, 3);
  EXPECT_FALSE(robot.node.protocol().peers().at(2).given_up) << "robot 1 knows more of it";
  robot.votes(1, 2, 9, 0);
  EXPECT_TRUE(robot.node.protocol().peers().at(2).given_up);
  robot.peers_agree = false;
  robot.propose(robot.plan({1, 0, 1}));
  robot.hear_verdict(1, robot.node.protocol().pending().seq(), ack_t::kAck);
  EXPECT_EQ(robot.node.protocol().commits(), 1);
  EXPECT_EQ(robot.node.activity(robot.now).text,
            "ready: commits what the planner sends and robots agree to; goes on without robots 2");
}

TEST(BroadcastGiveUp, AnotherOneIsWaitedForInItsPlace) {
  CommitProtocol protocol({.robot_id = 2, .boot = kBoot, .roster = {0, 1, 2}});
  protocol.start({Trajectory::hover(1, kStart, {20, 0, 1}), {}});
  const auto keep = [](const announcement_t&) { return true; };
  Peer first{0, Trajectory::hover(1, kStart, {0, 0, 1})}, second{1, Trajectory::hover(1, kStart, {10, 0, 1})};
  protocol.receive(kStart, second.message(kStart, 2), keep);
  const auto is_answered_at_once = [&](std::int32_t seq, const ack_t& about_second) {
    (void)protocol.take_news();
    first.pends(quintic_to(first.committed.at(kStart), kStart + 500ms, {0, 3, 1}, 5, 5, seq), kStart);
    announcement_t message = first.message(kStart, 2);
    message.acks[1] = about_second;
    protocol.receive(kStart, message, keep);
    return protocol.take_news() == CommitProtocol::News::kAnswers;
  };
  protocol.receive(kStart, first.message(kStart, 2), keep);
  EXPECT_FALSE(is_answered_at_once(1, {9, 0, ack_t::kNone})) << "robots 0 and 1 are a majority";
  ASSERT_TRUE(protocol.give_up(1, keep));
  (void)is_answered_at_once(2, {9, 0, ack_t::kGivenUp});
  ASSERT_TRUE(protocol.peers().at(1).given_up);
  EXPECT_TRUE(is_answered_at_once(3, {9, 0, ack_t::kGivenUp}));
}

TEST(BroadcastGiveUp, AVoteOutlivesACrash) {
  Survivor before;
  before.hear(1), before.hear(2);
  before.fly_with(1, 2.3);
  ASSERT_EQ(before.about(2).verdict, ack_t::kGivenUp);
  Survivor robot(before.promises);
  robot.peers = before.peers;
  robot.hear(1);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kNone) << "what it may fly is not known any more";
  EXPECT_EQ(robot.about(2).peer_boot, 9);
  Peer& peer = robot.peers.at(2);
  peer.pends(quintic_to(peer.committed.at(kStart), robot.now + 500ms, {30, 3, 1}, 5), robot.now);
  robot.hear(2);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kGivenUp) << "it is not answered, ever";
  EXPECT_EQ(robot.about(2).judged_seq, 1);
  ++peer.boot;
  robot.hear(2);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kAck) << "it has come back";
}

TEST(BroadcastGiveUp, LastWordsAreRepeatedForThoseWhoKnowLess) {
  Survivor robot;
  robot.hear(1), robot.hear(2);
  const announcement_t last = robot.peers.at(2).message(robot.now, 0);
  robot.send(channel::kAnnouncement, last, BusId::kSwarm);
  robot.fly_with(1, 2.3);
  robot.out.letters.clear();
  robot.votes(1, 2, 9, 0);
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.count(channel::kLastWords, BusId::kSwarm), 2);
  EXPECT_EQ(robot.out.count(channel::kPeerTrajectory), 3) << "with robot 1's, for a planner that starts now";
  announcement_t repeated;
  ASSERT_EQ(unpack(robot.out.newest<last_words_t>(channel::kLastWords, BusId::kSwarm), &repeated), Refusal::kNone);
  EXPECT_EQ(encoded(repeated), encoded(last));
  robot.votes(1, 2, 9, 1);
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.count(channel::kLastWords, BusId::kSwarm), 2);
}

TEST(BroadcastGiveUp, LastWordsAreNoSignOfLife) {
  Survivor robot;
  robot.hear(1);
  announcement_t last = robot.peers.at(2).message(robot.now - 60s, 0);
  last_words_t words = last_words_of(&last);
  words.header = make_header(1, 9, 0, robot.now);
  robot.send(channel::kLastWords, words, BusId::kSwarm);
  EXPECT_TRUE(robot.node.protocol().peers().at(2).heard);
  EXPECT_EQ(robot.about(2).peer_boot, 9);
  robot.fly_with(1, 10.3);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kGivenUp);
}

// Its receiver is dead: it speaks on, but judges nothing.
TEST(BroadcastGiveUp, WhoDoesNotAnswerIsGivenUp) {
  Survivor robot;
  robot.hear(1), robot.hear(2);
  robot.peers_agree = false;
  for (int i = 0; i < 25; ++i) {  // robot 2 is not asked between the plans
    robot.propose(robot.plan({0, 0.05 * (i % 2), 1}, 0.15, 1.0));
    robot.hear_verdict(1, robot.node.protocol().pending().seq(), ack_t::kAck);
    robot.run_for(0.1);
    robot.hear(2), robot.send_state();
    ASSERT_EQ(robot.about(2).verdict, ack_t::kNone) << i << ": nothing was asked for long";
    robot.run_for(0.1);
  }
  EXPECT_EQ(robot.node.protocol().commits(), 25);
  const auto ask = [&](double seconds) {
    for (const Utime end = robot.now + to_duration(seconds); robot.now < end;) {
      robot.propose(robot.plan({0, 0.1, 1}, 0.5));
      for (int i = 0; i < 4; ++i) {
        robot.run_for(0.1);
        robot.hear(1), robot.hear(2), robot.send_state();
      }
    }
  };
  ask(1.2);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kNone);
  robot.hear_verdict(2, robot.node.protocol().pending().seq(), ack_t::kNack);
  ask(1.2);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kNone) << "it has answered meanwhile";
  ask(2.0);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kGivenUp);
}

TEST(BroadcastGiveUp, WhoseClockIsWrongIsGivenUp) {
  Survivor robot;
  const auto fly = [&](double seconds) {
    for (const Utime end = robot.now + to_duration(seconds); robot.now < end;) {
      robot.hear(1);
      robot.peers.at(1).least_delay_us = 1000;
      Peer& late = robot.peers.at(2);
      late.least_delay_us = -39'000;
      robot.send(channel::kAnnouncement, late.message(robot.now - 40ms, 0), BusId::kSwarm);
      robot.run_for(0.02);
      robot.send_state();
    }
  };
  fly(1.5);
  EXPECT_EQ(robot.node.activity(robot.now).text, "commits nothing: clocks differ");
  EXPECT_EQ(robot.about(2).verdict, ack_t::kNone);
  fly(1.5);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kGivenUp);
  robot.votes(1, 2, 9, 1000);
  ASSERT_FALSE(robot.node.protocol().peers().at(2).given_up) << "robot 1 knows more of it";
  robot.votes(1, 2, 9, 0);
  ASSERT_TRUE(robot.node.protocol().peers().at(2).given_up);
  fly(10.0);
  EXPECT_EQ(robot.node.activity(robot.now).text,
            "ready: commits what the planner sends and robots agree to; goes on without robots 2");
  robot.votes(2, 0, kBoot, 5);
  robot.run_for(0.001);
  EXPECT_EQ(robot.announced().header.boot, kBoot) << "what it says of others counts for nothing";
}

TEST(BroadcastGiveUp, TheOperatorsWordIsEnough) {
  Survivor robot;
  robot.hear(1), robot.hear(2);
  sogm_swarm::order_t order{};
  order.order = sogm_swarm::order_t::kWithout;
  const auto tell = [&](int other) {
    order.header = make_header(0, 1, order.header.seq + 1, robot.now);
    order.other_id = static_cast<std::int16_t>(other);
    robot.send(channel::kFlightOrder, order);
    const auto flight = robot.out.newest<sogm_swarm::flight_status_t>(channel::kFlightStatus);
    EXPECT_EQ(flight.order_seq, order.header.seq);
    return flight.verdict;
  };
  EXPECT_EQ(tell(5), sogm_swarm::flight_status_t::kNotNow) << "it is not in the roster";
  EXPECT_EQ(robot.about(2).verdict, ack_t::kNone);
  EXPECT_EQ(tell(2), sogm_swarm::flight_status_t::kAccepted);
  EXPECT_EQ(robot.about(2).verdict, ack_t::kGivenUp);
  EXPECT_EQ(tell(2), sogm_swarm::flight_status_t::kAccepted) << "once more";
  robot.votes(1, 2, 9, 0);
  EXPECT_TRUE(robot.node.protocol().peers().at(2).given_up);
}

TEST(BroadcastGiveUp, WhoWasGivenUpStartsAnew) {
  Survivor robot;
  robot.hear(1), robot.hear(2);
  robot.votes(1, 0, kBoot, 5);
  robot.run_for(0.001);
  EXPECT_EQ(robot.announced().header.boot, kBoot + 1);
  EXPECT_EQ(load_promise(robot.promises, 0, 1).boot, kBoot + 2);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.rejected(Rejection::kWaiting), 1);
  robot.votes(1, 0, kBoot + 1, 5);  // not again at once, whoever says so
  robot.run_for(0.001);
  EXPECT_EQ(robot.announced().header.boot, kBoot + 1);
  for (auto& [id, peer] : robot.peers) peer.about_us.peer_boot = kBoot + 1, robot.hear(id);
  robot.propose(robot.plan({1, 0, 1}));
  EXPECT_EQ(robot.node.protocol().commits(), 1);
}

}  // namespace
}  // namespace swarm::test
