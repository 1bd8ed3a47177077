// perception_daemon: see perception_node.h.
#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/realtime_host.h"
#include "map_daemon/perception/perception_node.h"

int main(int argc, char** argv) {
  swarm::PerceptionNodeConfig config;
  return swarm::daemon_main(
      "perception_daemon", "Finds obstacles, and what is free, in the scans of depth cameras and LiDARs.", argc, argv,
      swarm::DaemonBuses::kOnboard, [&](swarm::OptionSet& options) { swarm::declare(options, config); },
      [&] { return std::make_unique<swarm::PerceptionNode>(config, swarm::new_boot(), &swarm::stopwatch); });
}
