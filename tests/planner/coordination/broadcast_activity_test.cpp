// What the broadcast daemon says that it waits for.
#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

std::string activity_of(const Robot& robot) {
  const Activity activity = robot.node.activity(robot.now);
  return (activity.waits ? "waits: " : "") + activity.text + (activity.detail.empty() ? "" : " | " + activity.detail);
}

constexpr char kReady[] = "ready: commits what the planner sends and robots agree to";

TEST(BroadcastActivity, NamesWhoIsMissing) {
  Robot robot(0, false);
  EXPECT_EQ(activity_of(robot), "waits: waits for ROBOT_STATE");
  robot.send_state();
  EXPECT_EQ(activity_of(robot), "waits: waits for robots 1 (never heard), 2 (never heard)");
  robot.hear(2);
  robot.peers.at(1).about_us.peer_boot = kBoot - 1;
  robot.hear(1);
  EXPECT_EQ(activity_of(robot), "waits: waits for robots 1 (has not heard this start)");
  robot.peers.at(1).about_us.peer_boot = kBoot;
  robot.hear(1);
  EXPECT_EQ(activity_of(robot), kReady);
}

TEST(BroadcastActivity, SaysWhyNothingIsCommitted) {
  Robot robot(1);
  const auto peers_speak = [&] { robot.hear(0), robot.hear(2); };
  const auto try_in_vain = [&](int times) {
    for (int i = 0; i < times; ++i) {
      robot.propose(robot.plan({0, 9, 1}, 0.1, 3.0));  // too fast
      robot.run_for(0.5);
      peers_speak();
    }
  };
  robot.run_for(60.0);  // at rest
  peers_speak();
  try_in_vain(6);
  EXPECT_EQ(activity_of(robot), "waits: commits nothing of what the planner sends | 6 candidates, limits 6");
  robot.propose(robot.plan({0.5, 0, 1}, 0.5));
  const std::int32_t refused = robot.announced().pending.seq;
  robot.hear_verdict(2, refused, ack_t::kNack);  // which binds nobody
  robot.hear_verdict(0, refused, ack_t::kNack);
  EXPECT_EQ(activity_of(robot),
            "waits: commits nothing of what the planner sends | 7 candidates, limits 6, refused by robot 0");
  robot.run_for(1.05);
  EXPECT_EQ(activity_of(robot), kReady) << "nobody asks any more";
  robot.propose(robot.plan({0.5, 0, 1}, 0.5));
  EXPECT_EQ(
      activity_of(robot),
      "waits: commits nothing of what the planner sends | 8 candidates, limits 6, robot 0 silent for 1.1 s, refused "
      "by robot 0, robot 2 silent for 1.1 s");
  robot.agree();
  ASSERT_EQ(robot.node.protocol().commits(), 1);
  EXPECT_EQ(activity_of(robot), kReady);
}

TEST(BroadcastActivity, ANewGoalAfterALongRestIsNotInVain) {
  Robot robot(1);
  robot.run_for(60.0);
  robot.propose(robot.plan({0.5, 0, 1}, 0.5));
  EXPECT_EQ(activity_of(robot), kReady);
}

// What came before the robot could commit at all is no reason.
TEST(BroadcastActivity, BeginsWhenItIsReady) {
  Robot robot(0, false);
  robot.send_state();
  for (int i = 0; i < 5; ++i) {
    robot.propose(robot.plan({1, 0, 1}));
    robot.run_for(1.0);
  }
  EXPECT_EQ(robot.node.rejected(Rejection::kWaiting), 5);
  robot.hear(1);
  robot.hear(2);
  EXPECT_EQ(activity_of(robot), kReady);
}

TEST(BroadcastActivity, TellsOfATwin) {
  Robot robot(0);
  robot.run_for(1.0);
  Peer twin{0, Trajectory::hover(1, kStart, {3, 3, 1})};
  twin.boot = kBoot + 1;
  robot.send(channel::kAnnouncement, twin.message(robot.now, 0), BusId::kSwarm);
  EXPECT_EQ(activity_of(robot), "waits: commits nothing: another broadcaster speaks as robot 0");
}

TEST(BroadcastActivity, TellsWhoseClockIsWrong) {
  Robot robot(0);
  const auto announced_ahead = [&](int other, Duration ahead) {
    robot.send(channel::kAnnouncement, robot.peers.at(other).message(robot.now + ahead, 0), BusId::kSwarm);
  };
  robot.run_for(0.1);
  announced_ahead(2, 48ms);
  EXPECT_EQ(activity_of(robot), "waits: commits nothing: clocks differ | robot 2's is 48.0 ms ahead");
  robot.peers.at(1).least_delay_us = 21'000;  // of our messages, by its clock
  for (int i = 0; i < 500; ++i) {
    robot.run_for(0.02);
    announced_ahead(1, -81ms);
  }
  EXPECT_EQ(activity_of(robot), "waits: commits nothing: clocks differ | robot 1's is 30.0 ms behind");
}

TEST(BroadcastActivity, TellsOfAClockThatWasSet) {
  Robot robot(0);
  robot.propose(robot.plan({1, 0, 1}));
  robot.run_for(0.2);
  EXPECT_FALSE(robot.node.on_clock_step(robot.now, 1h));
  EXPECT_EQ(activity_of(robot), "waits: commits only what is urgent until it rests: the clock was set");
  robot.run_for(5.0);
  EXPECT_TRUE(robot.node.on_clock_step(robot.now, -1h));
  robot.now -= 1h;
  EXPECT_EQ(activity_of(robot), "waits: commits nothing: the clock was set | peers' clocks are measured anew");
}

}  // namespace
}  // namespace swarm::test
