#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/realtime_host.h"
#include "planner_daemon/planner_node.h"

int main(int argc, char** argv) {
  swarm::PlannerNodeConfig config;
  return swarm::daemon_main(
      "planner_daemon",
      "Plans one robot's trajectory: listens to the spatiotemporal occupancy grid map, the goal and the committed\n"
      "trajectories of this robot and its peers, and sends a candidate trajectory to the broadcast daemon.",
      argc, argv, swarm::DaemonBuses::kOnboard, [&](swarm::OptionSet& options) { declare(options, config); },
      [&] { return std::make_unique<swarm::PlannerNode>(config, swarm::new_boot(), &swarm::stopwatch); });
}
