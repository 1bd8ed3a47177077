// What the broadcast daemon says that it is about: why nothing is committed is what an operator asks first.
#include <algorithm>
#include <string>

#include "lcmtypes/bus/text.h"
#include "planner_daemon/coordination/broadcast_node.h"

namespace swarm {
namespace {

using sogm_swarm::broadcast_status_t;

constexpr Duration kInVainFor = 3s;   // the planner sends candidates, and none is committed
constexpr Duration kStillAsked = 1s;  // the newest is no older; a peer that was not heard for so long is silent

void add(const std::string& separator, const std::string& item, std::string* list) {
  list->append(list->empty() ? "" : separator).append(item);
}

}  // namespace

Activity BroadcastNode::activity(Utime now) const {
  switch (state(now)) {
    case broadcast_status_t::kNoState:
      return waits_for(channel::kRobotState);
    case broadcast_status_t::kNoStorage:
      return {true, "commits nothing: --state-dir " + config_.state_dir + ": cannot be written", {}};
    case broadcast_status_t::kTwin:
      return {true, "commits nothing: another broadcaster speaks as robot " + std::to_string(config_.robot_id), {}};
    case broadcast_status_t::kClock:
      if (offered_step_ != 0us) return {true, "commits only what is urgent until it rests: the clock was set", {}};
      if (doubt_.id < 0) return {true, "commits nothing: the clock was set", "peers' clocks are measured anew"};
      return {true, "commits nothing: clocks differ",
              "robot " + std::to_string(doubt_.id) + "'s is " + fixed(std::abs(to_ms(doubt_.ahead)), 1) + " ms " +
                  (doubt_.ahead > 0us ? "ahead" : "behind")};
    case broadcast_status_t::kWaiting: {
      std::string peers;
      for (const auto& [id, peer] : protocol_.peers()) {
        if (peer.given_up) continue;
        const char* const what = strangers_.contains(id) ? " (is given another roster)" : " (never heard)";
        if (!peer.heard) add(", ", std::to_string(id) + what, &peers);
        if (peer.heard && !peer.hears_us) add(", ", std::to_string(id) + " (has not heard this start)", &peers);
      }
      return waits_for("robots " + peers);
    }
    default:
      return flight_activity(now);
  }
}

Activity BroadcastNode::flight_activity(Utime now) const {
  const bool is_in_vain =
      in_vain_.count > 0 && now - in_vain_.first >= kInVainFor && now - in_vain_.newest <= kStillAsked;
  const sogm_swarm::flight_status_t& flight = flight_.status();
  if (!is_in_vain) {
    std::string text = flight.state != sogm_swarm::flight_status_t::kFlying
                           ? text_of_flight(flight)
                           : "ready: commits what the planner sends and robots agree to";
    std::string given_up;
    for (const auto& [id, peer] : protocol_.peers())
      if (peer.given_up) add(", ", std::to_string(id), &given_up);
    if (!given_up.empty()) text += "; goes on without robots " + given_up;
    std::string strangers;
    for (const int id : strangers_.ids()) add(", ", std::to_string(id), &strangers);
    if (!strangers.empty()) text += "; keeps off strangers " + strangers + ", who are given another roster";
    return {.text = text};
  }
  std::string why = std::to_string(in_vain_.count) + " candidates";
  for (int i = 1; i < kNumRejections; ++i) {
    const std::int32_t count = in_vain_.rejected[static_cast<std::size_t>(i)];
    if (count > 0) why.append(", ").append(to_string(static_cast<Rejection>(i))).append(" ") += std::to_string(count);
  }
  const Motion& bound = *motion();
  const std::int32_t newest_seq = bound.next.empty() ? bound.committed.seq() : bound.next.seq();
  for (const auto& [id, peer] : protocol_.peers()) {
    const Duration silent = now - links_.at(id).heard;
    if (peer.given_up) {
      why += ", robot " + std::to_string(id) + " given up";
      continue;
    }
    if (silent > kStillAsked)
      why += ", robot " + std::to_string(id) + " silent for " + fixed(to_seconds(silent), 1) + " s";
    // Of one with a higher id nobody waits for the word.
    if (id < config_.robot_id && peer.our_verdict == sogm_swarm::ack_t::kNack && peer.our_seq > newest_seq)
      why += ", refused by robot " + std::to_string(id);
  }
  return {true, "commits nothing of what the planner sends", why};
}

}  // namespace swarm
