#include "swarm_sim/flight_arguments.h"

#include <iostream>

#include "swarm_sim/text.h"

namespace swarm {
namespace {

// Overlays a daemon's config file, in the format its --print-config prints, on its defaults.
template <class Config>
void overlay(const std::string& file, Config* config) {
  if (file.empty()) return;
  OptionSet options("swarm_sim run", "");
  declare(options, *config);
  const char* arguments[] = {"run", "--config", file.c_str()};
  (void)options.parse(3, arguments, std::cout);
  verify(*config);
}

}  // namespace

void declare(OptionSet& options, FlightArguments& arguments) {
  options.add("time-limit", &arguments.time_limit_s, 0.1, 3600, "s", "of simulated time");
  options.add("sensor-rate", &arguments.sensor_rate_hz, 1, 100, "Hz", "of obstacle detections");
  options.add("map-config", &arguments.map_config,
              "config file for every map_daemon; identity and map file come from the world");
  options.add("planner-config", &arguments.planner_config,
              "config file for every planner_daemon; identity, limits and space come from the world");
  options.add("broadcast-config", &arguments.broadcast_config,
              "config file for every broadcast_daemon; identity, limits and roster come from the world");
}

FlightOptions flight_options(const FlightArguments& arguments) {
  FlightOptions options;
  options.time_limit_s = arguments.time_limit_s;
  options.sensor_rate_hz = arguments.sensor_rate_hz;
  overlay(arguments.map_config, &options.map);
  overlay(arguments.planner_config, &options.planner);
  overlay(arguments.broadcast_config, &options.broadcast);
  return options;
}

std::string command_line(const FlightArguments& arguments) {
  const FlightArguments usual;
  std::string line;
  const auto add = [&](const char* name, const std::string& value, const std::string& usual_value) {
    if (value != usual_value) line.append(" --").append(name).append(" ").append(value);
  };
  add("time-limit", text_of(arguments.time_limit_s), text_of(usual.time_limit_s));
  add("sensor-rate", text_of(arguments.sensor_rate_hz), text_of(usual.sensor_rate_hz));
  add("map-config", arguments.map_config, "");
  add("planner-config", arguments.planner_config, "");
  add("broadcast-config", arguments.broadcast_config, "");
  return line;
}

}  // namespace swarm
