// A flight controller that is at once where it is told to be, behind MAVLink frames. Obeys commands only if it is to.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <utility>
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
      if (const auto* const command = std::get_if<mavlink::CommandLong>(&message)) obey(*command);
      if (const auto* const pose = std::get_if<mavlink::VisionPositionEstimate>(&message)) poses.push_back(*pose);
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
  void obey(const mavlink::CommandLong& command) {
    commands.push_back(command);
    answers_.push_back({command.command, result});
    if (result != mavlink::CommandAck::kAccepted) return;
    if (command.command == mavlink::CommandLong::kArm) is_armed = command.parameters[0] == 1.0f;
    if (command.command == mavlink::CommandLong::kSetMode) {
      const auto mode = static_cast<std::uint32_t>(command.parameters[1]);
      custom_mode = autopilot == mavlink::Heartbeat::kPx4 ? mode << 16 : mode;
    }
  }
  // What it says to commands; and how it is: armed or not, in which mode, where it stands, with how much left.
  void report_vehicle(std::uint8_t landed_state, std::uint8_t battery_percent = 90) {
    for (const mavlink::CommandAck& answer : std::exchange(answers_, {})) send(answer);
    mavlink::Heartbeat heartbeat;
    heartbeat.autopilot = autopilot;
    heartbeat.base_mode = is_armed ? mavlink::Heartbeat::kArmed : 0;
    heartbeat.custom_mode = custom_mode;
    send(heartbeat);
    send(mavlink::ExtendedSysState{0, landed_state});
    mavlink::SysStatus status;
    status.battery_percent = battery_percent;
    send(status);
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
  std::vector<mavlink::CommandLong> commands;
  std::vector<mavlink::VisionPositionEstimate> poses;  // of itself, by the eyes of others
  // What it is, and what it says to commands.
  std::uint8_t autopilot = mavlink::Heartbeat::kPx4, result = mavlink::CommandAck::kAccepted;
  bool is_armed = false;
  std::uint32_t custom_mode = 0;

 private:
  mavlink::Encoder encoder_;
  mavlink::Parser parser_;
  Sink sink_;
  std::vector<mavlink::CommandAck> answers_;
};

}  // namespace swarm::test
