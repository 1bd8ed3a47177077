#include "tools/bridge/bridge_log.h"

#include <spdlog/fmt/fmt.h>

namespace swarm {
namespace {

constexpr Duration kSummaryPeriod = 10s;
constexpr Duration kSilence = 3s;              // without a heartbeat: the controller is gone
constexpr double kOff_m = 1.0, kNear_m = 0.5;  // from its target: the robot will not get there gently

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

std::string mode_of(const BridgeReport& bridge) {
  const char* const mode = bridge.controller.led_mode();
  return mode != nullptr ? mode : fmt::format("mode {:#x}", bridge.controller.heartbeat.custom_mode);
}

std::string name_of(std::uint16_t command) {
  using mavlink::CommandLong;
  switch (command) {
    case CommandLong::kTakeOff:
      return "to take off";
    case CommandLong::kSetMode:
      return "to switch to the mode in which it is led";
    case CommandLong::kArm:
      return "to arm or disarm";
    default:
      return fmt::format("command {}", command);
  }
}

std::string summary(Utime now, const BridgeReport& bridge, const LinkReport& link, const mavlink::Parser& parser) {
  const std::string controller = bridge.heard_utime
                                     ? fmt::format("{:.1f} s ago, {}, {}", to_seconds(now - *bridge.heard_utime),
                                                   bridge.controller.armed() ? "armed" : "disarmed", mode_of(bridge))
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

std::vector<LogLine> BridgeLog::update(Utime now, const BridgeReport& bridge, const LinkReport& link,
                                       const mavlink::Parser& parser) {
  Seen current;
  current.connected = link.connected;
  current.peer = link.peer;
  current.lost = link.lost;
  current.heard = bridge.heard_utime && now - *bridge.heard_utime < kSilence;
  current.armed = bridge.controller.armed();
  current.mode = bridge.heard_utime ? mode_of(bridge) : "";
  current.version_1 = parser.skipped(mavlink::Skipped::kMavlink1) > 0;
  current.led_by = bridge.led_by;
  current.off = bridge.off_m > (seen_.off ? kNear_m : kOff_m);
  current.restarts = bridge.restarts;
  current.blind = bridge.blind;
  current.told = bridge.told;
  current.answered = bridge.answered;

  std::vector<LogLine> lines;
  const auto add = [&lines](bool warning, std::string_view text) { add_line(&lines, warning, text); };
  if (current.lost != seen_.lost) add(true, "lost " + current.peer + "; it is tried again every second");
  if (current.connected && (!seen_.connected || current.peer != seen_.peer || current.lost != seen_.lost))
    add(false, "link to " + current.peer);
  if (current.heard && !seen_.heard) add(false, "the controller is there");
  if (!current.heard && seen_.heard) add(true, "the controller is silent");
  if (current.heard && (!seen_.heard || current.armed != seen_.armed || current.mode != seen_.mode))
    add(false, fmt::format("the controller is {}, {}", current.armed ? "armed" : "disarmed", current.mode));
  if (current.restarts != seen_.restarts)
    add(true, "the controller has restarted: its origin and its north may be others now");
  if (current.version_1 && !seen_.version_1)
    add(true,
        "the controller speaks MAVLink 1: it must speak version 2 (PX4: MAV_PROTO_VER 2, ArduPilot: "
        "SERIALn_PROTOCOL 2)");
  if (current.led_by != seen_.led_by) {
    const bool good = current.led_by == LedBy::kNone || current.led_by == LedBy::kSetpoints;
    add(!good, describe(current.led_by));
  }
  if (current.told && current.told != seen_.told) add(false, "the controller is told " + name_of(*current.told));
  const bool refuses = current.answered && *current.answered != mavlink::CommandAck::kAccepted &&
                       *current.answered != mavlink::CommandAck::kInProgress;
  if (refuses && current.answered != seen_.answered) {
    add(true, fmt::format("the controller refuses {} (MAV_RESULT {}): its own messages say why", name_of(*current.told),
                          *current.answered));
  }
  if (current.blind != seen_.blind)
    add(current.blind, current.blind ? "no state of the robot: the controller is told positions in place of attitudes"
                                     : "the controller is told attitudes again");
  if (current.off && !seen_.off)
    add(true,
        fmt::format("the robot is {:.1f} m from its target: do not switch to the mode that goes there", bridge.off_m));
  if (!current.off && seen_.off) add(false, "the robot is at its target");
  seen_ = current;

  if (!summary_) summary_.emplace().done(now);
  if (now >= summary_->due(now, kSummaryPeriod)) {
    add(false, summary(now, bridge, link, parser));
    summary_->done(now);
  }
  return lines;
}

}  // namespace swarm
