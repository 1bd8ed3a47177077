// Flights in lock-step: every robot's three daemons and its environment as nodes of one process, on a simulated clock
// and simulated buses. The same world and options give the same bytes on the buses.
#pragma once

#include "lcmtypes/bus/time.h"
#include "swarm_sim/environment/simulation.h"
#include "swarm_sim/hosts/flight_options.h"
#include "swarm_sim/hosts/flight_progress.h"
#include "swarm_sim/results/recorder.h"
#include "swarm_sim/results/report.h"
#include "swarm_sim/world/occupied_cubes.h"
#include "swarm_sim/world/world.h"

namespace swarm {

// How long things take in the simulated machine.
struct LockstepDelays {
  Duration onboard = 1ms;  // message on an onboard bus
  Duration swarm = 2ms;    // message between robots
  Duration map = 5ms;      // what a map daemon says, on top: it builds a SOGM first
  Duration plan = 5ms;     // what a planner daemon says, on top: it plans first
  Duration look = 10ms;    // what a perception daemon says, on top
};

// Flies `world` to its end; the daemons of `threads` robots run at a time. `logs` and `trace` may be null. Throws
// OptionError where the options name a robot that the world has not.
RunReport run_lockstep(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                       const LockstepDelays& delays, BusLog* logs, FlightTrace* trace, const ProgressCallback& progress,
                       int threads = 1);

}  // namespace swarm
