// The world's side of a run, the same in every mode: obstacles move, robots sense them and track their setpoints, the
// judge watches and the trace is written. Knows neither buses nor clocks: the hosts carry its messages.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "map_daemon/map_node.h"
#include "planner_daemon/coordination/broadcast_node.h"
#include "planner_daemon/planner_node.h"
#include "swarm_sim/environment/faults.h"
#include "swarm_sim/environment/judge.h"
#include "swarm_sim/hosts/link_model.h"
#include "swarm_sim/results/recorder.h"
#include "swarm_sim/world/world.h"

namespace swarm {

// What a run flies with, besides the world: the daemons' configurations before identity, limits and space are filled
// in.
struct FlightOptions {
  double time_limit_s = 60.0;
  double sensor_rate_hz = 20.0;  // of obstacle detections
  MapConfig map;
  PlannerNodeConfig planner;
  BroadcastConfig broadcast;
  LinkOptions link;              // between robots
  double clock_offset_ms = 0.0;  // the lowest id's clock is so much behind the highest's; the others lie between
  std::vector<Kill> kills;
};

// The daemons' configurations for one robot of a world.
MapConfig map_config(const World& world, const WorldRobot& robot, const FlightOptions& options);
PlannerNodeConfig planner_config(const World& world, const WorldRobot& robot, const FlightOptions& options);
BroadcastConfig broadcast_config(const World& world, const WorldRobot& robot, const FlightOptions& options);

// Of a robot in the world's order, by its id. Throws OptionError, beginning with `option`, where there is none.
std::size_t index_of_robot(const World& world, int id, const char* option);

// By how much the clock of each of n robots is ahead of the world's, the lowest id's first [us].
std::vector<std::int64_t> clock_offsets_us(double offset_ms, std::size_t n);

class Simulation {
 public:
  static constexpr std::int64_t kTick_us = 10'000;

  // All arguments must outlive the simulation; `static_map` and `trace` may be null. Throws OptionError where the
  // options name a robot that the world has not.
  Simulation(const World& world, const OccupiedCubes* static_map, const FlightOptions& options, TraceWriter* trace);

  std::size_t num_robots() const { return vehicles_.size(); }
  const Judge& judge() const { return judge_; }

  // By how much the clock of robot `index` is ahead of the world's; its messages, both ways, carry its own time.
  std::int64_t clock_offset_us(std::size_t index) const { return vehicles_[index].clock_offset_us; }

  // A setpoint message of robot `index` (in the world's order); anything else is ignored.
  void on_setpoint(std::size_t index, std::span<const std::uint8_t> bytes);
  // The robot's own announcement: its flight controller follows what it is bound to while there are no setpoints.
  void on_own_trajectory(std::size_t index, std::span<const std::uint8_t> bytes);
  // Moves the robots to world time `t_s` >= 0 (perfect tracking: the newest setpoint, carried on to `utime`), then
  // judges and traces. To be called every kTick_us. Before the start of the world only `settle` is called.
  void tick(double t_s, std::int64_t utime);
  // Moves the robots without judging: the time before the start.
  void settle(std::int64_t utime);

  // What robot `index` knows at world time `t_s`: itself, the obstacles within its sensing radius, its goal. Before the
  // start (t_s < 0) the obstacles stand where they will be at 0.
  sogm_swarm::robot_state_t state_message(std::size_t index, std::int64_t utime);
  sogm_swarm::obstacles_t obstacles_message(std::size_t index, double t_s, std::int64_t utime);
  sogm_swarm::goal_t goal_message(std::size_t index, std::int64_t utime);

 private:
  struct Vehicle {
    explicit Vehicle(const HeaderSource& headers)
        : state_headers(headers), obstacle_headers(headers), goal_headers(headers) {}

    std::int64_t clock_offset_us = 0;
    MotionState state;
    double yaw_rad = 0.0;
    sogm_swarm::setpoint_t setpoint{};
    bool flying = false;           // a setpoint was received
    std::optional<Motion> motion;  // it is bound to
    HeaderSource state_headers, obstacle_headers, goal_headers;
  };

  const World& world_;
  Judge judge_;
  TraceWriter* trace_;
  std::vector<Vehicle> vehicles_;
  std::vector<MotionState> states_;  // of the vehicles, as the judge takes them
};

}  // namespace swarm
