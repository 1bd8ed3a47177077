// The static heuristic by a plain search: its oracle, and a part of that of the space-time heuristic.
#pragma once

#include <algorithm>
#include <cmath>

#include "planner_daemon/search/static_heuristic.h"
#include "tests/support/plain_ways.h"
#include "tests/support/random_map.h"

namespace swarm {

class PlainStaticHeuristic {
 public:
  PlainStaticHeuristic(const Sogm& standing, double blocked_m, const Eigen::Vector3d& goal,
                       const Eigen::AlignedBox3d& space, const Guidance* guidance,
                       StaticHeuristic::Detail detail = StaticHeuristic::Detail::kCells)
      : grid(standing.geometry),
        edge(detail == StaticHeuristic::Detail::kCells && blocked_m >= StaticHeuristic::kThickEnough * grid.resolution_m
                 ? 2
                 : 1),
        first_cell(lattice_cell(grid.origin)),
        ways(lattice_cell(grid.origin + grid.size - Eigen::Vector3i::Ones()) - first_cell + Eigen::Vector3i::Ones()),
        voxels(grid.size) {
    const double reach = blocked_m / grid.resolution_m;
    const int most = static_cast<int>(reach) + 1;
    voxels.for_each_voxel([&](const Eigen::Vector3i& v) {
      if (!standing.occupied(0, v)) return;
      for (int k = 0; k < (2 * most + 1) * (2 * most + 1) * (2 * most + 1); ++k) {
        const int side = 2 * most + 1;
        const Eigen::Vector3i offset = Eigen::Vector3i(k % side, k / side % side, k / side / side).array() - most;
        if (offset.squaredNorm() > reach * reach + 1e-6 || !voxels.contains(v + offset)) continue;
        too_close[voxels.index(v + offset)] = true;
        nothing_stands = false;
      }
    });
    const auto is_in_flight_space = [&](const Eigen::Vector3i& v, int first_axis) {
      const Eigen::Vector3d low = (v + grid.origin).cast<double>() * grid.resolution_m;
      for (int axis = first_axis; axis < 3; ++axis) {
        if (low[axis] + grid.resolution_m < space.min()[axis] || low[axis] > space.max()[axis]) return false;
      }
      return true;
    };
    const auto is_reachable = [&](const Eigen::Vector3i& v) { return is_in_flight_space(v, 0) && !is_too_close(v); };
    voxels.for_each_voxel([&](const Eigen::Vector3i& v) {
      if (is_reachable(v)) ways.open[ways.index(cell_of(v))] = true;
    });
    goal_voxel = grid.voxel_of(goal);
    double nearest = Guidance::kBeside_m / grid.resolution_m + 1e-6;  // voxels
    voxels.for_each_voxel([&](const Eigen::Vector3i& v) {
      if (is_reachable(v)) nearest = std::min(nearest, (v - goal_voxel).cast<double>().norm());
    });
    voxels.for_each_voxel([&](const Eigen::Vector3i& v) {
      if (is_reachable(v) && (v - goal_voxel).cast<double>().norm() <= nearest + 1e-6)
        ways.seed(cell_of(v), Wavefront::straight_cost(v - goal_voxel) / edge);
    });
    const bool is_guided = guidance != nullptr && !guidance->empty();
    const auto cost_beyond = [&](const Eigen::Vector3i& cell) {
      if (!is_guided) return Wavefront::straight_cost(cell - cell_of(goal_voxel));
      const Eigen::Vector3i v = edge * (cell + first_cell);  // of the lattice: its first voxel; the last one as well
      const int cost = std::min(guidance->cost(v), guidance->cost(v + (edge - 1) * Eigen::Vector3i::Ones()));
      return cost == Wavefront::kUnreached ? cost : cost / edge;
    };
    ways.seed_edge([&](const Eigen::Vector3i& cell) {
      const int cost = cost_beyond(cell);
      const bool is_side =
          cell.x() == 0 || cell.y() == 0 || cell.x() == ways.size.x() - 1 || cell.y() == ways.size.y() - 1;
      if (is_side || cost == Wavefront::kUnreached) return cost;
      if (!is_in_flight_space({0, 0, cell.z() == 0 ? 0 : grid.size.z() - 1}, 2)) return int{PlainWays::kNone};
      if (!is_guided) return cost;
      // Above and below: where the guided way goes on two voxels beside, it is found from there; else a little late.
      const int stride = 2 / edge;
      for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1}}) {
        const Eigen::Vector3i next = cell + stride * Eigen::Vector3i(dx, dy, 0);
        if (ways.contains(next) && cost_beyond(next) <= cost - stride * PlainWays::step_cost(dx, dy))
          return int{PlainWays::kNone};
      }
      return cost + stride * Wavefront::kStraight;
    });
    ways.search();
  }

  // Cells of ways begin at even voxels of the lattice.
  Eigen::Vector3i lattice_cell(const Eigen::Vector3i& voxel) const {
    return (voxel.cast<double>() / edge).array().floor().matrix().cast<int>();
  }
  Eigen::Vector3i cell_of(const Eigen::Vector3i& v) const { return lattice_cell(v + grid.origin) - first_cell; }
  // Of a cell of ways, as of voxels.
  int cost(const Eigen::Vector3i& cell) const {
    return ways.contains(cell) ? std::min<int>(PlainWays::kNone, edge * ways.cost(cell)) : PlainWays::kNone;
  }
  // Of the cell of a voxel, or of the nearest one beside it that is reached.
  int cost_from(const Eigen::Vector3d& place) const {
    const Eigen::Vector3d at = place / (edge * grid.resolution_m) - first_cell.cast<double>();
    const Eigen::Vector3i cell = at.array().floor().matrix().cast<int>();
    if (!ways.contains(cell) || cost(cell) != PlainWays::kNone) return cost(cell);
    int found = PlainWays::kNone;
    double least = 1e9;
    ways.for_each_voxel([&](const Eigen::Vector3i& other) {
      const double away = ((other.cast<double>().array() + 0.5).matrix() - at).norm();
      if ((other - cell).cwiseAbs().maxCoeff() > 1 || away >= least || cost(other) == PlainWays::kNone) return;
      least = away;
      found = cost(other);
    });
    return found;
  }
  bool is_cut_off() const {
    const Eigen::Vector3i middle = first_cell + cell_of(grid.size / 2);
    return cost_from((middle.cast<double>().array() + 0.5).matrix() * edge * grid.resolution_m) == PlainWays::kNone;
  }

  bool is_too_close(const Eigen::Vector3i& v) const { return voxels.contains(v) && too_close[voxels.index(v)]; }

  // To a cell of a window that begins at `origin`: the least of the cells that it overlaps.
  int ticks(const Eigen::Vector3i& origin, const Eigen::Vector3i& cell, int per_cell, int far) const {
    const Eigen::Vector3i first = origin - grid.origin + kCellVoxels * cell;  // its voxels
    int least = far;
    for (int k = 0; k < 27; ++k) {
      const Eigen::Vector3i v = first + Eigen::Vector3i(k % 3, k / 3 % 3, k / 9);
      const int found = cost(cell_of(v));
      if (found != PlainWays::kNone) least = std::min(least, found * per_cell / (kCellVoxels * Wavefront::kStraight));
    }
    return least;
  }

  GridGeometry grid;
  int edge;  // voxels of a cell of ways
  Eigen::Vector3i first_cell;
  Eigen::Vector3i goal_voxel = Eigen::Vector3i::Zero();
  PlainWays ways;                             // through cells
  PlainWays voxels;                           // of the window
  std::vector<bool> too_close = voxels.open;  // to what stands still
  bool nothing_stands = true;
};

}  // namespace swarm
