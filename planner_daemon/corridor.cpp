#include "planner_daemon/corridor.h"

#include <algorithm>
#include <bit>

namespace swarm {
namespace {

// Bits [first, last] of a word, as far as there are such.
std::uint64_t ones_between(int first, int last) {
  first = std::max(first, 0);
  last = std::min(last, 63);
  return first > last ? 0 : ~std::uint64_t{0} >> (63 - (last - first)) << first;
}

}  // namespace

CorridorBuilder::CorridorBuilder(const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max,
                                 const CorridorOptions& options)
    : space_min_(space_min), space_max_(space_max), options_(options) {}

void CorridorBuilder::extract_surface(const Sogm& blocked, int first_frame, int last_frame,
                                      const Eigen::Vector3d& lower, const Eigen::Vector3d& upper) {
  obstacles_.clear();
  const GridGeometry& grid = blocked.geometry;
  const Eigen::Vector3i low = grid.voxel_of(lower).cwiseMax(0);
  const Eigen::Vector3i high = grid.voxel_of(upper).cwiseMin(grid.size - Eigen::Vector3i::Ones());
  if ((low.array() > high.array()).any()) return;
  const int words = grid.words_per_column(), width = high.y() - low.y() + 1, depth = high.x() - low.x() + 1;
  columns_.assign(static_cast<std::size_t>(width) * depth * words, 0);
  const auto column = [&](int x, int y) { return columns_.data() + (static_cast<std::size_t>(x) * width + y) * words; };
  for (int x = 0; x < depth; ++x) {
    for (int frame = first_frame; frame <= last_frame; ++frame) {
      const std::uint64_t* row = blocked.column(frame, low.x() + x, low.y());
      std::uint64_t* out = column(x, 0);
      for (int i = 0; i < width * words; ++i) out[i] |= row[i];
    }
  }
  // A voxel whose six neighbours are all occupied is hidden behind them. Neighbours outside the box count as free.
  for (int x = 0; x < depth; ++x) {
    for (int y = 0; y < width; ++y) {
      const std::uint64_t* here = column(x, y);
      for (int w = 0; w < words; ++w) {
        if (here[w] == 0) continue;
        const std::uint64_t above = here[w] >> 1 | (w + 1 < words ? here[w + 1] << 63 : 0);
        const std::uint64_t below = here[w] << 1 | (w > 0 ? here[w - 1] >> 63 : 0);
        std::uint64_t hidden = above & below;
        hidden &= x > 0 ? column(x - 1, y)[w] : 0;
        hidden &= x + 1 < depth ? column(x + 1, y)[w] : 0;
        hidden &= y > 0 ? column(x, y - 1)[w] : 0;
        hidden &= y + 1 < width ? column(x, y + 1)[w] : 0;
        std::uint64_t bits = here[w] & ~hidden & ones_between(low.z() - 64 * w, high.z() - 64 * w);
        while (bits != 0) {
          const int first = std::countr_zero(bits), count = std::countr_one(bits >> first);
          obstacles_.push_back({grid.center_of({low.x() + x, low.y() + y, 64 * w + first}), count});
          bits &= ~ones_between(first, first + count - 1);
        }
      }
    }
  }
}

FiriStatus CorridorBuilder::build(const ControlPoints& piece, const Sogm& blocked, std::int64_t from_utime,
                                  std::int64_t to_utime, Polytope* polytope) {
  const Eigen::Vector3d seed_min = piece.rowwise().minCoeff(), seed_max = piece.rowwise().maxCoeff();
  // A seed that leaves the flight space (the robot comes back from outside) widens the box.
  const Eigen::Vector3d lower = (seed_min.array() - options_.reach_m).matrix().cwiseMax(space_min_).cwiseMin(seed_min);
  const Eigen::Vector3d upper = (seed_max.array() + options_.reach_m).matrix().cwiseMin(space_max_).cwiseMax(seed_max);
  extract_surface(blocked, blocked.frame_at(from_utime), blocked.frame_at(to_utime - 1), lower, upper);
  FiriOptions firi;
  firi.spacing_m = blocked.geometry.resolution_m;
  firi.half_extent_m = 0.5 * blocked.geometry.resolution_m;
  return firi_.grow(piece, obstacles_, lower, upper, firi, polytope);
}

}  // namespace swarm
