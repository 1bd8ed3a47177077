#include "planner_daemon/coordination/roster_protocol.h"

#include <algorithm>

namespace swarm {

RosterProtocol::RosterProtocol(const CommitProtocol::Rules& rules) : protocol_(rules) {
  places_.push_back(rules.robot_id);
  for (const auto& [id, peer] : protocol_.peers()) places_.push_back(id);
  std::ranges::sort(places_);
}

int RosterProtocol::told_about(const CellAnnouncement& message) const {
  return places_[static_cast<std::size_t>(message.robot.header.seq) % places_.size()];
}

CommitProtocol::Keep RosterProtocol::alone(const Keep& keep) {
  return [keep](const sogm_swarm::announcement_t& promise) { return keep({promise, {}, {}}); };
}

}  // namespace swarm
