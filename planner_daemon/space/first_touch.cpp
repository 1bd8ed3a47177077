#include "planner_daemon/space/first_touch.h"

#include <algorithm>
#include <cmath>

namespace swarm {
namespace {

constexpr Duration kTouchStep = 20ms;

}  // namespace

bool touches(const Sogm& sogm, int frame, const Eigen::Vector3d& place, double radius_m) {
  const GridGeometry& grid = sogm.geometry;
  const double radius = radius_m / grid.resolution_m;
  const Eigen::Vector3d at =  // in voxels from the window's first centre
      (place / grid.resolution_m - grid.origin.cast<double>()).array() - 0.5;
  const Eigen::Vector2i low = (at.head<2>().array() - radius).ceil().cast<int>().cwiseMax(0);
  const Eigen::Vector2i high =
      (at.head<2>().array() + radius).floor().cast<int>().cwiseMin(grid.size.head<2>().array() - 1);
  const int words = grid.words_per_column();
  std::uint64_t any = 0;
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      const std::uint64_t* column = sogm.column(frame, x, y);
      if (std::all_of(column, column + words, [](std::uint64_t word) { return word == 0; })) continue;
      const double high2 = radius * radius - (x - at.x()) * (x - at.x()) - (y - at.y()) * (y - at.y());
      if (high2 < 0.0) continue;
      for_each_word_of_run(at.z() - std::sqrt(high2), at.z() + std::sqrt(high2), grid.size.z(),
                           [&](int word, std::uint64_t bits) { any |= column[word] & bits; });
    }
  }
  return any != 0;
}

Utime first_touch(const Sogm& sogm, const Motion& motion, double radius_m, Utime from, Utime until) {
  for (Utime t = from; t <= until; t += kTouchStep) {
    if (touches(sogm, sogm.frame_at(t), motion.at(t).position, radius_m)) return t;
  }
  return kNever;
}

bool keeps_clear(const Motion& motion, const Sogm& sogm, const std::vector<Peer>& peers, double blocked_m, Utime from) {
  const Utime until = std::max(sogm.end_utime(), motion.end_utime());
  for (Utime t = from; t < until; t += kTouchStep) {
    const Eigen::Vector3d place = motion.at(t).position;
    const Eigen::Vector3d middle = sogm.geometry.center_of(sogm.geometry.voxel_of(place));  // free space is of voxels
    if (touches(sogm, sogm.frame_at(t), middle, blocked_m)) return false;
    for (const Peer& peer : peers) {
      if ((peer.motion.at(t).position - place).norm() < blocked_m + peer.radius_m) return false;
    }
  }
  return true;
}

}  // namespace swarm
