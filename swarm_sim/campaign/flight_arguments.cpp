#include "swarm_sim/campaign/flight_arguments.h"

#include <algorithm>
#include <array>
#include <iostream>
#include <variant>

#include "lcmtypes/bus/text.h"

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

// Every option once.
template <class Arguments, class Visit>
void for_each_number(Arguments& arguments, const Visit& visit) {
  auto& link = arguments.link;
  visit("time-limit", arguments.time_limit_s, 0.1, 86400, "s", "of simulated time");
  visit("cells", arguments.cells_m, 0, 1000, "m",
        "robots fly in cells of the ground with edges of this, each with a keeper, as more than 60 must; 0: all know "
        "all");
  visit("link-delay-ms", link.delay_ms, 0, 10'000, "ms", "that messages between robots take longer");
  visit("link-jitter-ms", link.jitter_ms, 0, 10'000, "ms", "the delay is uniform within +- this, at least 0");
  visit("link-loss", link.loss, 0, 1, "", "share of the messages between robots that never arrives");
  visit("link-duplicate", link.duplicate, 0, 1, "", "share that arrives twice");
  visit("link-reorder", link.reorder, 0, 1, "", "share that is overtaken by later ones");
  visit("link-rate-mbps", link.rate_mbps, 0, 54, "Mbit/s",
        "lock-step: of the 802.11 channel that all robots share, in which they wait for each other and collide: 6, 9, "
        "12, 18, 24, 36, 48 or 54; 0: they do not");
  visit("clock-offset-ms", arguments.clock_offset_ms, 0, 10'000, "ms",
        "the clock of the robot with the lowest id is so much behind that of the highest; the others lie between");
}
template <class Arguments, class Visit>
void for_each_text(Arguments& arguments, const Visit& visit) {
  visit("link-outage", arguments.outages, "ROBOT:FROM_S:TO_S,...: robots that neither send nor receive for a time");
  visit("state-outage", arguments.state_outages, "ROBOT:FROM_S:TO_S,...: robots that are not told where they are");
  visit("strangers", arguments.strangers, "ROBOT,...: robots that are in nobody's roster, nor anybody in theirs");
  visit("kill", arguments.kills,
        "DAEMON:ROBOT@AT_S[-BACK_S],...: daemons (map, planner, broadcast, perception) that are killed, and started "
        "again 0.1 s later or at BACK_S; keeper@AT_S[-BACK_S]: that of the cells");
  visit("clock-step", arguments.clock_steps, "ROBOT:AT_S:BY_S,...: clocks that are set in flight, by so much");
  visit("map-config", arguments.map_config,
        "config file for every map_daemon; identity and map file come from the world");
  visit("planner-config", arguments.planner_config,
        "config file for every planner_daemon; identity, limits and space come from the world");
  visit("broadcast-config", arguments.broadcast_config,
        "config file for every broadcast_daemon; identity, limits and roster come from the world");
  visit("perception-config", arguments.perception_config,
        "config file for every perception_daemon; identity comes from the world");
}

// Of a vehicle or a sensor: numbers and words.
void declare_words(OptionSet& options, const char* name, std::string& value, std::span<const char* const> words,
                   const char* help) {
  options.add(name, &value, std::string(help) + ": " + listed(words), [words](const std::string& text) {
    if (std::ranges::find(words, text) == words.end()) throw OptionError("must be " + listed(words));
  });
}

// Visits every vehicle and sensor option.
template <class Arguments, class Visit>
void for_each_imperfection(Arguments& arguments, const Visit& visit) {
  for_each_vehicle_option(arguments.vehicle, visit);
  for_each_sensor_option(arguments.sensor, visit);
}

std::string to_text(double value) {
  return text_of(value);
}
std::string to_text(const std::string& value) {
  return value;
}

}  // namespace

void declare(OptionSet& options, FlightArguments& arguments) {
  for_each_number(arguments, [&](const char* name, double& value, double low, double high, const char* unit,
                                 const char* help) { options.add(name, &value, low, high, unit, help); });
  for_each_imperfection(arguments,
                        Overloaded{[&](const char* name, double& value, double low, double high, const char* unit,
                                       const char* help) { options.add(name, &value, low, high, unit, help); },
                                   [&](const char* name, std::string& value, std::span<const char* const> words,
                                       const char* help) { declare_words(options, name, value, words, help); },
                                   [&](const char* name, std::string& value, void (*check)(const std::string&),
                                       const char* help) { options.add(name, &value, help, check); }});
  for_each_text(arguments, [&](const char* name, std::string& value, const char* help) {
    options.add(name, &value, help, [&value, &arguments](const std::string& text) {
      if (&value == &arguments.outages || &value == &arguments.state_outages) (void)parse_outages(text);
      if (&value == &arguments.strangers) (void)parse_robots(text);
      if (&value == &arguments.kills) (void)parse_kills(text);
      if (&value == &arguments.clock_steps) (void)parse_clock_steps(text);
    });
  });
}

FlightOptions flight_options(const FlightArguments& arguments) {
  constexpr std::array<double, 9> kRates_mbps = {0, 6, 9, 12, 18, 24, 36, 48, 54};  // of OFDM in 20 MHz
  if (std::ranges::find(kRates_mbps, arguments.link.rate_mbps) == kRates_mbps.end())
    throw OptionError("link-rate-mbps " + text_of(arguments.link.rate_mbps) +
                      ": must be 6, 9, 12, 18, 24, 36, 48 or 54 Mbit/s, or 0");
  FlightOptions options;
  options.time_limit_s = arguments.time_limit_s;
  overlay(arguments.map_config, &options.map);
  overlay(arguments.planner_config, &options.planner);
  overlay(arguments.broadcast_config, &options.broadcast);
  overlay(arguments.perception_config, &options.perception);
  options.cells_m = arguments.cells_m;
  options.link = arguments.link;
  options.clock_offset_ms = arguments.clock_offset_ms;
  options.link.outages = parse_outages(arguments.outages);
  options.kills = parse_kills(arguments.kills);
  options.state_outages = parse_outages(arguments.state_outages);
  options.strangers = parse_robots(arguments.strangers);
  options.clock_steps = parse_clock_steps(arguments.clock_steps);
  return options;
}

World flown_world(World world, const FlightArguments& arguments) {
  const FlightArguments usual_arguments;
  std::vector<std::variant<double, std::string>> given, usual;
  const auto collect = [](auto* values) {
    return [values](const char*, const auto& value, const auto&...) { values->emplace_back(value); };
  };
  for_each_imperfection(arguments, collect(&given));
  for_each_imperfection(usual_arguments, collect(&usual));
  std::size_t i = 0;
  for_each_imperfection(world, [&]<class Value>(const char*, Value& value, const auto&...) {
    if (given[i] != usual[i]) value = std::get<Value>(given[i]);
    ++i;
  });
  return world;
}

NamedValues option_values(const FlightArguments& arguments) {
  NamedValues values;
  for_each_number(arguments, [&](const char* name, double value, double, double, const char*, const char*) {
    values.emplace_back(name, text_of(value));
  });
  for_each_imperfection(arguments, [&](const char* name, const auto& value, const auto&...) {
    values.emplace_back(name, to_text(value));
  });
  for_each_text(arguments,
                [&](const char* name, const std::string& value, const char*) { values.emplace_back(name, value); });
  return values;
}

std::string command_line(const FlightArguments& arguments) {
  return given_options(option_values(arguments), option_values({}));
}

}  // namespace swarm
