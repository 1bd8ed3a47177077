#include "swarm_sim/results/commit_audit.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <iostream>
#include <stdexcept>
#include <string>
#include <tuple>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_log.h"
#include "lcmtypes/bus/option_set.h"
#include "planner_daemon/coordination/deconfliction.h"
#include "swarm_sim/environment/simulation.h"

namespace swarm {
namespace {

constexpr std::int64_t kLately_us = 5'000'000;  // so long a forced motion excuses that it meets others

}  // namespace

bool CommitAudit::Announcement::differs(const Announcement& other) const {
  return std::tuple(header.boot, radius_m, motion.seq()) !=
         std::tuple(other.header.boot, other.radius_m, other.motion.seq());
}

void CommitAudit::Announcement::set_back(std::int64_t clock_offset_us) {
  header.utime -= clock_offset_us;
  motion.committed.shift(-clock_offset_us);
  motion.next.shift(-clock_offset_us);
}

bool CommitAudit::Announcement::is_forced(std::int64_t utime) const {
  return std::ranges::any_of(std::array{&motion.committed, &motion.next}, [&](const Trajectory* trajectory) {
    return !trajectory->empty() && trajectory->seq() == forced_seq && utime < trajectory->start_utime() + kLately_us;
  });
}

bool CommitAudit::read(std::span<const std::uint8_t> bytes, Announcement* announcement) {
  sogm_swarm::announcement_t message;
  if (decode(bytes, &message) != Refusal::kNone) return false;
  announcement->header = message.header;
  announcement->radius_m = message.radius;
  announcement->forced_seq = message.forced_seq;
  Trajectory announced;  // not committed
  read_announcement(message, &announcement->motion, &announced);
  return true;
}

void CommitAudit::hear(std::span<const std::uint8_t> bytes, std::int64_t clock_offset_us) {
  Announcement announcement;
  if (!read(bytes, &announcement)) return;
  announcement.set_back(clock_offset_us);
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
  const std::int64_t utime = announcement.header.utime;
  for (const auto& [other_id, other] : robots_) {
    if (other_id == id) continue;
    const Announcement& theirs = other.newest;
    if (motions_separated(announcement.motion, theirs.motion, utime, announcement.radius_m + theirs.radius_m)) continue;
    conflicts_.push_back({utime, id, other_id, announcement.motion.seq(), theirs.motion.seq(),
                          announcement.is_forced(utime) || theirs.is_forced(utime)});
  }
}

void CommitAudit::collect(std::span<const std::uint8_t> bytes) {
  Announcement announcement;
  if (!read(bytes, &announcement)) return;
  const auto [newest, is_first] = newest_.try_emplace(announcement.header.robot_id, announcement);
  if (!is_first && !announcement.differs(newest->second)) return;
  newest->second = announcement;
  collected_.push_back(announcement);
}

void CommitAudit::finish(double clock_offset_ms) {
  const std::vector<std::int64_t> offsets = clock_offsets_us(clock_offset_ms, newest_.size());
  for (Announcement& announcement : collected_) {
    const auto place = std::distance(newest_.begin(), newest_.find(announcement.header.robot_id));
    announcement.set_back(offsets[static_cast<std::size_t>(place)]);
  }
  std::ranges::stable_sort(collected_, {}, [](const Announcement& a) { return a.header.utime; });
  for (const Announcement& announcement : collected_) hear(announcement);
  collected_.clear();
}

CommitAudit audit_log(const std::filesystem::path& path, double clock_offset_ms) {
  LcmLog log(path);
  CommitAudit audit;
  for (LogEvent event; log.next(&event);) {
    if (event.channel == channel::kTrajectory) audit.collect(event.bytes);
  }
  audit.finish(clock_offset_ms);
  return audit;
}

int audit_command(int argc, const char* const* argv) try {
  std::string path;
  double clock_offset_ms = 0.0;
  OptionSet options(
      "swarm_sim audit",
      "Audits a log of the swarm bus (swarm.lcm of a run, or lcm-logger's): no two committed trajectories\n"
      "may come closer than the sum of the radii, ever. Exit codes: 0 none does but for forced ones, 1 some do, 2 bad "
      "input.");
  options.add_positional("log", &path, "LCM log");
  options.add("clock-offset-ms", &clock_offset_ms, 0, 10'000, "ms", "of the flight, as of swarm_sim run");
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  const CommitAudit audit = audit_log(path, clock_offset_ms);
  if (audit.motions() == 0) throw std::runtime_error(path + ": holds no announcements");
  std::printf("%s: %d robots, %lld committed motions (%lld forced), %zu conflicts\n", path.c_str(), audit.robots(),
              static_cast<long long>(audit.motions()), static_cast<long long>(audit.forced()),
              audit.conflicts().size());
  for (const CommitConflict& c : audit.conflicts()) {
    std::printf("  %lld: robot %d (trajectory %d) and robot %d (trajectory %d)%s\n", static_cast<long long>(c.utime),
                c.robot, c.seq, c.other, c.other_seq, c.forced ? ", forced" : "");
  }
  return std::ranges::all_of(audit.conflicts(), &CommitConflict::forced) ? 0 : 1;
} catch (const std::exception& error) {
  std::cerr << "swarm_sim audit: " << error.what() << '\n';
  return 2;
}

}  // namespace swarm
