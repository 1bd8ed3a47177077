// What benchmarks work on: planning requests as they came up in flight.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "planner_daemon/planner_node.h"

namespace swarm {

// One request with the maps and peers that it refers to.
struct PlanInput {
  Sogm sogm;
  std::vector<Peer> peers;
  PlanRequest request;

  PlanInput() = default;
  PlanInput(const PlanInput&) = delete;  // the request refers to its own members
  PlanInput& operator=(const PlanInput&) = delete;
};

struct RecordedRequests {
  std::string name;
  PlannerConfig config;
  std::vector<std::unique_ptr<PlanInput>> inputs;
};

// The options of a planner_daemon from a config file; none: its defaults. Throws OptionError.
PlannerNodeConfig read_planner_config(const std::string& file);

// A planner that hears what the robot heard whose onboard bus the LCM log `log` holds makes the same plans: their
// requests, evenly chosen where there are more than `most`. Throws std::runtime_error with the log's name when it
// cannot be read or nothing was planned with it.
RecordedRequests read_requests(const std::filesystem::path& log, PlannerNodeConfig config, std::size_t most);

// Writes sets of requests to `directory` as logs that hold no more than them: 20_columns.lcm and 50_columns.lcm from
// flights among so many, stuck.lcm from plans whose searches used up their budget, and planner.cfg for all three. The
// same program writes the same sets.
void record_requests(const std::filesystem::path& directory);

}  // namespace swarm
