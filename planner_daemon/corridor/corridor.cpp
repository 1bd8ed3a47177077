#include "planner_daemon/corridor/corridor.h"

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

bool CorridorBuilder::extract_surface(const Occupancy& occupancy, double blocked_m, int first_frame, int last_frame,
                                      const Eigen::Vector3d& lower, const Eigen::Vector3d& upper,
                                      const Eigen::Vector3d& seed) {
  obstacles_.clear();
  const GridGeometry& grid = occupancy.sogm->geometry;
  const Eigen::Vector3i low = grid.voxel_of(lower).cwiseMax(0);
  const Eigen::Vector3i high = grid.voxel_of(upper).cwiseMin(grid.size - Eigen::Vector3i::Ones());
  if ((low.array() > high.array()).any()) return false;
  const Columns box{low.head<2>(), high.head<2>()};
  dilator_.set(grid, blocked_m);
  layers_.clear();
  for (int frame = first_frame; frame <= last_frame; ++frame)
    occupancy.append_layers(frame, box.grown(dilator_.radius_voxels(), grid), &layers_);
  const auto words = static_cast<std::size_t>(grid.words_per_column());
  const auto width = static_cast<std::size_t>(box.width()), depth = static_cast<std::size_t>(high.x() - low.x() + 1);
  const std::size_t row = (width + 2) * words;
  columns_.assign((depth + 2) * row, 0);
  dilator_.dilate(layers_, box, columns_.data() + row + words, row);
  // A voxel whose six neighbours are all occupied is hidden behind them. Neighbours outside the box count as free.
  for (std::size_t x = 0; x < depth; ++x) {
    for (std::size_t y = 0; y < width; ++y) {
      const std::uint64_t* here = columns_.data() + (x + 1) * row + (y + 1) * words;
      for (std::size_t w = 0; w < words; ++w, ++here) {
        if (*here == 0) continue;
        const std::uint64_t above = *here >> 1 | (w + 1 < words ? here[1] << 63 : 0);
        const std::uint64_t below = *here << 1 | (w > 0 ? *(here - 1) >> 63 : 0);
        const std::uint64_t hidden = above & below & *(here - row) & here[row] & *(here - words) & here[words];
        const int first_z = 64 * static_cast<int>(w);
        std::uint64_t bits = *here & ~hidden & ones_between(low.z() - first_z, high.z() - first_z);
        while (bits != 0) {
          const int first = std::countr_zero(bits), count = std::countr_one(bits >> first);
          const Eigen::Vector2i column = box.first + Eigen::Vector2i(static_cast<int>(x), static_cast<int>(y));
          obstacles_.push_back({grid.center_of({column.x(), column.y(), first_z + first}), count});
          bits &= ~ones_between(first, first + count - 1);
        }
      }
    }
  }
  const Eigen::Vector3i at = grid.voxel_of(seed);
  if ((at.array() < low.array()).any() || (at.array() > high.array()).any()) return false;
  const auto x = static_cast<std::size_t>(at.x() - low.x()), y = static_cast<std::size_t>(at.y() - low.y());
  const std::uint64_t* column = columns_.data() + (x + 1) * row + (y + 1) * words;
  return (column[at.z() / 64] >> (at.z() % 64) & 1) != 0;
}

FiriStatus CorridorBuilder::build(const ControlPoints& piece, const Occupancy& occupancy, double blocked_m,
                                  const Eigen::AlignedBox3d& space, Utime from, Utime to, Polytope* polytope) {
  const Eigen::Vector3d seed_min = piece.rowwise().minCoeff(), seed_max = piece.rowwise().maxCoeff();
  // A seed that leaves the space (the robot comes back from outside) widens the box.
  const Eigen::Vector3d lower =
      (seed_min.array() - options_.extent_m).matrix().cwiseMax(space.min()).cwiseMin(seed_min);
  const Eigen::Vector3d upper =
      (seed_max.array() + options_.extent_m).matrix().cwiseMin(space.max()).cwiseMax(seed_max);
  const Sogm& sogm = *occupancy.sogm;
  const bool is_inside =
      extract_surface(occupancy, blocked_m, sogm.frame_at(from), sogm.frame_at(to - 1us), lower, upper, piece.col(0));
  if (is_inside && occupancy.apart != nullptr) return FiriStatus::kSeedBlocked;
  FiriOptions firi;
  firi.spacing_m = sogm.geometry.resolution_m;
  firi.half_extent_m = 0.5 * sogm.geometry.resolution_m;
  firi.log_volume_gap = options_.log_volume_gap;
  return firi_.grow(piece, obstacles_, lower, upper, firi, polytope);
}

}  // namespace swarm
