// Exact Euclidean dilation of bit grids: the configuration space of a spherical robot (paper section IV-A, where it is
// avoided as too slow). 64 voxels per instruction: spread along z by shifts, then OR rows over the disc of (x, y)
// offsets.
#pragma once

#include <cstdint>
#include <vector>

#include "map_daemon/sogm.h"

namespace swarm {

// Keeps its workspace and its result, so that repeated dilations of equally large grids allocate nothing and clear only
// what they had written.
class Dilator {
 public:
  // See dilate() in sogm.h. Offset d (in voxels) counts as within the radius when |d|^2 <= (radius / resolution)^2 +
  // 1e-9, so that a radius of 0.3 m at 0.1 m reaches three voxels whatever the rounding of 0.3 / 0.1. What was occupied
  // up to `frames_before` frames earlier counts as well. Throws std::invalid_argument when the radius is negative or
  // not finite. Valid until the next call, like map().
  const Sogm& dilate(const Sogm& in, double radius_m, const Reach* reach = nullptr, int frames_before = 0);

  const Sogm& map() const { return out_; }

 private:
  struct Columns {  // [first, last] along x and y, window indices; none when a first is above its last
    Eigen::Vector2i first = Eigen::Vector2i::Zero(), last = Eigen::Vector2i::Constant(-1);
  };
  // Half-width along z [voxels] of the ball at offset (dx, dy) = (i, j); -1 outside the ball.
  int half_width(int i, int j) const { return half_widths_[static_cast<std::size_t>(i * (reach_y_ + 1) + j)]; }
  // Words `w` of all columns of the row being dilated, spread along z by `h`; starts with reach_y_ zeros for y < 0.
  // w = -1 and w = words_per_column are rows of zeros.
  std::uint64_t* spread_row(int h, int w);
  void shape_ball(const GridGeometry& geometry, double radius_m);
  void clear(const Sogm& in);
  static Columns reached(const Sogm& in, int frame, const Reach& reach);
  // Row x from column `from_y` on into spread_row(0, *) and all others; false if it is empty.
  bool load_row(const Sogm& in, int frame, int frames_before, int x, int from_y);
  void dilate_frame(const Sogm& in, int frame, int frames_before, const Columns& columns);

  Sogm out_;
  std::vector<Columns> written_;                 // by frame
  int columns_ = 0, words_ = 0;                  // of the row: along y, and words per column
  int reach_x_ = 0, reach_y_ = 0, reach_z_ = 0;  // extent of the ball, at most the window's
  std::vector<int> half_widths_;
  std::vector<std::uint64_t> spread_;  // (reach_z_ + 1) x (words_ + 2) x (columns_ + 2 reach_y_)
  std::vector<std::uint64_t> disc_;    // columns_: one word row, ORed over y
};

}  // namespace swarm
