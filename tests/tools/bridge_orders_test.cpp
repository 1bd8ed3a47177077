// The bridge arms, switches, takes off and disarms as the flight's state demands; and tells how the vehicle is.
#include "tests/support/bridge_flight.h"
#include "tools/bridge/bridge_log.h"

namespace swarm::test {
namespace {

using mavlink::CommandLong;
using mavlink::ExtendedSysState;
using mavlink::Heartbeat;
using sogm_swarm::flight_status_t;
using sogm_swarm::vehicle_status_t;

// On the ground at the origin, with a broadcast daemon that hovers there.
struct Ground : Flight {
  explicit Ground(std::uint8_t autopilot_kind = Heartbeat::kPx4, const BridgeConfig& config_in = make_config())
      : Flight(config_in) {
    autopilot.autopilot = autopilot_kind;
  }
  // `landed`: as the controller says.
  void live(double seconds, std::uint8_t landed = ExtendedSysState::kOnGround) {
    for (int i = 0; i < std::lround(10 * seconds); ++i) {
      if (flight_state) say_flight();
      fly(Trajectory::hover(1, now, {0, 0, 0}), 0.1);
      autopilot.report_vehicle(landed);
      autopilot.report_state(time_ms += 100);
    }
  }
  void say_flight() {
    flight_status_t status{};
    status.header = make_header(kRobot, 1, flight_seq++, now);
    status.state = *flight_state;
    status.cause = cause;
    status.climb = 0.5;
    status.order_boot = -1;
    send(channel::kFlightStatus, status);
  }
  int told(std::uint16_t command) const {
    return static_cast<int>(std::ranges::count(autopilot.commands, command, &CommandLong::command));
  }
  vehicle_status_t vehicle() const { return out.newest<vehicle_status_t>(channel::kVehicleStatus); }

  std::optional<std::int16_t> flight_state;
  std::int16_t cause = flight_status_t::kOrdered;
  std::int64_t flight_seq = 0;
  std::uint32_t time_ms = 1000;
};

TEST(BridgeOrders, TellsHowTheVehicleIs) {
  Ground robot;
  robot.run_for(1.0);
  EXPECT_EQ(robot.out.count(channel::kVehicleStatus), 0) << "nothing is known of it";
  robot.live(1.0);
  EXPECT_EQ(robot.vehicle().armed, 0);
  EXPECT_EQ(robot.vehicle().place, vehicle_status_t::kOnGround);
  EXPECT_FLOAT_EQ(robot.vehicle().battery, 0.9f);
  robot.autopilot.is_armed = true;
  robot.autopilot.custom_mode = 6 << 16;
  robot.autopilot.report_vehicle(ExtendedSysState::kInAir, 255);
  robot.run_for(0.3);
  EXPECT_EQ(robot.vehicle().obeys, 1);
  EXPECT_EQ(robot.vehicle().place, vehicle_status_t::kInAir);
  EXPECT_EQ(robot.vehicle().battery, -1.0f);
  const int before = robot.out.count(channel::kVehicleStatus);
  const int steps = robot.steps;
  robot.run_for(10.0);
  EXPECT_LT(robot.steps, steps + 200) << "nor does it spin";
  EXPECT_LE(robot.out.count(channel::kVehicleStatus), before + 16) << "a controller that is silent says nothing";
}

TEST(BridgeOrders, ArmsForATakeOffAndDisarmsAfterTheLanding) {
  Ground robot;
  robot.live(2.0);
  EXPECT_EQ(robot.autopilot.commands.size(), 0u);
  robot.flight_state = flight_status_t::kTakeOff;
  robot.live(2.0);
  EXPECT_TRUE(robot.autopilot.is_armed);
  EXPECT_EQ(robot.autopilot.custom_mode, 6u << 16);
  EXPECT_EQ(robot.told(CommandLong::kSetMode), 1);
  EXPECT_EQ(robot.told(CommandLong::kArm), 1);
  EXPECT_EQ(robot.told(CommandLong::kTakeOff), 0) << "setpoints lead it up";
  EXPECT_EQ(robot.autopilot.commands[0].target_system, 4);
  robot.flight_state = flight_status_t::kFlying;
  robot.live(2.0, ExtendedSysState::kInAir);
  robot.flight_state = flight_status_t::kOnGround;
  robot.cause = flight_status_t::kArrived;
  robot.live(1.0, ExtendedSysState::kInAir);
  EXPECT_TRUE(robot.autopilot.is_armed) << "not in the air, whatever the bus says";
  robot.live(1.0);
  EXPECT_FALSE(robot.autopilot.is_armed);
  EXPECT_EQ(robot.told(CommandLong::kArm), 2);
}

TEST(BridgeOrders, APilotWhoArmsOnTheGroundIsLeftToIt) {
  Ground robot;
  robot.flight_state = flight_status_t::kOnGround;
  robot.cause = flight_status_t::kVehicle;
  robot.autopilot.is_armed = true;
  robot.live(2.0);
  EXPECT_EQ(robot.autopilot.commands.size(), 0u);

  Ground gave_up;
  gave_up.flight_state = flight_status_t::kTakeOff;
  gave_up.live(2.0);
  gave_up.flight_state = flight_status_t::kOnGround;
  gave_up.cause = flight_status_t::kGaveUp;
  gave_up.live(2.0);
  EXPECT_FALSE(gave_up.autopilot.is_armed);
  gave_up.autopilot.is_armed = true;
  gave_up.live(2.0);
  EXPECT_TRUE(gave_up.autopilot.is_armed) << "by its pilot";
}

TEST(BridgeOrders, ArdupilotRisesByACommand) {
  Ground robot(Heartbeat::kArdupilot);
  robot.live(1.0);
  const std::size_t before = robot.targets();
  EXPECT_GT(before, 50u);
  robot.flight_state = flight_status_t::kTakeOff;
  robot.live(3.0);
  EXPECT_EQ(robot.autopilot.custom_mode, 4u);
  EXPECT_TRUE(robot.autopilot.is_armed);
  ASSERT_GE(robot.told(CommandLong::kTakeOff), 2);
  EXPECT_EQ(robot.autopilot.commands.back().parameters[6], 0.5f);
  const std::size_t on_ground = robot.targets();
  robot.live(1.0);
  EXPECT_EQ(robot.targets(), on_ground) << "targets would end it";
  robot.live(1.0, ExtendedSysState::kTakeOff);
  EXPECT_GT(robot.targets(), on_ground + 50);
}

TEST(BridgeOrders, NobodyArmsWhereTheTargetIsFarOrMayNot) {
  BridgeConfig pilots = make_config();
  pilots.arms = false;
  Ground left_alone(Heartbeat::kPx4, pilots);
  left_alone.flight_state = flight_status_t::kTakeOff;
  left_alone.live(2.0);
  EXPECT_EQ(left_alone.autopilot.commands.size(), 0u);

  BridgeConfig elsewhere = make_config();
  elsewhere.origin = {3, 0, 0};
  Ground far(Heartbeat::kPx4, elsewhere);
  far.flight_state = flight_status_t::kTakeOff;
  for (int i = 0; i < 10; ++i) {
    far.say_flight();
    far.say_setpoint(at_rest({0, 0, 0}));
    far.autopilot.report_vehicle(ExtendedSysState::kOnGround);
    far.hear(mavlink::LocalPositionNed{static_cast<std::uint32_t>(100 * i), {0, 0, 0}, {}});
    far.run_for(0.04);
  }
  EXPECT_EQ(far.autopilot.commands.size(), 0u) << "3 m from its target";

  Ground silent;
  silent.live(1.0);
  silent.flight_state = flight_status_t::kTakeOff;
  silent.say_flight();
  silent.run_for(5.0);
  EXPECT_LE(silent.autopilot.commands.size(), 1u) << "the broadcast daemon is gone";
}

TEST(BridgeOrders, WhatTheControllerRefusesIsSaid) {
  Ground robot;
  BridgeLog log;
  robot.autopilot.result = 4;
  robot.live(1.0);
  robot.flight_state = flight_status_t::kTakeOff;
  robot.live(1.0);
  std::string all;
  for (const LogLine& line : log.update(robot.now, robot.node.report(), LinkReport(), robot.ears))
    all += (line.warning ? "! " : "- ") + line.text + "\n";
  EXPECT_NE(all.find("- the controller is told to switch to the mode"), all.npos) << all;
  EXPECT_NE(all.find("! the controller refuses to switch to the mode in which it is led (MAV_RESULT 4)"), all.npos)
      << all;
}

}  // namespace
}  // namespace swarm::test
