#include "swarm_sim/environment/simulation.h"

#include <stdexcept>
#include <string>
#include <utility>

namespace swarm {

Simulation::Simulation(const World& world, const OccupiedCubes* static_map, const SimulationOptions& options,
                       Utime utime, TickObserver on_tick)
    : world_(world),
      static_map_(static_map),
      clock_steps_(options.clock_steps),
      state_outages_(options.state_outages),
      judge_(world, static_map, options.time_limit_s),
      on_tick_(std::move(on_tick)),
      now_(tick_at(utime)),
      tracking_m_(world.robots.size()) {
  const std::vector<Duration> clocks = clock_offsets(options.clock_offset_ms, world);
  for (std::size_t i = 0; i < world.robots.size(); ++i) {
    const int id = world.robots[i].id;
    std::optional<PoseDrift> drift;
    if (!world.sensor.pose_drift.empty())
      drift.emplace(world.sensor.pose_drift, seed_of(world.name + " drift " + std::to_string(id)));
    vehicles_.emplace_back(id, world.robots[i].start, clocks[i], world.vehicle, world.name, std::move(drift));
  }
}

void Simulation::start(Utime utime) {
  if (utime != tick_at(utime) || utime <= now_)
    throw std::invalid_argument("utime: " + std::to_string(to_us(utime)) + " must be a tick later than " +
                                std::to_string(to_us(now_)));
  start_ = utime;
}

bool Simulation::tells_state(std::size_t index) const {
  return !is_out(state_outages_, world_.robots[index].id, t_s(now_));
}

void Simulation::advance(Utime utime) {
  while (now_ + kTick <= utime && !judge_.finished()) tick();
}

void Simulation::tick() {
  now_ += kTick;
  std::erase_if(clock_steps_, [this](const ClockStep& step) {
    if (!start_ || t_s(now_) < step.at_s) return false;
    for (Vehicle& vehicle : vehicles_)
      if (vehicle.id() == step.robot_id) vehicle.step_clock(step.by);
    return true;
  });
  states_.clear();
  for (Vehicle& vehicle : vehicles_) {
    vehicle.move_to(now_, t_s(now_));
    states_.push_back(vehicle.state());
  }
  if (!start_ || now_ < *start_) return;
  judge_.update(t_s(now_), states_);
  for (std::size_t i = 0; i < vehicles_.size(); ++i)
    tracking_m_[i].push_back((vehicles_[i].state().position - vehicles_[i].reference().position).norm());
  if (on_tick_) on_tick_(t_s(now_), *this);
}

}  // namespace swarm
