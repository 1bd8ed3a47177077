// The clocks of a swarm's robots, which may differ.
#pragma once

#include <cstdint>
#include <vector>

#include "swarm_sim/world/world.h"

namespace swarm {

// By how much the clock of each of n robots is ahead of the world's, the lowest id's first [us]: that is `offset_ms`
// behind the highest's, the others lie between.
std::vector<std::int64_t> clock_offsets_us(double offset_ms, std::size_t n);

// The same in the order of the world's robots.
std::vector<std::int64_t> clock_offsets_us(double offset_ms, const World& world);

}  // namespace swarm
