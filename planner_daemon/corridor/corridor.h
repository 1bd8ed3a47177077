// Safe corridors (paper section IV-B): one polytope per trajectory piece, free of what the SOGM occupies while the
// piece is flown.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "planner_daemon/corridor/firi.h"
#include "planner_daemon/corridor/polytope.h"
#include "planner_daemon/space/occupancy.h"
#include "planner_daemon/trajectory/bezier.h"

namespace swarm {

struct CorridorOptions {
  double extent_m = 0.6;          // a polytope extends this far beyond its piece's control points
  double margin_m = 0.05;         // from its faces, of the trajectory
  double margin_to_path_m = 0.1;  // where no farther than the path of the search does: see Planner::optimize()
  double log_volume_gap = FiriOptions().log_volume_gap;  // see there
};

// Grows polytopes in configuration space: they bound the robot's centre and need no shrinking by its radius; search,
// corridor and check share one definition of free space.
class CorridorBuilder {
 public:
  explicit CorridorBuilder(const CorridorOptions& options) : options_(options) {}

  // Polytope around `piece`, flown during [from, to], that holds all its control points, within `space`. Obstacles are
  // the voxels within `blocked_m` of what is occupied. kSeedBlocked when the centre of one lies in the hull of the
  // control points; where something is kept clear of besides, also when it holds the first of these.
  [[nodiscard]] FiriStatus build(const ControlPoints& piece, const Occupancy& occupancy, double blocked_m,
                                 const Eigen::AlignedBox3d& space, Utime from, Utime to, Polytope* polytope);

  // Centres of the voxels of the newest build's obstacles, a voxel's edge apart: the surface of the union over its
  // frames.
  const std::vector<PointRun>& obstacles() const { return obstacles_; }

 private:
  // Whether `seed` is inside, where the surface does not tell.
  bool extract_surface(const Occupancy& occupancy, double blocked_m, int first_frame, int last_frame,
                       const Eigen::Vector3d& lower, const Eigen::Vector3d& upper, const Eigen::Vector3d& seed);

  CorridorOptions options_;
  Firi firi_;
  Dilator dilator_;
  std::vector<Layer> layers_;
  std::vector<std::uint64_t> columns_;  // blocked in some frame, over the box; a rim of clear columns around
  std::vector<PointRun> obstacles_;
};

}  // namespace swarm
