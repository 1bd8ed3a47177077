#include "swarm_sim/commit_audit.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>
#include <string>

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/deconfliction.h"

namespace swarm {

void CommitAudit::hear(std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  if (decode(bytes, &message) != Refusal::kNone) return;
  Robot& robot = robots_[message.header.robot_id];
  if (robot.gate.pass(message.header) != Refusal::kNone) return;
  Robot newest = robot;
  newest.radius_m = message.radius;
  Trajectory announced;  // not committed
  read_announcement(message, &newest.motion, &announced);
  const bool is_new = newest.bound_to() != robot.bound_to() || newest.radius_m != robot.radius_m;
  robot = newest;
  if (!is_new) return;
  ++motions_;
  for (const auto& [id, other] : robots_) {
    if (id == message.header.robot_id) continue;
    if (motions_separated(robot.motion, other.motion, message.header.utime, robot.radius_m + other.radius_m)) continue;
    conflicts_.push_back({message.header.utime, message.header.robot_id, id, robot.bound_to(), other.bound_to()});
  }
}

CommitAudit audit_log(const std::filesystem::path& path) {
  lcm::LogFile log(path.string(), "r");
  if (!log.good()) throw std::runtime_error(path.string() + ": must be a readable LCM log");
  std::vector<std::pair<std::int64_t, std::vector<std::uint8_t>>> announcements;
  while (const lcm::LogEvent* event = log.readNextEvent()) {
    if (event->channel != channel::kTrajectory) continue;
    const auto* data = static_cast<const std::uint8_t*>(event->data);
    std::vector<std::uint8_t> bytes(data, data + event->datalen);
    sogm_swarm::announcement_t message;
    if (decode(bytes, &message) == Refusal::kNone) announcements.emplace_back(message.header.utime, std::move(bytes));
  }
  std::ranges::stable_sort(announcements, {}, [](const auto& announcement) { return announcement.first; });
  CommitAudit audit;
  for (const auto& [utime, bytes] : announcements) audit.hear(bytes);
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
