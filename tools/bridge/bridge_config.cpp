#include "tools/bridge/bridge_config.h"

namespace swarm {

void declare(OptionSet& options, BridgeConfig& config) {
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("target-system", &config.target_system, 1, 255, "", "MAVLink system id of the flight controller");
  options.add("target-component", &config.target_component, 0, 255, "",
              "MAVLink component id of the flight controller; 0: any");
  options.add("system-id", &config.system_id, 0, 255, "", "MAVLink system id of this bridge; 0: the controller's");
  options.add("component-id", &config.component_id, 1, 255, "", "MAVLink component id of this bridge");
  options.add("north", &config.north_rad, -6.3, 6.3, "rad", "yaw of north in W; 0: W's x axis points north");
  options.add("origin", &config.origin, -1e5, 1e5, "m", "of the flight controller's local frame, in W");
  options.add("lead", &config.fit.lead_s, 0, 0.5, "s", "targets are those of so much later: commands take it to act");
  options.add("lag", &config.fit.lag_s, 0, 1, "s",
              "targets accelerate by so much times their jerk more: the vehicle's acceleration lags by it");
  options.add("drag", &config.fit.drag_per_s, 0, 10, "1/s",
              "targets accelerate by so much times their velocity more: air holds the vehicle back");
  options.add("targets", &config.targets,
              "what the controller is told: position, velocity and acceleration; or attitude and thrust, which this "
              "bridge finds by the five below",
              [](const std::string& targets) {
                if (targets != "position" && targets != "attitude") throw OptionError("must be position or attitude");
              });
  options.add("position-gain", &config.gains.position_per_s2, 0.1, 100, "1/s^2", "acceleration by what is amiss");
  options.add("velocity-gain", &config.gains.velocity_per_s, 0.1, 100, "1/s", "acceleration by what velocity is amiss");
  options.add("integral-gain", &config.gains.integral_per_s3, 0, 100, "1/s^3", "acceleration by what stays amiss");
  options.add("hover-thrust", &config.gains.hover_thrust, 0.1, 0.9, "",
              "share of the most thrust at which the robot hovers");
  options.add("tilt-max", &config.gains.tilt_max_deg, 5, 70, "deg", "of the thrust to the vertical at most");
  options.add("state-delay", &config.state_delay_s, 0, 1, "s", "from a state's measurement to its arrival here");
  options.add("publish-state", &config.publish_state, "publish ROBOT_STATE; false: somebody else does");
  options.add("pass-state", &config.passes_state,
              "tell the controller what ROBOT_STATE says, as motion capture publishes it; needs publish-state = false");
  options.add(
      "arms", &config.arms,
      "arms the vehicle, switches its mode, takes off and disarms, as FLIGHT_STATUS demands; false: a pilot does");
  options.add("timeout", &config.timeout_s, 0.1, 60, "s",
              "without setpoint and announcement: then the committed trajectory is flown to its end, and no further");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s",
              "the robot's own messages from further in the future are refused");
}

void verify(const BridgeConfig& config) {
  if (config.passes_state && config.publish_state)
    throw OptionError("pass-state: the controller would be told what it said itself; publish-state must be false");
}

mavlink::Sender bridge_of(const BridgeConfig& config) {
  return {to_byte(config.system_id != 0 ? config.system_id : config.target_system), to_byte(config.component_id)};
}

mavlink::Sender controller_of(const BridgeConfig& config) {
  return {to_byte(config.target_system), to_byte(config.target_component)};
}

}  // namespace swarm
