// What is done after each tick of a flight, in every mode.
#pragma once

#include <functional>

#include "swarm_sim/environment/simulation.h"
#include "swarm_sim/results/recorder.h"

namespace swarm {

// Called with the world time [s] every 0.1 s of it; false ends the run.
using ProgressCallback = std::function<bool(double t_s, const Simulation&)>;

// Writes the trace, reports progress, and ends the host's run with the flight. `trace` and `progress` may be null.
Simulation::TickObserver follow_flight(FlightTrace* trace, ProgressCallback progress, std::function<void()> stop);

}  // namespace swarm
