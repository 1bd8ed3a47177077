#include "planner_daemon/coordination/cell_keeper.h"

#include <algorithm>
#include <utility>

namespace swarm {

using sogm_swarm::announcement_t;

namespace {

constexpr std::ptrdiff_t kMostLeft = 16;  // that a roster tells of: the newest

bool is_newer(const sogm_swarm::header_t& a, const sogm_swarm::header_t& b) {
  return std::pair(a.boot, a.seq) > std::pair(b.boot, b.seq);
}
// Whether a tombstone of the one is as good as of the other.
bool flies_the_same(const announcement_t& a, const announcement_t& b) {
  return a.committed.seq == b.committed.seq && a.pending.seq == b.pending.seq && a.radius == b.radius;
}
announcement_t without_acks(announcement_t message) {
  message.acks.clear();
  message.num_acks = 0;
  return message;
}

}  // namespace

void CellKeeper::receive(const CellAnnouncement& message, const Keep& keep) {
  static const Record kUnheardOf;
  const auto found = message.cells.find(book_.cell);
  if (found == message.cells.end()) return;
  const CellAnnouncement::Standing& standing = found->second;
  const int id = message.robot.header.robot_id;
  const auto known = book_.records.find(id);
  const Record& record = known != book_.records.end() ? known->second : kUnheardOf;
  if (standing.wish < record.wish || !is_newer(message.robot.header, record.robot.header)) return;
  const bool is_new = standing.wish > record.wish;
  const std::int64_t since = book_.seq + 1;
  if (!standing.wishes) {
    if (record.state == Membership::kLeft && !is_new && is_listed(record, book_)) return;
    Record left{Membership::kLeft, standing.wish, since, {}};
    left.robot.header = message.robot.header;
    change(id, std::move(left), record.state != Membership::kLeft, keep);
  } else if (is_new) {
    change(id, {Membership::kMember, standing.wish, since, without_acks(message.robot)}, true, keep);
  } else if (record.state == Membership::kMember && !flies_the_same(record.robot, message.robot)) {
    change(id, {Membership::kMember, record.wish, record.since, without_acks(message.robot)}, false, keep);
  }
}

bool CellKeeper::expel(int robot_id, const Keep& keep) {
  const auto found = book_.records.find(robot_id);
  if (found == book_.records.end() || found->second.state != Membership::kMember) return false;
  Record expelled = found->second;
  expelled.state = Membership::kExpelled;
  expelled.since = book_.seq + 1;
  return change(robot_id, std::move(expelled), true, keep);
}

bool CellKeeper::change(int robot_id, Record record, bool of_members, const Keep& keep) {
  const auto [entry, is_first] = book_.records.try_emplace(robot_id);
  std::swap(entry->second, record);
  const std::int64_t epoch_before = book_.epoch;
  ++book_.seq;
  if (of_members) book_.epoch = book_.seq;
  if (keep(book_)) return true;
  --book_.seq;
  book_.epoch = epoch_before;
  is_first ? void(book_.records.erase(entry)) : std::swap(entry->second, record);
  return false;
}

bool CellKeeper::is_listed(const Record& record, const Book& book) {
  return record.state != Membership::kLeft ||
         std::count_if(book.records.begin(), book.records.end(), [&record](const auto& entry) {
           return entry.second.state == Membership::kLeft && entry.second.since > record.since;
         }) < kMostLeft;
}

CellRoster CellKeeper::roster_of(const Book& book) {
  CellRoster roster{book.cell, book.seq, book.epoch, {}};
  for (const auto& [id, record] : book.records) {
    if (!is_listed(record, book)) continue;
    CellRoster::Entry& entry = roster.entries[id];
    entry = {record.state, record.wish, record.since};
    if (record.state == Membership::kExpelled) entry.tombstone = record.robot;
    if (record.state == Membership::kMember && record.robot.pending_state == announcement_t::kAnnounced)
      entry.recorded_seq = record.robot.pending.seq;
  }
  return roster;
}

}  // namespace swarm
