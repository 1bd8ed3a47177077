// What a run flies with, besides the world, in every mode.
//
// The room hosts/ makes flights: run_lockstep() puts the daemons' nodes and the environment's on the event queue of
// lockstep_host.h, run_processes() starts real daemons around an environment in real time. Between robots stands the
// link model, in the one on a simulated bus, in the other as a relay; in lock-step also a channel of the radio. Stands
// on environment/ and results/.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "map_daemon/map_node.h"
#include "map_daemon/perception/perception_node.h"
#include "planner_daemon/coordination/broadcast_node.h"
#include "planner_daemon/coordination/keeper_node.h"
#include "planner_daemon/planner_node.h"
#include "swarm_sim/hosts/faults.h"
#include "swarm_sim/hosts/link_model.h"
#include "swarm_sim/world/world.h"

namespace swarm {

// The daemons' configurations are those before identity, limits and space are filled in.
struct FlightOptions {
  double time_limit_s = 60.0;
  MapConfig map;
  PerceptionNodeConfig perception;
  PlannerNodeConfig planner;
  BroadcastConfig broadcast;
  std::filesystem::path kept_maps;  // where robots with range sensors read and write their maps; empty: they keep none
  double cells_m = 0.0;             // edge of the cells that robots fly in, with keepers; 0: by one roster
  LinkOptions link;                 // between robots
  double clock_offset_ms = 0.0;     // the lowest id's clock is so much behind the highest's; the others lie between
  std::vector<Kill> kills;
  std::vector<ClockStep> clock_steps;
  std::vector<Outage> state_outages;  // robots that are not told where they are
  std::vector<int> strangers;         // each has a roster of itself alone, and is in nobody else's
};

// The daemons' configurations for one robot of a world.
MapConfig map_config(const World& world, const WorldRobot& robot, const FlightOptions& options);
PlannerNodeConfig planner_config(const World& world, const WorldRobot& robot, const FlightOptions& options);
PerceptionNodeConfig perception_config(const World& world, const WorldRobot& robot, const FlightOptions& options);
BroadcastConfig broadcast_config(const World& world, const WorldRobot& robot, const FlightOptions& options);

// Keeps all cells of the world, and those that robots may touch beyond it.
KeeperConfig keeper_config(const World& world, const FlightOptions& options);

// Of a robot in the world's order, by its id. Throws OptionError, beginning with `option`, where there is none.
std::size_t index_of_robot(const World& world, int id, const char* option);

// Those of kDaemons that every robot of the world has.
std::span<const char* const> daemons_in(const World& world);

// Throws OptionError where the options name a robot, or a daemon, that the world has not, or where one roster is to
// hold too many robots.
void check_robots(const World& world, const FlightOptions& options);

}  // namespace swarm
