#include "swarm_sim/hosts/flight_progress.h"

#include <cmath>

namespace swarm {

Simulation::TickObserver follow_flight(TraceWriter* trace, ProgressCallback progress, std::function<void()> stop) {
  constexpr std::int64_t kProgressPeriod_us = 100'000;
  return [trace, progress = std::move(progress), stop = std::move(stop)](double t_s, const Simulation& simulation) {
    if (trace != nullptr) trace->write(t_s, simulation);
    if (simulation.judge().finished()) return stop();
    const bool due = std::llround(1e6 * t_s) % kProgressPeriod_us == 0;
    if (progress && due && !progress(t_s, simulation)) stop();
  };
}

}  // namespace swarm
