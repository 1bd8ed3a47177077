// Guidance around what stands still: lower bounds of the time to the goal that know walls, so that the search does not
// run into dead ends between the robot and its goal (the paper names the want of guidance as its weakness, section VI).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "map_daemon/sogm.h"

namespace swarm {

// The bits of those of `num_cells` cells of a column, the lowest with its bottom at `bottom_m`, that reach into (low_m,
// high_m).
void cells_between(double bottom_m, double cell_m, int num_cells, double low_m, double high_m,
                   std::vector<std::uint64_t>* bits);

class Guidance {
 public:
  // Breadth-first distances to `goal` over cells of two voxels' edge, 64 cells at a time; a cell is closed when all its
  // voxels are occupied in `standing` (frame 0: configuration space of what never moves) or lie outside [space_min,
  // space_max] (z only: sideways the flight space is open in practice). Beyond the window everything counts as open.
  // Returns false, and gives no guidance, when nothing stands still in the window.
  bool build(const Sogm& standing, const Eigen::Vector3d& goal, double space_min_z, double space_max_z);

  // Least ways to the goal from `n` cells of a column [steps of one cell], as the largest of the axes' ways: below 0 in
  // closed cells and where no way is known. Cells of a window like that of build() with the given corner (W [m]): a
  // little later it has moved with the robot. Moved by half a cell, the nearest cells are taken.
  void steps(const Eigen::Vector3d& corner, int x, int y, int n, std::int16_t* out) const;

 private:
  struct Cells {
    std::uint32_t word;  // of open_
    std::uint64_t bits;
  };
  std::size_t column(int x, int y) const { return static_cast<std::size_t>(x) * size_.y() + y; }
  int cell_of(int axis, double coordinate) const {  // -1 outside the window
    const double cell = (coordinate - corner_[axis]) * inverse_cell_;
    return cell >= 0.0 && cell < size_[axis] ? static_cast<int>(cell) : -1;
  }
  void open_space(const Sogm& standing, double space_min_z, double space_max_z);
  void seed(int x, int y, int w, std::uint64_t bits, const Eigen::Vector3d& goal);
  void reach(std::uint32_t word, std::uint64_t bits, int steps);
  void spread(const Cells& cells);

  double cell_m_ = 0.2, inverse_cell_ = 5.0;
  Eigen::Vector3d corner_ = Eigen::Vector3d::Zero();  // of the window, W [m]
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();    // cells
  int words_ = 0;                                     // of 64 cells per column
  std::vector<std::uint64_t> space_;                  // cells of one column inside the flight space
  std::vector<std::uint64_t> open_;                   // cells not reached yet
  std::vector<std::uint64_t> pending_;                // cells that the next step reaches
  std::vector<std::uint32_t> next_;                   // words with pending cells
  std::vector<Cells> front_;                          // reached in this step
  std::vector<std::vector<Cells>> seeds_;             // by steps
  std::vector<std::int16_t> steps_;                   // Chebyshev steps of one cell to the goal; -1 closed
};

}  // namespace swarm
