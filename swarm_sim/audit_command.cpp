#include "swarm_sim/audit_command.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <stdexcept>
#include <string>

#include "lcmtypes/bus/option_set.h"
#include "swarm_sim/results/commit_audit.h"

namespace swarm {

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
    std::printf("  %lld: robot %d (trajectory %d) and robot %d (trajectory %d)%s\n",
                static_cast<long long>(to_us(c.utime)), c.robot, c.seq, c.other, c.other_seq,
                c.forced ? ", forced" : "");
  }
  return std::ranges::all_of(audit.conflicts(), &CommitConflict::forced) ? 0 : 1;
} catch (const std::exception& error) {
  std::cerr << "swarm_sim audit: " << error.what() << '\n';
  return 2;
}

}  // namespace swarm
