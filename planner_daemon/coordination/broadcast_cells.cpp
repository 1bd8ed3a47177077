// What a broadcast daemon does for flying in cells (cell_protocol.h): it hears and speaks in those that it has to do
// with.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "planner_daemon/coordination/broadcast_node.h"

namespace swarm {
namespace {

constexpr Duration kShown = 500ms;  // tombstones to the planner, again and again

}  // namespace

Refusal BroadcastNode::read_in_cells(std::span<const std::uint8_t> bytes, CellAnnouncement* message) const {
  sogm_swarm::cell_announcement_t packed;
  if (const Refusal refusal = decode(bytes, &packed); refusal != Refusal::kNone) return refusal;
  message->robot.header = packed.header;
  const auto link = links_.find(packed.header.robot_id);
  if (link == links_.end()) return Refusal::kRobot;
  if (!link->second.gate.is_newer(packed.header)) return Refusal::kSequence;
  return unpack(packed, message);
}

Refusal BroadcastNode::on_cell_roster(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::cell_roster_t packed;
  CellRoster roster;
  const auto from_anybody = [](const sogm_swarm::cell_roster_t&) { return Refusal::kNone; };
  const TimeWindow lately{now, kMaxAge, to_duration(config_.clock_error_s)};
  Refusal refusal = decode(bytes, &packed);
  if (refusal == Refusal::kNone) refusal = admit(packed, from_anybody, lately, AnyOrder());
  if (refusal == Refusal::kNone) refusal = unpack(packed, &roster);
  if (refusal != Refusal::kNone) return refusal;
  cells_->receive(roster);
  follow_peers();
  return Refusal::kNone;
}

void BroadcastNode::listen_in_cells(Outbox& outbox) {
  const auto listen = [&outbox](const Cell& cell, bool listens) {
    for (const char* kind : {channel::kCellAnnouncement, channel::kCellRoster})
      outbox.listen(BusId::kSwarm, channel_of(kind, cell), listens);
  };
  const std::map<Cell, CellProtocol::Place>& places = cells_->places();
  for (const auto& entry : places)
    if (listens_in_.insert(entry.first).second) listen(entry.first, true);
  std::erase_if(listens_in_, [&](const Cell& cell) {
    const bool is_over = !places.contains(cell);
    if (is_over) listen(cell, false);
    return is_over;
  });
}

void BroadcastNode::follow_peers() {
  const std::map<int, CommitProtocol::Peer>& peers = protocol_.peers();
  if (std::ranges::equal(
          links_, peers, {}, [](const auto& link) { return link.first; }, [](const auto& peer) { return peer.first; }))
    return;
  std::erase_if(links_, [&](const auto& entry) { return !peers.contains(entry.first); });
  for (const auto& entry : peers) links_[entry.first];
  gap_ = to_duration(static_cast<double>(peers.size() + 1) / config_.swarm_rate_hz);
}

void BroadcastNode::announce_in_cells(CellAnnouncement* message, Outbox& outbox) {
  const auto packed = pack(message);
  if (fits_frame_ != packed.has_value()) {
    fits_frame_ = packed.has_value();
    if (!fits_frame_)
      spdlog::error("says nothing: {} peers and {} cells are more than fit a frame; cells must be smaller",
                    message->acks.size(), message->cells.size());
  }
  if (!packed) return;
  for (const auto& entry : message->cells)
    outbox.publish(BusId::kSwarm, channel_of(channel::kCellAnnouncement, entry.first), *packed);
}

void BroadcastNode::show_tombstones(Utime now, Outbox& outbox) {
  if (now < words_.due(now, kShown)) return;
  words_.done(now);
  for (const auto& entry : cells_->places()) {
    if (!entry.second.roster) continue;
    for (const auto& [id, member] : entry.second.roster->entries) {
      if (member.state != Membership::kExpelled || !member.tombstone || id == config_.robot_id) continue;
      sogm_swarm::announcement_t message = *member.tombstone;
      message.header.utime = to_us(now + offered_step_);
      outbox.publish(BusId::kOnboard, channel::kPeerTrajectory, message);
    }
  }
}

}  // namespace swarm
