// The static heuristic by a plain search: its oracle, and a part of that of the space-time heuristic.
#pragma once

#include <algorithm>

#include "planner_daemon/search/static_heuristic.h"
#include "tests/support/plain_ways.h"
#include "tests/support/random_map.h"

namespace swarm {

class PlainStaticHeuristic {
 public:
  PlainStaticHeuristic(const Sogm& standing, double blocked_m, const Eigen::Vector3d& goal, double low_z, double high_z,
                       const Guidance* guidance)
      : grid(standing.geometry), cells(cells_in(grid)), ways(grid.size), too_close(ways.open) {
    const double reach = blocked_m / grid.resolution_m;
    ways.for_each_voxel([&](const Eigen::Vector3i& v) {
      const double bottom = (v.z() + grid.origin.z()) * grid.resolution_m;
      ways.open[ways.index(v)] = bottom + grid.resolution_m >= low_z && bottom <= high_z;
    });
    const int most = static_cast<int>(reach) + 1;
    ways.for_each_voxel([&](const Eigen::Vector3i& v) {
      if (!standing.occupied(0, v)) return;
      for (int k = 0; k < (2 * most + 1) * (2 * most + 1) * (2 * most + 1); ++k) {
        const int side = 2 * most + 1;
        const Eigen::Vector3i offset = Eigen::Vector3i(k % side, k / side % side, k / side / side).array() - most;
        if (offset.squaredNorm() <= reach * reach + 1e-6 && ways.contains(v + offset)) {
          ways.open[ways.index(v + offset)] = false;
          too_close[ways.index(v + offset)] = true;
          nothing_stands = false;
        }
      }
    });
    goal_voxel = grid.voxel_of(goal);
    ways.seed_goal(goal_voxel, Guidance::kBeside_m / grid.resolution_m);
    ways.seed_edge([&](const Eigen::Vector3i& v) {
      if (guidance == nullptr || guidance->empty()) return Wavefront::straight_cost(v - goal_voxel);
      const int cost = guidance->cost(v + grid.origin);
      const auto is_inside = [&](const Eigen::Vector3i& at) {
        return at.x() > 0 && at.y() > 0 && at.x() < grid.size.x() - 1 && at.y() < grid.size.y() - 1;
      };
      if (!is_inside(v) || cost == Wavefront::kUnreached) return cost;
      // Above and below: where the guided way goes on two voxels beside, it is found from there; else a little late.
      for (const auto& [dx, dy] : {std::pair{2, 0}, {-2, 0}, {0, 2}, {0, -2}, {2, 2}, {2, -2}, {-2, 2}, {-2, -2}}) {
        const Eigen::Vector3i next = v + Eigen::Vector3i(dx, dy, 0);
        const int step = dx != 0 && dy != 0 ? 2 * Wavefront::kStraight + 2 : 2 * Wavefront::kStraight;
        if (ways.contains(next) && guidance->cost(next + grid.origin) <= cost - step) return int{PlainWays::kNone};
      }
      return cost + 2 * Wavefront::kStraight;
    });
    ways.search();
  }

  int cost(const Eigen::Vector3i& cell) const { return ways.cell_cost(cell, kCellVoxels); }
  bool is_cut_off() const { return cost(cells / 2) == PlainWays::kNone; }

  bool is_too_close(const Eigen::Vector3i& v) const { return ways.contains(v) && too_close[ways.index(v)]; }

  // To a cell of a window that begins at `origin`: the least of the cells that it overlaps.
  int ticks(const Eigen::Vector3i& origin, const Eigen::Vector3i& cell, int per_cell, int far) const {
    const Eigen::Vector3i first = origin - grid.origin + kCellVoxels * cell;  // its voxels
    int least = far;
    for (int k = 0; k < 27; ++k) {
      const Eigen::Vector3i v = first + Eigen::Vector3i(k % 3, k / 3 % 3, k / 9);
      if ((v.array() < 0).any() || (v.array() >= kCellVoxels * cells.array()).any()) continue;
      const int found = cost(v / kCellVoxels);
      if (found != PlainWays::kNone) least = std::min(least, found * per_cell / (kCellVoxels * Wavefront::kStraight));
    }
    return least;
  }

  GridGeometry grid;
  Eigen::Vector3i cells;  // along each axis
  Eigen::Vector3i goal_voxel = Eigen::Vector3i::Zero();
  PlainWays ways;
  std::vector<bool> too_close;  // to what stands still
  bool nothing_stands = true;
};

}  // namespace swarm
