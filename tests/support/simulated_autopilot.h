// A flight controller that is at once where it is told to be, behind MAVLink frames.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "tools/bridge/mavlink.h"

namespace swarm::test {

class SimulatedAutopilot {
 public:
  using Sink = std::function<void(std::span<const std::uint8_t>)>;

  // `bridge`: who may tell it something.
  SimulatedAutopilot(mavlink::Sender self, mavlink::Sender bridge, Sink sink)
      : encoder_(self), parser_(bridge), sink_(std::move(sink)) {}

  void receive(std::span<const std::uint8_t> bytes) {
    parser_.feed(bytes, [this](const mavlink::Message& message) {
      if (const auto* const target = std::get_if<mavlink::SetPositionTargetLocalNed>(&message))
        targets.push_back(*target);
      if (const auto* const target = std::get_if<mavlink::SetAttitudeTarget>(&message)) attitudes.push_back(*target);
      if (const auto* const heartbeat = std::get_if<mavlink::Heartbeat>(&message)) heartbeats.push_back(*heartbeat);
    });
  }

  // Tells where it is, which is where it was told to be last: the origin of its frame before anything was said.
  void report_state(std::uint32_t time_boot_ms) {
    const mavlink::SetPositionTargetLocalNed at =
        targets.empty() ? mavlink::SetPositionTargetLocalNed() : targets.back();
    mavlink::Attitude attitude;
    attitude.time_boot_ms = time_boot_ms;
    attitude.yaw = at.yaw;
    send(attitude);
    send(mavlink::LocalPositionNed{time_boot_ms, at.position, at.velocity});
  }
  void report_heartbeat(bool armed) {
    mavlink::Heartbeat heartbeat;
    heartbeat.autopilot = mavlink::Heartbeat::kPx4;
    heartbeat.base_mode = armed ? mavlink::Heartbeat::kArmed : 0;
    heartbeat.custom_mode = 6 << 16;  // offboard
    send(heartbeat);
  }
  void send(const mavlink::Message& message) { sink_(encoder_.encode(message)); }

  const mavlink::Parser& parser() const { return parser_; }

  std::vector<mavlink::SetPositionTargetLocalNed> targets;
  std::vector<mavlink::SetAttitudeTarget> attitudes;
  std::vector<mavlink::Heartbeat> heartbeats;

 private:
  mavlink::Encoder encoder_;
  mavlink::Parser parser_;
  Sink sink_;
};

}  // namespace swarm::test
