#include "swarm_sim/hosts/flight_progress.h"

namespace swarm {
namespace {

constexpr Duration kProgressPeriod = 100ms;

}  // namespace

Simulation::TickObserver follow_flight(FlightTrace* trace, ProgressCallback progress, std::function<void()> stop) {
  return [trace, progress = std::move(progress), stop = std::move(stop)](double t_s, const Simulation& simulation) {
    if (trace != nullptr) trace->write(t_s, simulation);
    if (simulation.judge().finished()) return stop();
    const bool due = to_duration(t_s) % kProgressPeriod == 0us;
    if (progress && due && !progress(t_s, simulation)) stop();
  };
}

}  // namespace swarm
