// What benchmarks work on: planning requests as they come up in flight.
#pragma once

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

struct RecordedFlight {
  std::string name;
  PlannerConfig config;
  std::vector<std::unique_ptr<PlanInput>> inputs;
};

// Flies a world of the paper's kind in lock-step and keeps every `stride`-th request of its first robot until all have
// arrived. The same arguments give the same inputs.
RecordedFlight record_flight(const std::string& task, const std::string& environment, int obstacles, int seed,
                             int stride);

}  // namespace swarm
