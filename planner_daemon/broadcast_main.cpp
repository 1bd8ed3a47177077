#include "lcmtypes/bus/realtime_host.h"
#include "planner_daemon/broadcast_node.h"

int main(int argc, char** argv) {
  swarm::BroadcastConfig config;
  return swarm::daemon_main(
      "broadcast_daemon",
      "Owns one robot's committed trajectory: announces it to the peers on the swarm bus, commits the planner's "
      "candidates\n"
      "when no peer objects, relays the peers' trajectories and samples setpoints for the flight controller.",
      argc, argv, swarm::DaemonBuses::kOnboardAndSwarm, [&](swarm::OptionSet& options) { declare(options, config); },
      [&] {
        const auto boot = static_cast<std::int32_t>(swarm::wall_utime() / 1'000'000);
        return std::make_unique<swarm::BroadcastNode>(config, boot);
      });
}
