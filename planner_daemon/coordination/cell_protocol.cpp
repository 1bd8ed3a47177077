#include "planner_daemon/coordination/cell_protocol.h"

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

namespace swarm {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;

namespace {

constexpr Duration kWanted = 2s;  // after a proposal, the cells that it touches: planners propose far more often

CommitProtocol::Rules in_cells(CommitProtocol::Rules rules) {
  rules.roster.clear();
  rules.all_judge = true;
  return rules;
}

}  // namespace

CellProtocol::CellProtocol(const Rules& rules) : rules_(rules), protocol_(in_cells(rules.robot)) {
  next_wish_ = (static_cast<std::int64_t>(rules.robot.boot) << 32) + 1;  // no earlier start came so far
}

void CellProtocol::start(const Motion& motion, std::int32_t forced_seq, const Standings& kept) {
  protocol_.start(motion, forced_seq);
  for (const auto& [cell, standing] : kept) places_[cell] = {standing.wish, false};
}

Rejection CellProtocol::propose(Utime now, const Trajectory& candidate, const Keep& keep, bool urgent) {
  if (!protocol_.motion()) return Rejection::kNoCommitted;
  wanted_ = cells_of(candidate);
  wanted_until_ = now + kWanted;
  advance(now, keep);
  const bool is_in_all = std::ranges::all_of(wanted_, [this](const Cell& cell) { return is_in(cell); });
  if (!urgent && !is_in_all) return Rejection::kWaiting;
  const Rejection rejection = protocol_.propose(now, candidate, urgent);
  hold_back();
  return rejection;
}

void CellProtocol::receive(Utime now, const CellAnnouncement& message, const Keep&) {
  const auto& header = message.robot.header;
  const auto found = protocol_.peers().find(header.robot_id);
  if (found == protocol_.peers().end()) return;
  const CommitProtocol::Peer& peer = found->second;
  const std::int64_t seq_before = peer.seq;
  const std::int32_t boot_before = peer.boot;
  protocol_.receive(now, of_roster(message), [](const announcement_t&) { return true; });
  if (std::pair(peer.boot, peer.seq) == std::pair(boot_before, seq_before)) return;
  peers_cells_[header.robot_id] = message.cells;
  hold_back();
}

// As it would be said to a roster of the present peers.
announcement_t CellProtocol::of_roster(const CellAnnouncement& message) const {
  announcement_t announcement = message.robot;
  announcement.roster_crc = protocol_.roster_crc();
  std::set<int> ids{rules_.robot.robot_id};
  for (const auto& [id, peer] : protocol_.peers()) ids.insert(id);
  announcement.acks.clear();
  for (const int id : ids) {
    const auto ack = message.acks.find(id);
    const bool counts = ack != message.acks.end() && ack->second.verdict != ack_t::kGivenUp;
    announcement.acks.push_back(counts ? ack->second : ack_t{-1, 0, ack_t::kNone});
  }
  announcement.num_acks = static_cast<std::int16_t>(announcement.acks.size());
  return announcement;
}

void CellProtocol::receive(const CellRoster& roster) {
  const auto found = places_.find(roster.cell);
  if (found == places_.end()) return;
  std::optional<CellRoster>& known = found->second.roster;
  if (known && roster.seq <= known->seq) return;
  const std::int64_t epoch_before = known ? known->epoch : -1;
  known = roster;
  answers_ |= std::ranges::any_of(roster.entries, [&](const auto& entry) {
    return entry.second.state == Membership::kMember && entry.second.since > epoch_before;
  });
  find_peers();
}

void CellProtocol::advance(Utime now, const Keep& keep) {
  protocol_.advance(now);
  if (!protocol_.motion()) return;
  if (now >= wanted_until_) wanted_.clear();
  const std::set<Cell> needed = needed_cells(now);
  const bool wishes_anew = std::ranges::any_of(needed, [this](const Cell& cell) {
    const auto place = places_.find(cell);
    return place == places_.end() || !place->second.wishes || is_expelled(place->second);
  });
  const std::map<Cell, Place> places_before = wishes_anew ? places_ : std::map<Cell, Place>();
  bool changed = wishes_anew;
  for (auto& [cell, place] : places_) {
    if (!place.wishes || needed.contains(cell)) continue;
    place.wishes = false;
    changed = true;
  }
  changed |= std::erase_if(places_, [this](const auto& entry) { return has_left(entry.second); }) > 0;
  for (const Cell& cell : needed) {
    Place& place = places_[cell];
    if (place.wishes && !is_expelled(place)) continue;
    place.wishes = true;
    place.wish = next_wish_++;
  }
  news_ |= wishes_anew;
  if (wishes_anew && !keep(state())) places_ = places_before;
  if (changed)
    find_peers();
  else
    hold_back();
}

void CellProtocol::set_clock(Utime now, Duration step) {
  for (auto& [cell, place] : places_) {
    if (!place.roster) continue;
    for (auto& [id, entry] : place.roster->entries) {
      if (entry.tombstone) shift(step, &*entry.tombstone);
    }
  }
  wanted_until_ += step;
  protocol_.set_clock(now, step);
  find_peers();
}

CommitProtocol::News CellProtocol::take_news() {
  using News = CommitProtocol::News;
  const bool news = std::exchange(news_, false), answers = std::exchange(answers_, false);
  const News of_robot = protocol_.take_news();
  if (news || of_robot == News::kMore) return News::kMore;
  return answers ? News::kAnswers : of_robot;
}

bool CellProtocol::is_awaited(Utime now) const {
  return protocol_.is_awaited(now) ||
         std::ranges::any_of(places_, [this](const auto& entry) { return entry.second.wishes && !is_in(entry.first); });
}

Utime CellProtocol::due_utime(Utime now) const {
  return wanted_.empty() ? protocol_.due_utime(now) : std::min(protocol_.due_utime(now), wanted_until_);
}

std::set<Cell> CellProtocol::cells_of(const Trajectory& trajectory) const {
  return rules_.cells_of({trajectory, {}}, trajectory.start_utime(), reach_m());
}

std::set<Cell> CellProtocol::needed_cells(Utime now) const {
  // By any clock it is that far at least.
  const Utime from = now - to_duration(rules_.robot.clock_error_s);
  std::set<Cell> needed = rules_.cells_of(*protocol_.motion(), from, reach_m());
  if (!protocol_.pending().empty()) needed.merge(cells_of(protocol_.pending()));
  needed.insert(wanted_.begin(), wanted_.end());
  return needed;
}

const CellRoster::Entry* CellProtocol::own_entry(const Place& place) const {
  if (!place.roster) return nullptr;
  const auto entry = place.roster->entries.find(rules_.robot.robot_id);
  return entry != place.roster->entries.end() && entry->second.wish == place.wish ? &entry->second : nullptr;
}

bool CellProtocol::is_listed(const Place& place) const {
  const CellRoster::Entry* const entry = own_entry(place);
  return place.wishes && entry != nullptr && entry->state == Membership::kMember;
}

bool CellProtocol::is_expelled(const Place& place) const {
  const CellRoster::Entry* const entry = own_entry(place);
  return entry != nullptr && entry->state == Membership::kExpelled;
}

bool CellProtocol::has_left(const Place& place) const {
  const CellRoster::Entry* const entry = own_entry(place);
  return !place.wishes && entry != nullptr && entry->state == Membership::kLeft;
}

bool CellProtocol::is_in(const Cell& cell) const {
  const auto place = places_.find(cell);
  if (place == places_.end() || !is_listed(place->second)) return false;
  const std::int64_t since = own_entry(place->second)->since;
  return std::ranges::all_of(place->second.roster->entries, [&](const auto& entry) {
    const int id = entry.first;
    if (entry.second.state != Membership::kMember || id == rules_.robot.robot_id) return true;
    const auto cells = peers_cells_.find(id);
    if (cells == peers_cells_.end() || !protocol_.peers().at(id).hears_us) return false;
    const auto standing = cells->second.find(cell);
    return standing != cells->second.end() && standing->second.epoch >= since;
  });
}

bool CellProtocol::is_granted() const {
  const std::int32_t seq = protocol_.pending().seq();
  return std::ranges::all_of(cells_of(protocol_.pending()), [this, seq](const Cell& cell) {
    if (!is_in(cell)) return false;
    const Place& place = places_.at(cell);
    if (own_entry(place)->recorded_seq != seq) return false;
    return std::ranges::all_of(place.roster->entries, [this, seq](const auto& entry) {
      return entry.second.state != Membership::kMember || entry.first == rules_.robot.robot_id ||
             protocol_.peers().at(entry.first).our_seq == seq;
    });
  });
}

void CellProtocol::find_peers() {
  std::set<int> peers, peers_before;
  for (const auto& [cell, place] : places_) {
    if (!is_listed(place)) continue;
    for (const auto& [id, entry] : place.roster->entries)
      if (entry.state == Membership::kMember && id != rules_.robot.robot_id) peers.insert(id);
  }
  for (const auto& [id, peer] : protocol_.peers()) peers_before.insert(id);
  if (peers != peers_before) protocol_.set_peers(peers);
  std::erase_if(peers_cells_, [&peers](const auto& entry) { return !peers.contains(entry.first); });
  protocol_.set_tombstones(tombstones());
  hold_back();
}

void CellProtocol::hold_back() {
  protocol_.withhold(!protocol_.pending().empty() && !is_granted());
}

bool CellProtocol::commit(const Keep& keep) {
  return protocol_.commit([&](const announcement_t& promise) {
    CellAnnouncement kept = state();
    kept.robot = promise;
    return keep(kept);
  });
}

std::vector<announcement_t> CellProtocol::tombstones() const {
  std::vector<announcement_t> tombstones;
  for (const auto& [cell, place] : places_) {
    if (!place.wishes || !place.roster) continue;
    for (const auto& [id, entry] : place.roster->entries)
      if (entry.state == Membership::kExpelled && entry.tombstone && id != rules_.robot.robot_id)
        tombstones.push_back(*entry.tombstone);
  }
  return tombstones;
}

int CellProtocol::told_about(const CellAnnouncement& message) const {
  if (message.acks.empty()) return -1;
  const auto seq = static_cast<std::size_t>(message.robot.header.seq);
  return std::next(message.acks.begin(), static_cast<std::ptrdiff_t>(seq % message.acks.size()))->first;
}

CellAnnouncement CellProtocol::state() const {
  CellAnnouncement message{protocol_.state(), {}, {}};
  for (const auto& [id, peer] : protocol_.peers()) message.acks[id] = message.robot.acks[peer.place];
  message.robot.acks.clear();
  message.robot.num_acks = 0;
  for (const auto& [cell, place] : places_)
    message.cells[cell] = {place.wish, place.wishes, place.roster ? place.roster->epoch : -1};
  return message;
}

}  // namespace swarm
