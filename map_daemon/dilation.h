// Exact Euclidean dilation of bit grids: the configuration space of a spherical robot (paper section IV-A, where it is
// avoided as too slow). 64 voxels per instruction and more: spread along z by shifts, then OR whole frames shifted by
// each (x, y) offset of the ball.
#pragma once

#include <cstdint>
#include <vector>

#include "map_daemon/partial_sogm.h"

namespace swarm {

// Keeps its workspace and its result, so that repeated dilations of equally large grids allocate nothing.
class Dilator {
 public:
  // A voxel of the result is set when an occupied voxel of the same frame lies within `radius_m` (<=) of it, centre to
  // centre. Offset d (in voxels) counts as within the radius when |d|^2 <= (radius / resolution)^2 + 1e-9, so that a
  // radius of 0.3 m at 0.1 m reaches three voxels whatever the rounding of 0.3 / 0.1. Nothing outside the window is
  // taken to be occupied. With a `reach`, only columns that it comes to while the frame is in force or up to `linger_s`
  // later; the others are clear. Throws std::invalid_argument when the radius is negative or not finite. The result is
  // valid until the next call, like map().
  const Sogm& dilate(const Sogm& in, double radius_m, const Reach* reach = nullptr, double linger_s = 0.0);

  const Sogm& map() const { return out_.map(); }

 private:
  // Half-width along z [voxels] of the ball at offset (i, j); -1 outside the ball.
  int half_width(int i, int j) const {
    return half_widths_[static_cast<std::size_t>(std::abs(i) * (reach_y_ + 1) + std::abs(j))];
  }
  // Words `w` of the columns at work and those around them that the ball reaches, row after row along x, spread along z
  // by `h`. w = -1 and w = words_per_column are zeros.
  std::uint64_t* plane(int h, int w) {
    return planes_.data() + (static_cast<std::size_t>(h) * (words_ + 2) + w + 1) * plane_size_;
  }
  void shape_ball(const GridGeometry& geometry, double radius_m);
  void slice_ball(int w);
  bool load(const Sogm& in, int frame, const Columns& columns);  // false: nothing there
  void dilate_columns(const Sogm& in, int frame, const Columns& columns);

  PartialSogm out_;
  int reach_x_ = 0, reach_y_ = 0, reach_z_ = 0;  // extent of the ball, at most the window's
  int words_ = 0;                                // per column
  std::vector<int> half_widths_;
  std::size_t row_ = 0, plane_size_ = 0;  // words
  std::vector<std::uint64_t> planes_, covered_, sum_;
  std::vector<const std::uint64_t*> slices_;  // by offset along x: the plane of what the ball's slice covers
  std::vector<const std::uint64_t*> sources_;
};

void dilate(const Sogm& in, double radius_m, Sogm* out);

}  // namespace swarm
