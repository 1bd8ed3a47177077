// Flights with real daemons over real multicast, each robot on its own onboard port as on a computer of its own. This
// process starts the daemons and watches over them; the robots' environments run in it, in real time.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>

#include "lcmtypes/bus/bus_url.h"
#include "swarm_sim/environment/simulation.h"
#include "swarm_sim/hosts/autopilot.h"
#include "swarm_sim/hosts/flight_options.h"
#include "swarm_sim/hosts/flight_progress.h"
#include "swarm_sim/results/recorder.h"
#include "swarm_sim/results/report.h"
#include "swarm_sim/world/occupied_cubes.h"
#include "swarm_sim/world/world.h"

namespace swarm {

struct ProcessOptions {
  bool start_daemons = true;         // false: they run already, as configured elsewhere
  int base_port = kDefaultBasePort;  // swarm bus; robot k's onboard bus is base_port + 33 + k
  std::string mavlink;  // each robot flies through mavlink_bridge and a simulated flight controller, which is told
                        // position or attitude; empty: no
  AutopilotOptions autopilot;  // of those
  std::string netns;           // robot k is in the network namespace of this name and its number; empty: all are here
  std::filesystem::path out;   // the daemons' config files and output go here; empty: a temporary directory
  std::filesystem::path programs;  // where the daemons are; empty: beside this program
};

// SIGINT or SIGTERM ended the run.
struct Interrupted : std::runtime_error {
  Interrupted() : std::runtime_error("interrupted") {}
};

// Flies `world` to its end; all children have ended when this returns or throws. `logs` and `trace` may be null. Throws
// std::runtime_error when a daemon cannot be started, does not get ready or dies, Interrupted on a signal or when
// `progress` ends the run, but in an endless world.
RunReport run_processes(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                        const ProcessOptions& processes, BusLog* logs, FlightTrace* trace,
                        const ProgressCallback& progress);

}  // namespace swarm
