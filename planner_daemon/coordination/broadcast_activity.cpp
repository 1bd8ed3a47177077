// What the broadcast daemon says that it is about: why nothing is committed is what an operator asks first.
#include <algorithm>
#include <string>

#include "lcmtypes/bus/text.h"
#include "planner_daemon/coordination/broadcast_node.h"

namespace swarm {
namespace {

using sogm_swarm::broadcast_status_t;

constexpr Duration kNothingFor = 3s;  // without a commit, though the planner asks for some

void add(const std::string& separator, const std::string& item, std::string* list) {
  list->append(list->empty() ? "" : separator).append(item);
}

}  // namespace

Activity BroadcastNode::activity(Utime now) const {
  switch (state(now)) {
    case broadcast_status_t::kNoState:
      return waits_for(channel::kRobotState);
    case broadcast_status_t::kNoStorage:
      return {true, "commits nothing: promises cannot be kept in " + config_.state_dir, {}};
    case broadcast_status_t::kTwin:
      return {true, "commits nothing: another broadcaster speaks as robot " + std::to_string(config_.robot_id), {}};
    case broadcast_status_t::kClock: {
      std::string offsets;
      for (const auto& [id, link] : links_) {
        if (const auto offset = link.clock.offset())
          add(", ", "robot " + std::to_string(id) + "'s by " + fixed(to_ms(*offset), 1) + " ms", &offsets);
      }
      return {
          true,
          clock_is_stepped_ ? "commits nothing until it rests: the clock was set" : "commits nothing: clocks differ",
          offsets.empty() ? "by how much is not known yet" : "from this one " + offsets};
    }
    case broadcast_status_t::kWaiting: {
      std::string peers;
      for (const auto& [id, peer] : protocol_.peers()) {
        if (!peer.heard) add(", ", std::to_string(id) + " (never heard)", &peers);
        if (peer.heard && !peer.hears_us) add(", ", std::to_string(id) + " (has not heard this start)", &peers);
      }
      return waits_for("robots " + peers);
    }
    default:
      return flight_activity(now);
  }
}

Activity BroadcastNode::flight_activity(Utime now) const {
  if (candidates_ == committed_.candidates || now - committed_.utime < kNothingFor)
    return {.text = "ready: commits what the planner sends and robots agree to"};
  std::string why, refusing;
  for (int i = 1; i < kNumRejections; ++i) {
    const auto reason = static_cast<Rejection>(i);
    if (rejected(reason) > committed_.rejected[static_cast<std::size_t>(i)]) add(", ", to_string(reason), &why);
  }
  for (const auto& [id, peer] : protocol_.peers()) {
    if (peer.our_verdict == sogm_swarm::ack_t::kNack) add(", ", std::to_string(id), &refusing);
  }
  if (!refusing.empty()) add("; ", "refused by robot " + refusing, &why);
  const std::string count = std::to_string(candidates_ - committed_.candidates) + " candidates";
  return {true, "commits nothing" + (why.empty() ? "" : ": " + why),
          count + (committed_.candidates > 0 ? " since the last commit" : "")};
}

}  // namespace swarm
