#include "planner_daemon/space/first_touch.h"

#include <cmath>
#include <limits>

namespace swarm {
namespace {

constexpr std::int64_t kTouchStep_us = 20'000;

}  // namespace

std::int64_t first_touch(const Sogm& sogm, const Motion& motion, double radius_m, std::int64_t from_utime,
                         std::int64_t until_utime) {
  const GridGeometry& grid = sogm.geometry;
  const double radius = radius_m / grid.resolution_m;
  const auto touches = [&](const Eigen::Vector3d& position, int frame) {
    const Eigen::Vector3d at =  // in voxels from the window's first centre
        (position / grid.resolution_m - grid.origin.cast<double>()).array() - 0.5;
    const Eigen::Vector2i low = (at.head<2>().array() - radius).ceil().cast<int>().cwiseMax(0);
    const Eigen::Vector2i high =
        (at.head<2>().array() + radius).floor().cast<int>().cwiseMin(grid.size.head<2>().array() - 1);
    std::uint64_t any = 0;
    for (int x = low.x(); x <= high.x(); ++x) {
      for (int y = low.y(); y <= high.y(); ++y) {
        const double high2 = radius * radius - (x - at.x()) * (x - at.x()) - (y - at.y()) * (y - at.y());
        if (high2 < 0.0) continue;
        const std::uint64_t* column = sogm.column(frame, x, y);
        for_each_word_of_run(at.z() - std::sqrt(high2), at.z() + std::sqrt(high2), grid.size.z(),
                             [&](int word, std::uint64_t bits) { any |= column[word] & bits; });
      }
    }
    return any != 0;
  };
  for (std::int64_t t = from_utime; t <= until_utime; t += kTouchStep_us) {
    if (touches(motion.at(t).position, sogm.frame_at(t))) return t;
  }
  return std::numeric_limits<std::int64_t>::max();
}

}  // namespace swarm
