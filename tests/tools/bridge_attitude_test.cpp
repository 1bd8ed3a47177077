// The bridge tells a flight controller attitudes and thrust instead of places, and closes the position loop itself.
#include <numbers>

#include "tests/support/bridge_flight.h"

namespace swarm::test {
namespace {

// The robot hangs 0.1 m west of where it is to hover, with its nose to the east.
TEST(Bridge, TellsTheControllerAttitudes) {
  BridgeConfig config = make_config();
  config.targets = "attitude";
  Flight flight(config);
  const auto report = [&](std::uint32_t time_ms, const std::array<float, 3>& velocity) {
    flight.autopilot.report_heartbeat(true);
    flight.hear(mavlink::LocalPositionNed{time_ms, {1, -0.1f, -1}, velocity});
  };
  report(100, {});
  flight.say_setpoint(at_rest({1, 0, 1}), -std::numbers::pi / 2);
  EXPECT_EQ(flight.targets(), 0u);
  ASSERT_EQ(flight.autopilot.attitudes.size(), 1u);
  const mavlink::SetAttitudeTarget& target = flight.autopilot.attitudes.back();
  const double lean = std::atan2(0.1 * (config.gains.position_per_s2 + 0.05 * config.gains.integral_per_s3), 9.81);
  const Eigen::Quaterniond wanted = Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ()) *
                                    Eigen::AngleAxisd(-lean, Eigen::Vector3d::UnitY());  // nose down
  const Eigen::Quaternionf turn(target.turn[0], target.turn[1], target.turn[2], target.turn[3]);
  EXPECT_LT(turn.cast<double>().angularDistance(wanted), 1e-5);
  EXPECT_NEAR(target.thrust, 0.5 / std::cos(lean), 1e-6);
  EXPECT_EQ(target.type_mask, 0);
  EXPECT_EQ(target.target_system, 4);
  EXPECT_EQ(target.target_component, 1);
  EXPECT_LT(to_vector(target.rates).norm(), 1e-6);

  // What stays amiss adds up while the controller obeys; a state is carried on by its velocity.
  const auto thrust_north = [&] {
    const mavlink::SetAttitudeTarget& newest = flight.autopilot.attitudes.back();
    const Eigen::Quaternionf t(newest.turn[0], newest.turn[1], newest.turn[2], newest.turn[3]);
    const Eigen::Vector3f down = t * Eigen::Vector3f::UnitZ();
    return -9.81 * down.x() / down.z();
  };
  report(120, {0.5f, 0, 0});
  flight.run_for(0.04);
  flight.say_setpoint(at_rest({1, 0, 1}));
  EXPECT_NEAR(thrust_north(),
              -0.5 * config.gains.velocity_per_s - 0.02 * config.gains.position_per_s2 -
                  0.04 * 0.02 * config.gains.integral_per_s3,
              1e-4);
}

// On the ground, and in a mode of its own, the controller obeys nobody: what is amiss then is forgotten.
TEST(Bridge, WhatIsAmissAddsUpOnlyWhileTheControllerObeys) {
  BridgeConfig config = make_config();
  config.targets = "attitude";
  mavlink::Heartbeat offboard, guided, ground, loiter, other;
  offboard.autopilot = ground.autopilot = loiter.autopilot = mavlink::Heartbeat::kPx4;
  guided.autopilot = mavlink::Heartbeat::kArdupilot, guided.custom_mode = 4;
  offboard.custom_mode = ground.custom_mode = 6 << 16, loiter.custom_mode = 4 << 16;
  other.autopilot = 1;  // whose modes are not known here
  for (mavlink::Heartbeat* const armed : {&offboard, &guided, &loiter, &other})
    armed->base_mode = mavlink::Heartbeat::kArmed;
  const auto thrust_after = [&](const mavlink::Heartbeat& heartbeat) {
    Flight flight(config);
    for (std::uint32_t i = 0; i < 100; ++i) {
      flight.hear(heartbeat);
      flight.hear(mavlink::LocalPositionNed{100 + 10 * i, {0, 0, -0.9f}, {}});
      flight.say_setpoint(at_rest({0, 0, 1}));
      flight.run_for(0.01);
    }
    return flight.autopilot.attitudes.back().thrust;
  };
  const float without = thrust_after(ground);
  EXPECT_EQ(thrust_after(loiter), without);
  for (const mavlink::Heartbeat& obeying : {offboard, guided, other}) EXPECT_GT(thrust_after(obeying), without + 0.01f);
}

// Where the robot is unknown its controller is told positions: it may know.
TEST(Bridge, WithoutAStateAttitudesGiveWayToPositions) {
  BridgeConfig config = make_config();
  config.targets = "attitude";
  config.state_delay_s = 0.03;
  Flight flight(config);
  const Trajectory hover = Trajectory::hover(1, flight.now, {0, 0, 1});
  flight.fly(hover, 0.1);
  EXPECT_TRUE(flight.node.report().blind);
  EXPECT_EQ(flight.targets(), 10u);
  flight.hear(mavlink::LocalPositionNed{100, {0, 0, -1}, {}});
  flight.fly(hover, 0.2);  // the newest state is 0.03 s old when it comes
  EXPECT_FALSE(flight.node.report().blind);
  EXPECT_EQ(flight.targets(), 10u);
  EXPECT_EQ(flight.autopilot.attitudes.size(), 20u);
  flight.fly(hover, 0.1);
  EXPECT_TRUE(flight.node.report().blind);
  EXPECT_NEAR(static_cast<double>(flight.targets()), 19.0, 1.0);
  EXPECT_EQ(flight.autopilot.targets.back().position, (std::array<float, 3>{0, 0, -1}));
  // And while the committed trajectory is followed.
  flight.run_for(0.1);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  const std::size_t targets = flight.targets();
  flight.hear(mavlink::LocalPositionNed{200, {0, 0, -1}, {}});
  flight.run_for(0.1);
  EXPECT_EQ(flight.targets(), targets);
  EXPECT_NEAR(static_cast<double>(flight.autopilot.attitudes.size()), 31.0, 2.0);
}

}  // namespace
}  // namespace swarm::test
