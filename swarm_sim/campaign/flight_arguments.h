// The options that decide how a world is flown, shared by `swarm_sim run` and `swarm_sim campaign`.
#pragma once

#include <string>

#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/text.h"
#include "swarm_sim/hosts/flight_options.h"
#include "swarm_sim/world/imperfections.h"

namespace swarm {

struct FlightArguments {
  double time_limit_s = 60.0;
  VehicleOptions vehicle;  // what differs from the usual goes before what the world says
  SensorOptions sensor;
  std::string map_config, planner_config, broadcast_config, perception_config;  // files; empty: defaults
  double cells_m = 0.0;                                                         // as in FlightOptions
  LinkOptions link;                                                             // without its outages
  double clock_offset_ms = 0.0;
  std::string outages, state_outages;  // as parse_outages() takes them
  std::string strangers;               // as parse_robots() takes them
  std::string kills;                   // as parse_kills() takes them
  std::string clock_steps;             // as parse_clock_steps() takes them
};

void declare(OptionSet& options, FlightArguments& arguments);

// Reads the config files. Throws OptionError.
FlightOptions flight_options(const FlightArguments& arguments);

// The world as it is flown: with the vehicles and sensors of the arguments.
World flown_world(World world, const FlightArguments& arguments);

// Name and value of every option, in a fixed order.
NamedValues option_values(const FlightArguments& arguments);

// What differs from the defaults, as it is given on the command line: " --time-limit 30", or "".
std::string command_line(const FlightArguments& arguments);

}  // namespace swarm
