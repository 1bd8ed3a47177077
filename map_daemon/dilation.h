// Exact Euclidean dilation of bit grids: the configuration space of a spherical robot (paper section IV-A, where it is
// avoided as too slow). 64 voxels per instruction and more: columns are ORed level by level, from those offsets on
// where the ball is highest, and what there is so far spreads along z by a shift before each further level.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "map_daemon/sogm.h"

namespace swarm {

// Occupied voxels of a box of columns: the words of its rows along x lie `row` words apart, from `words` on.
struct Layer {
  Columns columns;
  const std::uint64_t* words = nullptr;
  std::size_t row = 0;
};
Layer layer_of(const Sogm& sogm, int frame);

// Keeps its workspace, so that repeated dilations of equally large boxes allocate nothing.
class Dilator {
 public:
  // A voxel of the result is set when an occupied voxel lies within `radius_m` (<=) of it, centre to centre. Offset d
  // (in voxels) counts as within the radius when |d|^2 <= (radius / resolution)^2 + 1e-9, so that a radius of 0.3 m at
  // 0.1 m reaches three voxels whatever the rounding of 0.3 / 0.1. Nothing outside the window is taken to be occupied.
  // Throws std::invalid_argument when the radius is negative or not finite.
  void set(const GridGeometry& geometry, double radius_m);

  // How many columns the ball reaches to each side.
  int radius_voxels() const { return std::max(radius_x_, radius_y_); }

  // The union of the layers, dilated, in these columns (not none): all their words are set, from `out` on, rows along x
  // `out_row` words apart. The layers hold no bits outside the window.
  void dilate(std::span<const Layer> layers, const Columns& columns, std::uint64_t* out, std::size_t out_row);

  // The same, but only column stride i + stride / 2 for each i of `cells` (not none), and likewise along y; all of them
  // inside the window.
  void sample(std::span<const Layer> layers, int stride, const Columns& cells, std::uint64_t* out, std::size_t out_row);

  // A whole map; keeps the allocation of `out` when it suffices.
  void dilate(const Sogm& in, double radius_m, Sogm* out);

 private:
  // Words `w` of the columns at work and those around them that the ball reaches, row after row along x.
  std::uint64_t* plane(int w) { return planes_.data() + static_cast<std::size_t>(w) * plane_size_; }
  void shape_ball();
  const std::uint64_t* in_place(std::span<const Layer> layers, const Columns& columns) const;
  bool gather(std::span<const Layer> layers, const Columns& columns);  // false: nothing there
  // What the ball covers of the columns from `in` on, `width` of them in each of `num_rows` rows along x, `pitch` words
  // apart there and `out_pitch` in `out`.
  void cover(const std::uint64_t* in, std::size_t pitch, std::size_t num_rows, std::size_t width, std::uint64_t* out,
             std::size_t out_pitch);

  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();  // of the window
  double squared_ = -1.0;                           // of the radius [voxels^2], rounded down
  int radius_x_ = 0, radius_y_ = 0, radius_z_ = 0;  // extent of the ball, at most the window's
  int words_ = 0;                                   // per column
  std::size_t row_ = 0, plane_size_ = 0;            // words
  struct Source {
    std::size_t rows;  // the union of those up to so many away along x ...
    int shift;         // ... shifted along y
  };
  using Level = std::vector<Source>;  // of the ball's half-widths along z
  std::vector<Level> levels_;         // from the widest on
  std::vector<std::size_t> level_sizes_;
  std::vector<std::uint64_t> planes_, unions_, sums_, covered_;
  std::vector<const std::uint64_t*> sources_;
};

void dilate(const Sogm& in, double radius_m, Sogm* out);

}  // namespace swarm
