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
  const auto found = message.cells.find(book_.cell);
  if (found == message.cells.end()) return;
  const CellAnnouncement::Standing& standing = found->second;
  Book next = book_;
  Record& record = next.records[message.robot.header.robot_id];
  if (standing.wish < record.wish || !is_newer(message.robot.header, record.robot.header)) return;
  const bool is_new = standing.wish > record.wish;
  if (!standing.wishes) {
    if (record.state == Membership::kLeft && !is_new && is_listed(record)) return;
    const bool was_here = record.state != Membership::kLeft;
    record = {Membership::kLeft, standing.wish, next.seq + 1, {}};
    record.robot.header = message.robot.header;
    change(std::move(next), was_here, keep);
  } else if (is_new) {
    record = {Membership::kMember, standing.wish, next.seq + 1, without_acks(message.robot)};
    change(std::move(next), true, keep);
  } else if (record.state == Membership::kMember && !flies_the_same(record.robot, message.robot)) {
    record.robot = without_acks(message.robot);
    change(std::move(next), false, keep);
  }
}

bool CellKeeper::expel(int robot_id, const Keep& keep) {
  Book next = book_;
  const auto found = next.records.find(robot_id);
  if (found == next.records.end() || found->second.state != Membership::kMember) return false;
  found->second.state = Membership::kExpelled;
  found->second.since = next.seq + 1;
  return change(std::move(next), true, keep);
}

bool CellKeeper::change(Book next, bool of_members, const Keep& keep) {
  ++next.seq;
  if (of_members) next.epoch = next.seq;
  if (!keep(next)) return false;
  book_ = std::move(next);
  return true;
}

bool CellKeeper::is_listed(const Record& record) const {
  return record.state != Membership::kLeft ||
         std::count_if(book_.records.begin(), book_.records.end(), [&record](const auto& entry) {
           return entry.second.state == Membership::kLeft && entry.second.since > record.since;
         }) < kMostLeft;
}

CellRoster CellKeeper::roster() const {
  CellRoster roster{book_.cell, book_.seq, book_.epoch, {}};
  for (const auto& [id, record] : book_.records) {
    if (!is_listed(record)) continue;
    CellRoster::Entry& entry = roster.entries[id];
    entry = {record.state, record.wish, record.since};
    if (record.state == Membership::kExpelled) entry.tombstone = record.robot;
    if (record.state == Membership::kMember && record.robot.pending_state == announcement_t::kAnnounced)
      entry.recorded_seq = record.robot.pending.seq;
  }
  return roster;
}

}  // namespace swarm
