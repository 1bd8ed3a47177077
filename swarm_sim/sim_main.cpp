#include <iostream>
#include <string_view>

#include "lcmtypes/bus/option_set.h"
#include "swarm_sim/audit_command.h"
#include "swarm_sim/campaign_command.h"
#include "swarm_sim/run_command.h"
#include "swarm_sim/world_command.h"

namespace {

constexpr const char* kUsage =
    "swarm_sim: worlds and flights of the swarm\n"
    "  swarm_sim world [options] -o FILE     writes a seeded world file\n"
    "  swarm_sim run WORLD [options]         flies a world, in lock-step or with real daemons over real multicast\n"
    "  swarm_sim campaign [options] --out R  flies many seeded worlds in lock-step, a CSV row a trial\n"
    "  swarm_sim merge R... -o FILE          joins the results of a campaign's shards\n"
    "  swarm_sim audit LOG                   looks for committed trajectories that meet\n"
    "Each subcommand explains itself with --help; --version prints the version. Exit codes: 0 success, 1 flown but not "
    "successful, 2 bad input.\n";

}  // namespace

int main(int argc, char** argv) {
  const std::string_view command = argc > 1 ? argv[1] : "";
  if (command == "world") return swarm::world_command(argc - 1, argv + 1);
  if (command == "run") return swarm::run_command(argc - 1, argv + 1);
  if (command == "campaign") return swarm::campaign_command(argc - 1, argv + 1);
  if (command == "merge") return swarm::merge_command(argc - 1, argv + 1);
  if (command == "audit") return swarm::audit_command(argc - 1, argv + 1);
  if (command == "--help" || command == "-h") {
    std::cout << kUsage;
    return 0;
  }
  if (command == "--version") {
    std::cout << swarm::version_line("swarm_sim") << '\n';
    return 0;
  }
  std::cerr << "swarm_sim: "
            << (command.empty() ? "no subcommand" : "unknown subcommand '" + std::string(command) + "'")
            << "; must be world, run, campaign, merge or audit (see swarm_sim --help)\n";
  return 2;
}
