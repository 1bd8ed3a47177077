// Exact Euclidean dilation of bit grids: the configuration space of a spherical robot (paper section IV-A, where it is
// avoided as too slow). 64 voxels per instruction: spread along z by shifts, then OR rows over the disc of (x, y)
// offsets.
#pragma once

#include <cstdint>
#include <vector>

#include "map_daemon/sogm.h"

namespace swarm {

// Keeps its workspace, so that repeated dilations of equally large grids allocate nothing.
class Dilator {
 public:
  // See dilate() in sogm.h. Offset d (in voxels) counts as within the radius when |d|^2 <= (radius / resolution)^2 +
  // 1e-9, so that a radius of 0.3 m at 0.1 m reaches three voxels whatever the rounding of 0.3 / 0.1. Throws
  // std::invalid_argument when the radius is negative or not finite.
  void dilate(const Sogm& in, double radius_m, Sogm* out, const Reach* reach = nullptr);

 private:
  // Half-width along z [voxels] of the ball at offset (dx, dy) = (i, j); -1 outside the ball.
  int half_width(int i, int j) const { return half_widths_[static_cast<std::size_t>(i * (reach_y_ + 1) + j)]; }
  // Words `w` of all columns of the row being dilated, spread along z by `h`; starts with reach_y_ zeros for y < 0.
  // w = -1 and w = words_per_column are rows of zeros.
  std::uint64_t* spread_row(int h, int w);
  void shape_ball(const GridGeometry& geometry, double radius_m);
  bool load_row(const std::uint64_t* row);  // into spread_row(0, *) and all others; false if the row is empty
  void dilate_frame(const Sogm& in, int frame, int first_x, int last_x, int first_y, int last_y, Sogm* out);

  int columns_ = 0, words_ = 0;                  // of the row: along y, and words per column
  int reach_x_ = 0, reach_y_ = 0, reach_z_ = 0;  // extent of the ball, at most the window's
  std::vector<int> half_widths_;
  std::vector<std::uint64_t> spread_;  // (reach_z_ + 1) x (words_ + 2) x (columns_ + 2 reach_y_)
  std::vector<std::uint64_t> disc_;    // columns_: one word row, ORed over y
};

}  // namespace swarm
