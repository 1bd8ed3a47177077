// What a broadcast daemon does for flying in cells (cell_protocol.h): it hears and speaks in those that it has to do
// with.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "lcmtypes/bus/cell_channels.h"
#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "planner_daemon/coordination/broadcast_node.h"
#include "planner_daemon/coordination/cell.h"

namespace swarm {

std::unique_ptr<CellProtocol> BroadcastNode::in_cells(const CommitProtocol::Rules& rules, double edge_m) {
  if (edge_m == 0.0) return nullptr;
  return std::make_unique<CellProtocol>(
      CellProtocol::Rules{rules, [edge_m](const Motion& motion, Utime from, double reach_m) {
                            return cells_touched(motion, from, reach_m, edge_m);
                          }});
}

// Others fly in its cells than its peers, and what is said in several of them comes as often.
Refusal BroadcastNode::on_cell_announcement(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::cell_announcement_t packed;
  CellAnnouncement said;
  if (const Refusal refusal = decode(bytes, &packed); refusal != Refusal::kNone) return refusal;
  if (packed.header.robot_id == config_.robot_id) return on_own_returned(now, packed.header);
  const auto link = links_.find(packed.header.robot_id);
  if (link == links_.end() || !link->second.gate.is_newer(packed.header)) return Refusal::kNone;
  if (const Refusal refusal = unpack(packed, &said); refusal != Refusal::kNone) return refusal;
  return heard(now, std::move(said));
}

Refusal BroadcastNode::on_cell_roster(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::cell_roster_t packed;
  CellRoster roster;
  const auto from_anybody = [](const sogm_swarm::cell_roster_t&) { return Refusal::kNone; };
  Refusal refusal = decode(bytes, &packed);
  if (refusal == Refusal::kNone) refusal = admit(packed, from_anybody, lately(now), AnyOrder());
  if (refusal == Refusal::kNone) refusal = unpack(packed, &roster);
  if (refusal != Refusal::kNone) return refusal;
  cells_->receive(roster);
  follow_peers();
  return Refusal::kNone;
}

void BroadcastNode::listen_in_cells(Outbox& outbox) {
  if (!cells_) return;
  const std::map<Cell, CellProtocol::Place>& places = cells_->places();
  if (std::ranges::equal(listens_in_, places, {}, {}, [](const auto& entry) { return entry.first; })) return;
  listens_in_.clear();
  for (const auto& entry : places) listens_in_.insert(entry.first);
  std::set<std::string> channels = heard_on(listens_in_);
  for (const std::string& channel : channels)
    if (!listens_on_.contains(channel)) outbox.listen(BusId::kSwarm, channel, true);
  for (const std::string& channel : listens_on_)
    if (!channels.contains(channel)) outbox.listen(BusId::kSwarm, channel, false);
  listens_on_ = std::move(channels);
}

void BroadcastNode::say(CellAnnouncement* message, Outbox& outbox) {
  if (!cells_) return outbox.publish(BusId::kSwarm, channel::kAnnouncement, pack(&message->robot));
  const auto packed = pack(message);
  if (fits_frame_ != packed.has_value()) {
    fits_frame_ = packed.has_value();
    if (!fits_frame_)
      spdlog::error("says nothing: {} peers and {} cells are more than fit a frame; cells must be smaller",
                    message->acks.size(), message->cells.size());
  }
  if (!packed) return;
  std::set<Cell> cells;
  for (const auto& entry : message->cells) cells.insert(entry.first);
  for (const std::string& channel : speaks_on(cells)) outbox.publish(BusId::kSwarm, channel, *packed);
}

}  // namespace swarm
