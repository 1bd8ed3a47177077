// What a mavlink_bridge is told: who it is, whom it leads, and how.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>

#include "lcmtypes/bus/option_set.h"
#include "planner_daemon/trajectory/vehicle_fit.h"
#include "tools/bridge/mavlink.h"
#include "tools/bridge/position_controller.h"

namespace swarm {

struct BridgeConfig {
  int robot_id = 0;
  int target_system = 1, target_component = 1;       // the flight controller; component 0: any
  int system_id = 0, component_id = 191;             // this bridge; system 0: the controller's
  double north_rad = 0.0;                            // yaw of north in W
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // of the controller's local frame in W [m]
  VehicleFit fit;                    // what targets are given, so that the vehicle follows the setpoints
  std::string targets = "position";  // what the controller is told: position, or attitude
  PositionGains gains;               // where it is attitude
  double state_delay_s = 0.0;        // a state is older than its arrival by this
  bool publish_state = true;
  bool passes_state = false;   // to the controller, where somebody else publishes it
  double timeout_s = 0.5;      // no setpoint and no announcement for so long: the broadcast daemon is gone
  double clock_limit_s = 0.1;  // the robot's own messages from further in the future are refused
  bool arms = true;            // and switches the mode, takes off and disarms, as the flight's state demands
};

void declare(OptionSet& options, BridgeConfig& config);
// Throws OptionError where values do not go together.
void verify(const BridgeConfig& config);

mavlink::Sender bridge_of(const BridgeConfig& config);
mavlink::Sender controller_of(const BridgeConfig& config);

// A MAVLink id, which the options keep within a byte.
inline std::uint8_t to_byte(int id) {
  return static_cast<std::uint8_t>(id);
}

}  // namespace swarm
