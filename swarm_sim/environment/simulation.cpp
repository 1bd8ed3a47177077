#include "swarm_sim/environment/simulation.h"

#include <stdexcept>
#include <string>

#include "swarm_sim/world/clocks.h"

namespace swarm {

Simulation::Simulation(const World& world, const OccupiedCubes* static_map, const SimulationOptions& options,
                       std::int64_t utime, TickObserver on_tick)
    : world_(world),
      judge_(world, static_map, options.time_limit_s),
      on_tick_(std::move(on_tick)),
      now_us_(utime - utime % kTick_us) {
  const std::vector<std::int64_t> clocks_us = clock_offsets_us(options.clock_offset_ms, world);
  for (std::size_t i = 0; i < world.robots.size(); ++i)
    vehicles_.emplace_back(world.robots[i].id, world.robots[i].start, clocks_us[i]);
}

void Simulation::start(std::int64_t utime) {
  if (utime % kTick_us != 0 || utime <= now_us_)
    throw std::invalid_argument("utime: " + std::to_string(utime) + " must be a tick later than " +
                                std::to_string(now_us_));
  start_us_ = utime;
}

void Simulation::advance(std::int64_t utime) {
  while (now_us_ + kTick_us <= utime && !judge_.finished()) tick();
}

void Simulation::tick() {
  now_us_ += kTick_us;
  states_.clear();
  for (Vehicle& vehicle : vehicles_) {
    vehicle.move_to(now_us_);
    states_.push_back(vehicle.state());
  }
  if (!start_us_ || now_us_ < *start_us_) return;
  judge_.update(t_s(now_us_), states_);
  if (on_tick_) on_tick_(t_s(now_us_), *this);
}

}  // namespace swarm
