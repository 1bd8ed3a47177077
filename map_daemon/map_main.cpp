// map_daemon: see map_node.h.
#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/realtime_host.h"
#include "map_daemon/map_node.h"

int main(int argc, char** argv) {
  swarm::MapConfig config;
  return swarm::daemon_main(
      "map_daemon", "Builds the spatiotemporal occupancy grid map around one robot.", argc, argv,
      swarm::DaemonBuses::kOnboard, [&](swarm::OptionSet& options) { swarm::declare(options, config); },
      [&] { return std::make_unique<swarm::MapNode>(config, swarm::new_boot(), &swarm::stopwatch); });
}
