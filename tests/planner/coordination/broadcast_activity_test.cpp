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
  robot.propose(robot.plan({1, 0, 1}, 0.5));
  robot.hear_verdict(0, 2, ack_t::kAck);
  ASSERT_EQ(robot.node.protocol().commits(), 1);
  robot.run_for(2.5);
  EXPECT_EQ(activity_of(robot), kReady);
  const auto try_in_vain = [&](double seconds) {
    for (double t = 0.0; t < seconds; t += 0.5) {
      robot.propose(robot.plan({0, 9, 1}, 0.1, 3.0));  // too fast
      robot.run_for(0.5);
    }
  };
  try_in_vain(0.4);
  EXPECT_EQ(activity_of(robot), "waits: commits nothing: limits | 1 candidates since the last commit");
  const Trajectory again = robot.plan({0.5, 0, 1}, 0.5);
  robot.propose(again);
  robot.hear_verdict(0, robot.announced().pending.seq, ack_t::kNack);
  EXPECT_EQ(activity_of(robot),
            "waits: commits nothing: limits; refused by robot 0 | 2 candidates since the last commit");
  robot.propose(robot.plan({0.5, 0, 1}, 0.5));
  robot.hear_verdict(0, robot.announced().pending.seq, ack_t::kAck);
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
  robot.send(channel::kTrajectory, twin.message(robot.now, 0), BusId::kSwarm);
  EXPECT_EQ(activity_of(robot), "waits: commits nothing: another broadcaster speaks as robot 0");
}

TEST(BroadcastActivity, TellsOfClocks) {
  Robot robot(0);
  robot.node.on_clock_step(robot.now, 0us);
  robot.propose(robot.plan({1, 0, 1}));
  robot.run_for(0.2);
  EXPECT_FALSE(robot.node.on_clock_step(robot.now, 1h));
  EXPECT_EQ(activity_of(robot),
            "waits: commits nothing until it rests: the clock was set | by how much is not known yet");
}

}  // namespace
}  // namespace swarm::test
