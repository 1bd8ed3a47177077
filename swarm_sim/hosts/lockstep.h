// Lock-step host: every robot's three nodes and the simulation in one process, on a simulated clock and simulated
// buses. Events run in the order (time, node, sequence), so the same world and options give the same bytes on the
// buses.
#pragma once

#include <cstdint>
#include <functional>

#include "swarm_sim/environment/simulation.h"
#include "swarm_sim/hosts/flight_options.h"
#include "swarm_sim/results/recorder.h"
#include "swarm_sim/results/report.h"
#include "swarm_sim/world/occupied_cubes.h"
#include "swarm_sim/world/world.h"

namespace swarm {

// How long things take in the simulated machine.
struct LockstepDelays {
  std::int64_t onboard_us = 1'000;  // message on an onboard bus
  std::int64_t swarm_us = 2'000;    // message between robots
  std::int64_t map_us = 5'000;      // building a SOGM, on top
  std::int64_t plan_us = 5'000;     // planning, on top
};

// Called with the world time [s] every simulated 0.1 s; false ends the run.
using ProgressCallback = std::function<bool(double t_s, const Simulation&)>;

// Flies `world` to its end. `logs` and `trace` may be null.
RunReport run_lockstep(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                       const LockstepDelays& delays, BusLog* logs, TraceWriter* trace,
                       const ProgressCallback& progress);

}  // namespace swarm
