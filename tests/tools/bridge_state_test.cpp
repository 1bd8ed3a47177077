// The flight controller's state through the bridge, what its log says, and a recorded flight there and back.
#include <limits>
#include <numbers>

#include "lcmtypes/bus/lcm_log.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/results/recorder.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/bridge_flight.h"
#include "tools/bridge/bridge_log.h"

namespace swarm::test {
namespace {

using sogm_swarm::robot_state_t;
using sogm_swarm::setpoint_t;

TEST(Bridge, TellsTheRobotsState) {
  BridgeConfig config = make_config();
  config.origin = {10, 0, 0};
  config.state_delay_s = 0.02;
  Flight flight(config);
  flight.hear(mavlink::LocalPositionNed{100, {1, 2, -3}, {0.1f, 0.2f, -0.3f}});
  EXPECT_EQ(flight.refused(StateRefusal::kNoAttitude), 1);
  mavlink::Attitude attitude;
  attitude.time_boot_ms = 105;
  attitude.yaw = 0.5f;
  flight.hear(attitude);
  flight.hear(mavlink::LocalPositionNed{110, {1, 2, -3}, {0.5f, 0.25f, -0.75f}});
  ASSERT_EQ(flight.states(), 1);
  const auto state = flight.out.newest<robot_state_t>(channel::kRobotState);
  EXPECT_EQ(state.header.robot_id, kRobot);
  EXPECT_EQ(state.header.boot, kBoot);
  EXPECT_EQ(to_utime(state.header.utime), flight.now - 20ms);
  EXPECT_EQ(Eigen::Vector3d(state.position), Eigen::Vector3d(11, -2, 3));
  EXPECT_EQ(Eigen::Vector3d(state.velocity), Eigen::Vector3d(0.5, -0.25, 0.75));
  EXPECT_EQ(state.yaw, -0.5);

  const float nan = std::numeric_limits<float>::quiet_NaN();
  flight.hear(mavlink::LocalPositionNed{120, {1, nan, -3}, {}});
  flight.hear(mavlink::LocalPositionNed{130, {1, 2, 3}, {0, 1e20f, 0}});
  attitude.time_boot_ms = 140;
  attitude.yaw = nan;
  flight.hear(attitude);
  EXPECT_EQ(flight.refused(StateRefusal::kValue), 3);
  flight.run_for(0.51);
  flight.hear(mavlink::LocalPositionNed{640, {1, 2, 3}, {}});
  EXPECT_EQ(flight.refused(StateRefusal::kNoAttitude), 2);
  EXPECT_EQ(flight.states(), 1);

  config.publish_state = false;
  Flight silent(config);
  silent.autopilot.report_state(100);
  EXPECT_EQ(silent.states(), 0);
}

// As motion capture sees it; what the controller says of itself is not told back to it.
TEST(Bridge, TellsTheControllerWhereTheRobotIs) {
  BridgeConfig config = make_config();
  config.origin = {10, 0, 0};
  config.passes_state = true;
  EXPECT_THROW((void)Flight(config), OptionError);
  config.publish_state = false;
  Flight flight(config);
  robot_state_t state = state_at(kRobot, {11, -2, 3}, 1, flight.now - 20ms);
  state.yaw = -0.5;
  flight.send(channel::kRobotState, state);
  ASSERT_EQ(flight.autopilot.poses.size(), 1u);
  const mavlink::VisionPositionEstimate& pose = flight.autopilot.poses[0];
  EXPECT_EQ(pose.time_us, static_cast<std::uint64_t>(state.header.utime));
  EXPECT_EQ(pose.position, (std::array{1.0f, 2.0f, -3.0f}));
  EXPECT_EQ((std::array{pose.roll, pose.pitch, pose.yaw}), (std::array{0.0f, 0.0f, 0.5f}));
  flight.send(channel::kRobotState, state);  // again
  flight.send(channel::kRobotState, state_at(kRobot + 1, {11, -2, 3}, 2, flight.now));
  flight.send(channel::kRobotState, state_at(kRobot, {11, -2, 3}, 3, flight.now - 250ms));
  flight.send(channel::kRobotState, state_at(kRobot, {11, std::nan(""), 3}, 4, flight.now));
  EXPECT_EQ(flight.autopilot.poses.size(), 1u);
  flight.autopilot.report_state(100);
  EXPECT_EQ(flight.autopilot.poses.size(), 1u);
  EXPECT_EQ(flight.states(), 0) << "none is published";
}

TEST(Bridge, RefusesOldStatesAndNoticesARestart) {
  Flight flight;
  const auto report = [&](std::uint32_t time_ms) {
    flight.run_for(0.02);
    const int before = flight.states();
    flight.autopilot.report_state(time_ms);
    return flight.states() - before;
  };
  EXPECT_EQ(report(60'000), 1);
  EXPECT_EQ(report(60'000), 0);
  EXPECT_EQ(report(59'980), 0);
  EXPECT_EQ(report(60'020), 1);
  EXPECT_EQ(flight.refused(StateRefusal::kOld), 4);  // attitudes as well
  EXPECT_EQ(report(30'000), 0);                      // a stray
  EXPECT_EQ(report(60'040), 1);
  EXPECT_EQ(flight.node.report().restarts, 0);
  EXPECT_EQ(report(500), 0);
  EXPECT_EQ(report(520), 1);
  EXPECT_EQ(flight.node.report().restarts, 1);
  EXPECT_EQ(report(510), 0);
  EXPECT_EQ(report(540), 1);
  EXPECT_EQ(flight.node.report().restarts, 1);

  Flight old;  // on for 49.7 days, when its clock begins anew
  old.autopilot.report_state(0xFFFFFFF0u);
  old.autopilot.report_state(4);
  EXPECT_EQ(old.states(), 2);
  EXPECT_EQ(old.node.report().restarts, 0);
}

TEST(Bridge, KnowsWhetherTheControllerIsThereAndArmed) {
  Flight flight;
  EXPECT_FALSE(flight.node.report().heard_utime);
  flight.autopilot.report_heartbeat(false);
  EXPECT_EQ(flight.node.report().heard_utime, flight.now);
  EXPECT_FALSE(flight.node.report().controller.armed());
  flight.autopilot.report_heartbeat(true);
  EXPECT_TRUE(flight.node.report().controller.armed());
  mavlink::Heartbeat camera;
  camera.autopilot = mavlink::Heartbeat::kNone;
  flight.hear(camera);
  EXPECT_TRUE(flight.node.report().controller.armed());
}

TEST(BridgeLog, TellsWhetherAttitudesCanBeTold) {
  BridgeConfig config = make_config();
  config.targets = "attitude";
  Flight flight(config);
  BridgeLog log;
  const auto says = [&](const char* text, bool warning) {
    for (const LogLine& line : log.update(flight.now, flight.node.report(), LinkReport(), flight.ears))
      if (line.text.find(text) != line.text.npos) return line.warning == warning;
    return false;
  };
  flight.say_setpoint(at_rest({0, 0, 1}));
  EXPECT_TRUE(says("no state of the robot: the controller is told positions", true));
  flight.hear(mavlink::LocalPositionNed{100, {0, 0, -1}, {}});
  flight.run_for(0.01);
  flight.say_setpoint(at_rest({0, 0, 1}));
  EXPECT_TRUE(says("the controller is told attitudes again", false));
  EXPECT_FALSE(says("attitudes", false));
}

TEST(BridgeLog, TellsChangesOnceAndTheStateOfThingsEveryTenSeconds) {
  Flight flight;
  BridgeLog log;
  LinkReport link;
  const auto lines = [&] {
    std::string all;
    for (const LogLine& line : log.update(flight.now, flight.node.report(), link, flight.ears))
      all += (line.warning ? "! " : "- ") + line.text + "\n";
    return all;
  };
  EXPECT_EQ(lines(), "");
  link.connected = true;
  link.peer = "127.0.0.1:14580";
  flight.autopilot.report_heartbeat(false);
  EXPECT_EQ(lines(),
            "- link to 127.0.0.1:14580\n- the controller is there\n- the controller is disarmed, offboard mode\n");
  flight.autopilot.report_heartbeat(true);
  EXPECT_EQ(lines(), "- the controller is armed, offboard mode\n");
  flight.fly(Trajectory::hover(1, flight.now, {0, 0, 1}), 0.5);
  EXPECT_EQ(lines(), "- following setpoints\n");
  EXPECT_EQ(lines(), "");
  flight.run_for(0.2);
  EXPECT_EQ(lines(), "! following the committed trajectory\n");
  flight.run_for(4.0);
  EXPECT_EQ(lines(),
            "! the controller is silent\n! broadcast daemon gone, trajectory ended: nothing is sent any more\n");
  flight.run_for(5.3);
  flight.autopilot.report_state(100);
  flight.autopilot.report_state(90);
  const std::string summary = lines();
  for (const char* part : {"controller heard 10.0 s ago, armed, offboard mode", "50 setpoints (0 late)",
                           "refused from the bus: none", "states not passed on: old 2", "1 states"})
    EXPECT_NE(summary.find(part), summary.npos) << part << "\n" << summary;
  EXPECT_EQ(lines(), "");
  flight.now += 1ms;
  flight.say_setpoint(at_rest({0, 0, 2.5}));
  flight.hear(mavlink::LocalPositionNed{120, {0, 0, -1}, {}});
  EXPECT_EQ(lines(),
            "- following setpoints\n! the robot is 1.5 m from its target: do not switch to the mode that goes there\n");
  flight.hear(mavlink::LocalPositionNed{140, {0, 0, -1.9f}, {}});
  EXPECT_EQ(lines(), "");
  flight.hear(mavlink::LocalPositionNed{160, {0, 0, -2.1f}, {}});
  EXPECT_EQ(lines(), "- the robot is at its target\n");
  link.connected = false;
  link.peer = "/dev/ttyTHS1";
  link.lost = 1;
  EXPECT_EQ(lines(), "! lost /dev/ttyTHS1; it is tried again every second\n");
  link.connected = true;
  link.lost = 2;  // back, gone and back
  EXPECT_EQ(lines(), "! lost /dev/ttyTHS1; it is tried again every second\n- link to /dev/ttyTHS1\n");
  EXPECT_EQ(lines(), "");
}

// Through the bridge, over the wire, to the autopilot and back: the robot is where its setpoints were.
TEST(Bridge, ARecordedFlightComesBackAsItWasMeant) {
  TemporaryDirectory directory;
  const World world = make_world(Task::kCircle, Environment::kPure, 6, 1, {.robots = 2, .circle_m = 2.5});
  BusLog logs(directory.path(), {0, 1});
  FlightOptions options;
  options.time_limit_s = 4.0;
  run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
  logs.close();

  BridgeConfig config = make_config();
  config.robot_id = 1;
  config.north_rad = 0.7;
  config.origin = {3, -4, 0.5};
  Flight flight(config);
  LcmLog log(directory / "robot1.lcm");
  int setpoints = 0;
  double farthest_m = 0.0;
  for (LogEvent event; log.next(&event);) {
    if (event.channel != channel::kSetpoint && event.channel != channel::kOwnTrajectory) continue;
    if (flight.now > event.utime || setpoints == 0) flight.now = event.utime;  // the flight's own time
    flight.run_until(event.utime);
    flight.deliver(BusId::kOnboard, event.channel, event.bytes);
    if (event.channel != channel::kSetpoint) continue;
    setpoint_t setpoint;
    ASSERT_EQ(decode(event.bytes, &setpoint), Refusal::kNone);
    ++setpoints;
    flight.autopilot.report_state(static_cast<std::uint32_t>(10 * setpoints));
    const auto state = flight.out.newest<robot_state_t>(channel::kRobotState);
    flight.out.letters.clear();
    const Eigen::Vector3d meant(setpoint.position);
    ASSERT_LT((Eigen::Vector3d(state.position) - meant).norm(), 2e-6) << setpoints;
    ASSERT_LT((Eigen::Vector3d(state.velocity) - Eigen::Vector3d(setpoint.velocity)).norm(), 1e-6) << setpoints;
    ASSERT_NEAR(std::remainder(state.yaw - setpoint.yaw, 2 * std::numbers::pi), 0.0, 1e-6) << setpoints;
    ASSERT_EQ(to_utime(state.header.utime), event.utime);
    farthest_m = std::max(farthest_m, (meant - world.robots[1].start).norm());
  }
  EXPECT_GT(setpoints, 400);
  EXPECT_GT(farthest_m, 2.0);
  EXPECT_EQ(flight.node.report().setpoints, setpoints);
  EXPECT_EQ(flight.node.report().samples, 0);
  EXPECT_EQ(flight.node.report().refused.total(), 0);
  EXPECT_EQ(flight.node.report().states, setpoints);
}

}  // namespace
}  // namespace swarm::test
