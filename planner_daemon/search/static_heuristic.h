// The static heuristic: lower bounds of the time to the goal around what stands still, so that the search does not run
// into dead ends between the robot and its goal (the paper names the want of guidance as its weakness, section VI).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "planner_daemon/space/occupancy.h"

namespace swarm {

// Cells of the static and of the space-time heuristic: so many voxels along each edge, from the window's corner on. The
// middle voxel stands for the cell: it lies inside the window, and where it is blocked, the cell is closed.
inline constexpr int kCellVoxels = 3;
constexpr int middle_of(int cell) {
  return kCellVoxels * cell + kCellVoxels / 2;
}
inline Eigen::Vector3i cells_in(const GridGeometry& grid) {
  return (grid.size.array() + (kCellVoxels - 1 - kCellVoxels / 2)) / kCellVoxels;
}

// Cells [first, last] of a column; none when the first is above the last.
struct CellSpan {
  int first = 0, last = -1;
  bool holds(int cell) const { return cell >= first && cell <= last; }
};
// Those of `num_cells` cells, the lowest with its bottom at `bottom_m`, that overlap (low_m, high_m).
CellSpan cells_between(double bottom_m, double cell_m, int num_cells, double low_m, double high_m);

class StaticHeuristic {
 public:
  // Breadth-first distances to `goal`, 64 cells at a time, among what lies within `blocked_m` of what is occupied in
  // frame 0 of `standing`; a cell outside [space_min, space_max] is closed (z only: sideways the flight space is open
  // in practice). Beyond the window everything counts as open. Empty when nothing stands still in the window.
  void build(const Occupancy& standing, double blocked_m, const Eigen::Vector3d& goal, double space_min_z,
             double space_max_z);

  // It knows nothing that a straight way does not.
  bool empty() const { return empty_; }

  // Least ways to the goal [steps of one cell, at most 900], as the largest of the axes' ways: below 0 in closed cells
  // and where no way is known. Of cells (x, y, z) with y in `first_y` and the following num_y - 1, z in [0, num_z): to
  // `out`, columns `stride` apart. Cells of a window like that of build() with the given corner (W [m]): a little later
  // it has moved with the robot. Moved by a part of a cell, the nearest cells are taken.
  void steps(const Eigen::Vector3d& corner, int x, int first_y, int num_y, int num_z, std::size_t stride,
             std::int16_t* out) const;

 private:
  struct Cells {
    std::uint32_t word;  // of open_
    std::uint64_t bits;
  };
  std::size_t column(int x, int y) const { return static_cast<std::size_t>(Eigen::Index{x} * size_.y() + y); }
  std::size_t word(int x, int y, int w) const {
    return column(x, y) * static_cast<std::size_t>(words_) + static_cast<std::size_t>(w);
  }
  bool open_space(const Occupancy& standing, double blocked_m, const CellSpan& space);
  void seed(int x, int y, int w, std::uint64_t bits, const Eigen::Vector3d& goal);
  void settle(std::uint32_t word, std::uint64_t bits, int steps);
  void spread(const Cells& cells);

  bool empty_ = true;
  double cell_m_ = 0.3, inverse_cell_ = 1 / 0.3;
  Eigen::Vector3d corner_ = Eigen::Vector3d::Zero();  // of the window, W [m]
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();    // cells
  int words_ = 0;                                     // of 64 cells per column
  Dilator dilator_;
  std::vector<Layer> layers_;
  std::vector<std::uint64_t> closed_;      // columns of middle voxels
  std::vector<std::uint64_t> open_;        // cells not reached yet
  std::vector<std::uint64_t> pending_;     // cells that the next step reaches
  std::vector<std::uint32_t> next_;        // words with pending cells
  std::vector<Cells> front_;               // reached in this step
  std::vector<std::vector<Cells>> seeds_;  // by steps
  std::vector<std::int16_t> steps_;        // Chebyshev steps of one cell to the goal; -1 closed
};

}  // namespace swarm
