// Guidance around what stands still: lower bounds of the time to the goal that know walls, so that the search does not
// run into dead ends between the robot and its goal (the paper names the want of guidance as its weakness, section VI).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "map_daemon/sogm.h"

namespace swarm {

class Guidance {
 public:
  // Breadth-first distances to `goal` over cells of two voxels' edge; a cell is closed when all its voxels are
  // `blocked` in every frame or lie outside [space_min, space_max] (z only: sideways the flight space is open in
  // practice). Beyond the window everything counts as open. Returns false, and gives no guidance, when nothing stands
  // still in the window.
  bool build(const Sogm& blocked, const Eigen::Vector3d& goal, double space_min_z, double space_max_z);

  // Least time to the goal at `v_max` per axis [s] from a point, by the cell it is in; 0 outside the window and in
  // closed cells.
  double time_to_goal(const Eigen::Vector3d& position, double v_max) const;

 private:
  void close_standing_cells(const Sogm& blocked, double space_min_z, double space_max_z);
  std::size_t index(int x, int y, int z) const { return (static_cast<std::size_t>(x) * size_.y() + y) * size_.z() + z; }
  void seed(int x, int y, int z, const Eigen::Vector3d& goal);

  bool standing_ = false;
  double cell_m_ = 0.2;
  Eigen::Vector3d corner_ = Eigen::Vector3d::Zero();  // of the window, W [m]
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();    // cells
  std::vector<std::uint64_t> standing_words_;
  std::vector<std::int16_t> steps_;                  // Chebyshev steps of one cell to the goal; -1 unknown, -2 closed
  std::vector<std::vector<std::uint32_t>> buckets_;  // cells by steps
};

}  // namespace swarm
