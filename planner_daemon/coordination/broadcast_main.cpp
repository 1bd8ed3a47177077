#include <spdlog/spdlog.h>

#include <filesystem>
#include <memory>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/realtime_host.h"
#include "planner_daemon/coordination/broadcast_node.h"

int main(int argc, char** argv) {
  using namespace std::chrono_literals;
  swarm::BroadcastConfig config;
  std::unique_ptr<swarm::PromiseStore> store;
  return swarm::daemon_main(
      "broadcast_daemon",
      "Owns one robot's committed trajectory: announces it to the peers on the swarm bus, commits the planner's "
      "candidates\n"
      "when no peer objects, relays the peers' trajectories and samples setpoints for the flight controller.",
      argc, argv, swarm::DaemonBuses::kOnboardAndSwarm, [&](swarm::OptionSet& options) { declare(options, config); },
      [&] {
        verify(config);
        auto boot = static_cast<std::int32_t>(swarm::wall_utime().time_since_epoch() / 1s);
        if (config.state_dir.empty()) {
          spdlog::warn(
              "no --state-dir: what was promised does not survive a crash of this daemon, and nobody believes it any "
              "more "
              "after a crash with a clock that was set back");
          store = std::make_unique<swarm::MemoryPromiseStore>();
          boot = swarm::new_boot_by_wall_clock();
        } else {
          std::filesystem::create_directories(config.state_dir);
          store = std::make_unique<swarm::FilePromiseStore>(std::filesystem::path(config.state_dir) /
                                                            ("robot" + std::to_string(config.robot_id) + ".promise"));
        }
        return std::make_unique<swarm::BroadcastNode>(config, *store, boot);
      });
}
