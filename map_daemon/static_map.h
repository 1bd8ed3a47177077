// The static layer of the SOGM: an OctoMap file turned once into a bit grid on the world lattice.
#pragma once

#include <octomap/OcTree.h>

#include <cmath>
#include <cstdint>
#include <string>

#include "map_daemon/sogm.h"

namespace swarm {

// Whether an occupied voxel of the first frame, the whole cube, comes closer than `radius_m` to `place` (W [m]).
bool cubes_meet(const Sogm& cubes, const Eigen::Vector3d& place, double radius_m);

class StaticMap {
 public:
  // Reads an OcTree file (.bt or .ot). A voxel of the lattice of edge `resolution_m` is occupied when its centre lies
  // within an occupied leaf widened by `margin_m` (max-norm). Unknown space counts as free: what was never seen at
  // mapping time is left to the live obstacles.
  // Throws std::runtime_error, one line that names the file, when it is missing, damaged, not an OcTree, or would need
  // more than kMaxBytes at this resolution.
  StaticMap() = default;  // an empty one
  StaticMap(const std::string& path, double resolution_m, double margin_m);
  // The same of a tree that was read from there.
  StaticMap(const octomap::OcTree& tree, const std::string& path, double resolution_m, double margin_m);

  // The voxel edge near the usual one of which leaves of that edge consist, or that consists of them: then no wall of
  // the map ends inside a voxel, and none of them grows.
  static double fitting_voxel_m(double leaf_m) {
    return leaf_m < kUsualVoxel_m ? leaf_m * std::round(kUsualVoxel_m / leaf_m)
                                  : leaf_m / std::round(leaf_m / kUsualVoxel_m);
  }
  static constexpr double kUsualVoxel_m = 0.1;

  static constexpr std::int64_t kMaxBytes = std::int64_t{1} << 27;  // half of what a daemon's service may take

  // Of the box around all that is occupied; empty if nothing is.
  const GridGeometry& geometry() const { return grid_.geometry; }
  // `voxel` is counted from geometry().origin.
  bool occupied(const Eigen::Vector3i& voxel) const { return grid_.occupied(0, voxel); }

  // Whether `place` (W [m]) lies in an occupied voxel.
  bool holds(const Eigen::Vector3d& place) const {
    const GridGeometry& grid = grid_.geometry;
    const Eigen::Vector3i voxel = grid.voxel_of(place);
    return grid.contains(voxel) && grid_.occupied(0, voxel);
  }

  // Whether an occupied voxel, the whole cube, comes closer than `radius_m` to `place` (W [m]). Of a map at the file's
  // own resolution and without a margin the cubes are those of the file.
  bool meets(const Eigen::Vector3d& place, double radius_m) const { return cubes_meet(grid_, place, radius_m); }

  // ORs what lies in the window into every frame. `sogm` must have the same resolution.
  void copy_into(Sogm* sogm) const { add_first_frame(grid_, sogm); }

 private:
  Sogm grid_;  // one frame
};

}  // namespace swarm
