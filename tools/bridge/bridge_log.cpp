#include "tools/bridge/bridge_log.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

namespace swarm {
namespace {

constexpr std::int64_t kSummaryPeriod_us = 10'000'000;
constexpr std::int64_t kSilence_us = 3'000'000;  // without a heartbeat: the controller is gone
constexpr double kOff_m = 1.0, kNear_m = 0.5;    // from its target: the robot will not get there gently

const char* describe(LedBy led_by) {
  switch (led_by) {
    case LedBy::kNone:
      return "no setpoint yet";
    case LedBy::kSetpoints:
      return "following setpoints";
    case LedBy::kTrajectory:
      return "following the committed trajectory";
    case LedBy::kLost:
      return "no setpoints and no committed trajectory: nothing is sent";
    case LedBy::kEnded:
      return "broadcast daemon gone, trajectory ended: nothing is sent any more";
  }
  return "?";
}

// The flight modes in which targets are obeyed, by name.
std::string mode_of(const mavlink::Heartbeat& heartbeat) {
  const std::uint32_t mode = heartbeat.custom_mode;
  if (heartbeat.autopilot == mavlink::Heartbeat::kPx4 && (mode >> 16 & 0xFF) == 6) return "offboard mode";
  if (heartbeat.autopilot == mavlink::Heartbeat::kArdupilot && mode == 4) return "guided mode";
  return fmt::format("mode {:#x}", mode);
}

std::string summary(std::int64_t now_us, const BridgeReport& bridge, const LinkReport& link,
                    const mavlink::Parser& parser) {
  const std::string controller =
      bridge.heartbeat_us
          ? fmt::format("{:.1f} s ago, {}, {}", 1e-6 * static_cast<double>(now_us - *bridge.heartbeat_us),
                        bridge.armed() ? "armed" : "disarmed", mode_of(bridge.heartbeat))
          : "never";
  return fmt::format(
      "{}; controller heard {}; out: {} frames ({} dropped), {} setpoints ({} late), {} of the trajectory; in: {} "
      "frames, {} states; refused from the bus: {}; passed over from the link: {}, strangers {}; states not passed on: "
      "{}",
      describe(bridge.led_by), controller, link.frames_out, link.dropped, bridge.setpoints, bridge.late, bridge.samples,
      parser.frames(), bridge.states,
      list_counts<Refusal>(kNumRefusals, [&](Refusal reason) { return bridge.refused[reason]; }),
      list_counts<mavlink::Skipped>(mavlink::kNumSkipped,
                                    [&](mavlink::Skipped reason) { return parser.skipped(reason); }),
      link.strangers, list_counts<StateRefusal>(kNumStateRefusals, [&](StateRefusal reason) {
        return bridge.states_refused[static_cast<std::size_t>(reason)];
      }));
}

}  // namespace

std::vector<LogLine> BridgeLog::update(std::int64_t now_us, const BridgeReport& bridge, const LinkReport& link,
                                       const mavlink::Parser& parser) {
  Seen now;
  now.connected = link.connected;
  now.peer = link.peer;
  now.lost = link.lost;
  now.heard = bridge.heartbeat_us && now_us - *bridge.heartbeat_us < kSilence_us;
  now.armed = bridge.armed();
  now.mode = bridge.heartbeat_us ? mode_of(bridge.heartbeat) : "";
  now.version_1 = parser.skipped(mavlink::Skipped::kMavlink1) > 0;
  now.led_by = bridge.led_by;
  now.off = bridge.off_m > (seen_.off ? kNear_m : kOff_m);
  now.restarts = bridge.restarts;

  std::vector<LogLine> lines;
  const auto add = [&lines](bool warning, std::string_view text) { add_line(&lines, warning, text); };
  if (now.lost != seen_.lost) add(true, "lost " + now.peer + "; it is tried again every second");
  if (now.connected && (!seen_.connected || now.peer != seen_.peer || now.lost != seen_.lost))
    add(false, "link to " + now.peer);
  if (now.heard && !seen_.heard) add(false, "the controller is there");
  if (!now.heard && seen_.heard) add(true, "the controller is silent");
  if (now.heard && (!seen_.heard || now.armed != seen_.armed || now.mode != seen_.mode))
    add(false, fmt::format("the controller is {}, {}", now.armed ? "armed" : "disarmed", now.mode));
  if (now.restarts != seen_.restarts)
    add(true, "the controller has restarted: its origin and its north may be others now");
  if (now.version_1 && !seen_.version_1)
    add(true,
        "the controller speaks MAVLink 1: it must speak version 2 (PX4: MAV_PROTO_VER 2, ArduPilot: "
        "SERIALn_PROTOCOL 2)");
  if (now.led_by != seen_.led_by) {
    const bool good = now.led_by == LedBy::kNone || now.led_by == LedBy::kSetpoints;
    add(!good, describe(now.led_by));
  }
  if (now.off && !seen_.off)
    add(true,
        fmt::format("the robot is {:.1f} m from its target: do not switch to the mode that goes there", bridge.off_m));
  if (!now.off && seen_.off) add(false, "the robot is at its target");
  seen_ = now;

  if (!summary_) summary_.emplace().done(now_us);
  if (now_us >= summary_->due_us(now_us, kSummaryPeriod_us)) {
    add(false, summary(now_us, bridge, link, parser));
    summary_->done(now_us);
  }
  return lines;
}

}  // namespace swarm
