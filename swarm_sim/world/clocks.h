// The clocks of a swarm's robots, which may differ.
#pragma once

#include <vector>

#include "lcmtypes/bus/time.h"
#include "swarm_sim/world/world.h"

namespace swarm {

// At this world time somebody sets a robot's clock, by so much.
struct ClockStep {
  int robot_id = 0;
  double at_s = 0.0;
  Duration by{};
};

// By how much the clock of each of n robots is ahead of the world's, the lowest id's first: that is `offset_ms`
// behind the highest's, the others lie between.
std::vector<Duration> clock_offsets(double offset_ms, std::size_t n);

// The same in the order of the world's robots.
std::vector<Duration> clock_offsets(double offset_ms, const World& world);

}  // namespace swarm
