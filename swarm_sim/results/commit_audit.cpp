#include "swarm_sim/results/commit_audit.h"

#include <algorithm>
#include <array>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_log.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "planner_daemon/coordination/deconfliction.h"
#include "swarm_sim/world/clocks.h"

namespace swarm {
namespace {

constexpr Duration kLately = 5s;  // so long a forced motion excuses that it meets others
constexpr Duration kSet = 20ms;  // a clock that differs so much from what it was given has been set; a packet is faster

}  // namespace

// Of the copies that a robot sends to several cells the first one counts.
Refusal CommitAudit::read_in_cells(std::span<const std::uint8_t> bytes, sogm_swarm::announcement_t* message) {
  sogm_swarm::cell_announcement_t packed;
  CellAnnouncement said;
  Refusal refusal = decode(bytes, &packed);
  if (refusal == Refusal::kNone) refusal = copies_[packed.header.robot_id].pass(packed.header);
  if (refusal == Refusal::kNone) refusal = unpack(packed, &said);
  *message = std::move(said.robot);
  return refusal;
}

bool CommitAudit::Announcement::differs(const Announcement& other) const {
  return std::pair(header.boot, motion.seq()) != std::pair(other.header.boot, other.motion.seq());
}

void CommitAudit::Announcement::set_back(Duration clock_offset) {
  header.utime -= clock_offset.count();
  motion.committed.shift(-clock_offset);
  motion.next.shift(-clock_offset);
}

bool CommitAudit::Announcement::is_forced(Utime utime) const {
  return std::ranges::any_of(std::array{&motion.committed, &motion.next}, [&](const Trajectory* trajectory) {
    return !trajectory->empty() && trajectory->seq() == forced_seq && utime < trajectory->start_utime() + kLately;
  });
}

bool CommitAudit::read(std::span<const std::uint8_t> bytes, Announcement* announcement) {
  sogm_swarm::announcement_t message;
  Refusal refusal = decode_packed(bytes, &message);
  if (refusal == Refusal::kFingerprint) refusal = read_in_cells(bytes, &message);
  if (refusal != Refusal::kNone) return false;
  announcement->header = message.header;
  const auto [radius_m, is_first] = radii_m_.try_emplace(message.header.robot_id, message.radius);
  radius_m->second = std::min<double>(radius_m->second, message.radius);
  announcement->forced_seq = message.forced_seq;
  announcement->motion = motion_of(message);
  announcement->space = space_of(announcement->motion, {});
  return true;
}

void CommitAudit::hear_own(std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  if (decode(bytes, &message) != Refusal::kNone) return;
  if (message.pending_state != sogm_swarm::announcement_t::kCommitted) return;
  const std::pair trajectory(message.header.boot, message.pending.seq);
  const auto [newest, is_first] = committed_.try_emplace(message.header.robot_id, trajectory);
  if (!is_first && trajectory <= newest->second) return;  // it was heard before
  newest->second = trajectory;
  delays_ms_.push_back(to_ms(to_utime(message.header.utime) - to_utime(message.pending_stamp)));
}

void CommitAudit::hear(std::span<const std::uint8_t> bytes, Duration clock_offset) {
  Announcement announcement;
  if (!read(bytes, &announcement)) return;
  announcement.set_back(clock_offset);
  hear(announcement);
}

void CommitAudit::hear(const Announcement& announcement) {
  const int id = announcement.header.robot_id;
  Robot& robot = robots_[id];
  if (robot.gate.pass(announcement.header) != Refusal::kNone) return;
  const bool is_new = announcement.differs(robot.newest);
  if (announcement.forced_seq != robot.newest.forced_seq) ++forced_;  // a restart forgets none
  robot.newest = announcement;
  if (!is_new) return;
  ++motions_;
  const Utime utime = to_utime(announcement.header.utime);
  for (const auto& [other_id, other] : robots_) {
    if (other_id == id) continue;
    const Announcement& theirs = other.newest;
    const double apart_m = radii_m_.at(id) + radii_m_.at(other_id);
    if (announcement.space.exteriorDistance(theirs.space) > apart_m) continue;
    if (motions_separated(announcement.motion, theirs.motion, utime, apart_m)) continue;
    conflicts_.push_back({utime, id, other_id, announcement.motion.seq(), theirs.motion.seq(),
                          announcement.is_forced(utime) || theirs.is_forced(utime)});
  }
}

void CommitAudit::collect(std::span<const std::uint8_t> bytes, std::optional<Utime> sent) {
  Announcement announcement;
  if (!read(bytes, &announcement)) return;
  announcement.sent = sent;
  const auto [newest, is_first] = newest_.try_emplace(announcement.header.robot_id, announcement);
  if (!is_first && !announcement.differs(newest->second)) return;
  newest->second = announcement;
  collected_.push_back(announcement);
  if (collected_.size() >= kMostCollected) hear_collected(kMostCollected / 2);
}

void CommitAudit::finish() {
  hear_collected(collected_.size());
}

void CommitAudit::hear_collected(std::size_t count) {
  const std::vector<Duration> offsets = clock_offsets(clock_offset_ms_, newest_.size());
  for (Announcement& announcement : collected_) {
    if (std::exchange(announcement.is_set_back, true)) continue;
    const auto place = std::distance(newest_.begin(), newest_.find(announcement.header.robot_id));
    Duration offset = offsets[static_cast<std::size_t>(place)];
    if (announcement.sent) {
      const Duration ahead = to_utime(announcement.header.utime) - *announcement.sent;
      if (std::chrono::abs(ahead - offset) > kSet) offset = ahead;
    }
    announcement.set_back(offset);
  }
  std::ranges::stable_sort(collected_, {}, [](const Announcement& a) { return a.header.utime; });
  const auto end = collected_.begin() + static_cast<std::ptrdiff_t>(count);
  std::for_each(collected_.begin(), end, [this](const Announcement& announcement) { hear(announcement); });
  collected_.erase(collected_.begin(), end);
}

CommitAudit audit_log(const std::filesystem::path& path, double clock_offset_ms) {
  LcmLog log(path);
  CommitAudit audit(clock_offset_ms);
  for (LogEvent event; log.next(&event);) {
    const std::string_view kind = kind_of(event.channel);
    if (kind == channel::kAnnouncement || kind == channel::kCellAnnouncement) audit.collect(event.bytes);
  }
  audit.finish();
  return audit;
}

}  // namespace swarm
