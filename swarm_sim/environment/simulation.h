// The world's side of a run, the same in every mode: obstacles move, robots sense them and track their setpoints, the
// judge watches. Knows neither buses nor clocks: the hosts carry its messages.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "swarm_sim/environment/judge.h"
#include "swarm_sim/environment/vehicle.h"
#include "swarm_sim/world/world.h"

namespace swarm {

class Simulation {
 public:
  static constexpr std::int64_t kTick_us = 10'000;

  // Called after each tick with the world time [s].
  using TickObserver = std::function<void(double t_s, const Simulation&)>;

  // `world` and `static_map` must outlive the simulation; `static_map` and `on_tick` may be null.
  Simulation(const World& world, const OccupiedCubes* static_map, double time_limit_s, double clock_offset_ms,
             TickObserver on_tick);

  const World& world() const { return world_; }
  const Judge& judge() const { return judge_; }
  // In the world's order. A robot's messages, both ways, carry the time of its own clock.
  const std::vector<Vehicle>& vehicles() const { return vehicles_; }
  Vehicle& vehicle(std::size_t index) { return vehicles_[index]; }

  // Moves the robots to world time `t_s` >= 0, then judges. To be called every kTick_us. Before the start of the world
  // only `settle` is called.
  void tick(double t_s, std::int64_t utime);
  // Moves the robots without judging: the time before the start.
  void settle(std::int64_t utime);

  // What robot `index` knows at world time `t_s`: itself, the obstacles within its sensing radius, its goal. Before the
  // start (t_s < 0) the obstacles stand where they will be at 0.
  sogm_swarm::robot_state_t state_message(std::size_t index, std::int64_t utime);
  sogm_swarm::obstacles_t obstacles_message(std::size_t index, double t_s, std::int64_t utime);
  sogm_swarm::goal_t goal_message(std::size_t index, std::int64_t utime);

 private:
  struct Headers {
    HeaderSource state, obstacles, goal;
  };

  const World& world_;
  Judge judge_;
  TickObserver on_tick_;
  std::vector<Vehicle> vehicles_;
  std::vector<Headers> headers_;
  std::vector<MotionState> states_;  // of the vehicles, as the judge takes them
};

}  // namespace swarm
