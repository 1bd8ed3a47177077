#include <spdlog/spdlog.h>

#include <memory>
#include <stdexcept>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/realtime_host.h"
#include "planner_daemon/coordination/keeper_node.h"

int main(int argc, char** argv) {
  swarm::KeeperConfig config;
  bool begins = false;
  std::unique_ptr<swarm::BookStore> store;
  return swarm::daemon_main(
      "keeper_daemon",
      "Keeps the cells of a part of the ground for robots that fly in cells: who is a member of which, and what each "
      "is "
      "bound\n"
      "to. Goes on with the books in --state-dir.",
      argc, argv, swarm::DaemonBuses::kSwarm,
      [&](swarm::OptionSet& options) {
        declare(options, config);
        options.add("new", &begins, "begins books where --state-dir has none: only while no robot flies");
      },
      [&] {
        verify(config);
        if (begins && config.state_dir.empty()) throw swarm::OptionError("--new: wants a --state-dir");
        if (config.state_dir.empty()) {
          spdlog::warn(
              "no --state-dir: after a crash of this daemon nobody may fly in its cells before all have landed");
          store = std::make_unique<swarm::MemoryBookStore>();
        } else {
          if (begins) swarm::FileBookStore::begin(config.state_dir, config.cell_m);
          store = std::make_unique<swarm::FileBookStore>(config.state_dir, config.cell_m);
        }
        return std::make_unique<swarm::KeeperNode>(config, *store, swarm::new_boot_by_wall_clock());
      });
}
