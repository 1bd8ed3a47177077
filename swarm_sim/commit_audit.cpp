#include "swarm_sim/commit_audit.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>
#include <string>
#include <tuple>

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/deconfliction.h"

namespace swarm {

bool CommitAudit::Announcement::differs(const Announcement& other) const {
  return std::tuple(header.boot, radius_m, motion.seq()) !=
         std::tuple(other.header.boot, other.radius_m, other.motion.seq());
}

bool CommitAudit::read(std::span<const std::uint8_t> bytes, Announcement* announcement) {
  sogm_swarm::announcement_t message;
  if (decode(bytes, &message) != Refusal::kNone) return false;
  announcement->header = message.header;
  announcement->radius_m = message.radius;
  Trajectory announced;  // not committed
  read_announcement(message, &announcement->motion, &announced);
  return true;
}

void CommitAudit::hear(std::span<const std::uint8_t> bytes) {
  Announcement announcement;
  if (read(bytes, &announcement)) hear(announcement);
}

void CommitAudit::hear(const Announcement& announcement) {
  const int id = announcement.header.robot_id;
  Robot& robot = robots_[id];
  if (robot.gate.pass(announcement.header) != Refusal::kNone) return;
  const bool is_new = announcement.differs(robot.newest);
  robot.newest = announcement;
  if (!is_new) return;
  ++motions_;
  const std::int64_t utime = announcement.header.utime;
  for (const auto& [other_id, other] : robots_) {
    if (other_id == id) continue;
    const Announcement& theirs = other.newest;
    if (motions_separated(announcement.motion, theirs.motion, utime, announcement.radius_m + theirs.radius_m)) continue;
    conflicts_.push_back({utime, id, other_id, announcement.motion.seq(), theirs.motion.seq()});
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

void CommitAudit::finish() {
  std::ranges::stable_sort(collected_, {}, [](const Announcement& a) { return a.header.utime; });
  for (const Announcement& announcement : collected_) hear(announcement);
  collected_.clear();
}

CommitAudit audit_log(const std::filesystem::path& path) {
  lcm::LogFile log(path.string(), "r");
  if (!log.good()) throw std::runtime_error(path.string() + ": must be a readable LCM log");
  CommitAudit audit;
  while (const lcm::LogEvent* event = log.readNextEvent()) {
    if (event->channel != channel::kTrajectory) continue;
    audit.collect({static_cast<const std::uint8_t*>(event->data), static_cast<std::size_t>(event->datalen)});
  }
  audit.finish();
  return audit;
}

int audit_command(int argc, const char* const* argv) try {
  constexpr const char* kUsage =
      "Usage: swarm_sim audit LOG...\n"
      "Audits logs of the swarm bus (swarm.lcm of a run, or lcm-logger's): no two committed trajectories may come "
      "closer than\nthe sum of the radii, ever. Exit codes: 0 none does, 1 some do, 2 bad input.\n";
  std::vector<std::string> paths(argv + 1, argv + argc);
  if (paths.size() == 1 && (paths[0] == "--help" || paths[0] == "-h")) {
    std::cout << kUsage;
    return 0;
  }
  if (paths.empty()) throw std::runtime_error("a log must be given (see --help)");
  bool clean = true;
  for (const std::string& path : paths) {
    const CommitAudit audit = audit_log(path);
    if (audit.motions() == 0) throw std::runtime_error(path + ": holds no announcements");
    std::printf("%s: %d robots, %lld committed motions, %zu conflicts\n", path.c_str(), audit.robots(),
                static_cast<long long>(audit.motions()), audit.conflicts().size());
    for (const CommitConflict& c : audit.conflicts()) {
      std::printf("  %lld: robot %d (trajectory %d) and robot %d (trajectory %d)\n", static_cast<long long>(c.utime),
                  c.robot, c.seq, c.other, c.other_seq);
    }
    clean = clean && audit.conflicts().empty();
  }
  return clean ? 0 : 1;
} catch (const std::exception& error) {
  std::cerr << "swarm_sim audit: " << error.what() << '\n';
  return 2;
}

}  // namespace swarm
