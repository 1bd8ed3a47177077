// The bridge in simulated time, between a broadcast daemon and an autopilot.
#pragma once

#include <algorithm>
#include <cmath>

#include "lcmtypes/bus/channels.h"
#include "tests/support/harness.h"
#include "tests/support/simulated_autopilot.h"
#include "tools/bridge/bridge_node.h"

namespace swarm::test {

inline constexpr std::int32_t kBoot = 1'700'000'000;
inline constexpr int kRobot = 3;

inline BridgeConfig make_config() {
  BridgeConfig config;
  config.robot_id = kRobot;
  config.target_system = 4;
  return config;
}

// What the bridge has sent, and who hears it.
struct Wire {
  void put(std::span<const std::uint8_t> frame) {
    frames.emplace_back(frame.begin(), frame.end());
    if (take) take(frames.back());
  }
  std::vector<Bytes> frames;
  std::function<void(const Bytes&)> take;
};

// The bridge, an autopilot on its link, and what the broadcast daemon would say.
struct Flight : Wire, Bench<BridgeNode> {
  explicit Flight(const BridgeConfig& config_in = make_config())
      : Bench(config_in, kBoot, [this](auto frame) { put(frame); }), config(config_in) {
    take = [this](const Bytes& frame) { autopilot.receive(frame); };
    std::ranges::for_each(frames, take);
  }

  sogm_swarm::setpoint_t make_setpoint(const MotionState& state, double yaw = 0.0) {
    sogm_swarm::setpoint_t setpoint{};
    setpoint.header = make_header(kRobot, 1, setpoint_seq++, now);
    Eigen::Map<Eigen::Vector3d>(setpoint.position) = state.position;
    Eigen::Map<Eigen::Vector3d>(setpoint.velocity) = state.velocity;
    Eigen::Map<Eigen::Vector3d>(setpoint.acceleration) = state.acceleration;
    setpoint.yaw = yaw;
    return setpoint;
  }
  void say_setpoint(const MotionState& state, double yaw = 0.0) { send(channel::kSetpoint, make_setpoint(state, yaw)); }
  sogm_swarm::announcement_t make_announcement(const Trajectory& committed) {
    sogm_swarm::announcement_t message{};
    message.header = make_header(kRobot, 1, announcement_seq++, now);
    message.radius = 0.2f;
    message.committed = committed.to_wire();
    message.least_delay_us = sogm_swarm::announcement_t::kUnknown;
    return message;
  }
  void announce(const Trajectory& committed) { send(channel::kOwnTrajectory, make_announcement(committed)); }

  // The broadcast daemon lives: setpoints at 100 Hz, announcements at 20 Hz.
  void fly(const Trajectory& trajectory, double seconds) {
    for (int i = 0; i < std::lround(100 * seconds); ++i) {
      if (i % 5 == 0) announce(trajectory);
      say_setpoint(trajectory.at(now), 0.5);
      run_for(0.01);
    }
  }
  // Where a target is in W.
  Eigen::Vector3d place_of(const mavlink::SetPositionTargetLocalNed& target) const {
    return NedFrame(config.north_rad, config.origin)
        .position_to_world(Eigen::Vector3f::Map(target.position.data()).cast<double>());
  }
  std::size_t targets() const { return autopilot.targets.size(); }
  std::int32_t refused(Refusal refusal) const { return node.report().refused[refusal]; }
  std::int64_t refused(StateRefusal refusal) const {
    return node.report().states_refused[static_cast<std::size_t>(refusal)];
  }
  void hear(const mavlink::Message& message) {
    node.on_frame(now, message, out);
    step();
  }
  int states() const { return out.count(channel::kRobotState); }

  BridgeConfig config;
  std::int64_t setpoint_seq = 0, announcement_seq = 0;
  mavlink::Parser ears{controller_of(config)};
  SimulatedAutopilot autopilot{controller_of(config), bridge_of(config), [this](auto frame) {
                                 ears.feed(frame, [this](const mavlink::Message& message) { hear(message); });
                               }};
};

inline MotionState at_rest(const Eigen::Vector3d& position) {
  MotionState state;
  state.position = position;
  return state;
}

}  // namespace swarm::test
