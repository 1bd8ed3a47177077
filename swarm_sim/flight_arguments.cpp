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
  LinkOptions& link = arguments.link;
  options.add("link-delay-ms", &link.delay_ms, 0, 10'000, "ms", "that messages between robots take longer");
  options.add("link-jitter-ms", &link.jitter_ms, 0, 10'000, "ms", "the delay is uniform within +- this, at least 0");
  options.add("link-loss", &link.loss, 0, 1, "", "share of the messages between robots that never arrives");
  options.add("link-duplicate", &link.duplicate, 0, 1, "", "share that arrives twice");
  options.add("link-reorder", &link.reorder, 0, 1, "", "share that is overtaken by later ones");
  options.add("link-outage", &arguments.outages,
              "ROBOT:FROM_S:TO_S,...: robots that neither send nor receive for a time",
              [](const std::string& text) { (void)parse_outages(text); });
}

FlightOptions flight_options(const FlightArguments& arguments) {
  FlightOptions options;
  options.time_limit_s = arguments.time_limit_s;
  options.sensor_rate_hz = arguments.sensor_rate_hz;
  overlay(arguments.map_config, &options.map);
  overlay(arguments.planner_config, &options.planner);
  overlay(arguments.broadcast_config, &options.broadcast);
  options.link = arguments.link;
  options.link.outages = parse_outages(arguments.outages);
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
  const LinkOptions &link = arguments.link, &perfect = usual.link;
  add("link-delay-ms", text_of(link.delay_ms), text_of(perfect.delay_ms));
  add("link-jitter-ms", text_of(link.jitter_ms), text_of(perfect.jitter_ms));
  add("link-loss", text_of(link.loss), text_of(perfect.loss));
  add("link-duplicate", text_of(link.duplicate), text_of(perfect.duplicate));
  add("link-reorder", text_of(link.reorder), text_of(perfect.reorder));
  add("link-outage", arguments.outages, "");
  return line;
}

}  // namespace swarm
