#include "swarm_sim/world/clocks.h"

#include <algorithm>
#include <cmath>

namespace swarm {

std::vector<Duration> clock_offsets(double offset_ms, std::size_t n) {
  std::vector<Duration> offsets(n);
  for (std::size_t i = 0; n > 1 && i < n; ++i)
    offsets[i] = Duration(std::llround(1e3 * offset_ms * (static_cast<double>(i) / static_cast<double>(n - 1) - 0.5)));
  return offsets;
}

std::vector<Duration> clock_offsets(double offset_ms, const World& world) {
  const std::vector<Duration> by_id = clock_offsets(offset_ms, world.robots.size());
  std::vector<Duration> offsets;
  for (const WorldRobot& robot : world.robots) {
    const auto place = std::ranges::count_if(world.robots, [&](const WorldRobot& r) { return r.id < robot.id; });
    offsets.push_back(by_id[static_cast<std::size_t>(place)]);
  }
  return offsets;
}

}  // namespace swarm
