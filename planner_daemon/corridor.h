// Safe corridors (paper section IV-B): one polytope per trajectory piece, free of what the SOGM occupies while the
// piece is flown.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "map_daemon/sogm.h"
#include "planner_daemon/firi.h"
#include "planner_daemon/polytope.h"
#include "planner_daemon/trajectory.h"

namespace swarm {

struct CorridorOptions {
  double reach_m = 1.2;  // a polytope reaches this far beyond its piece's control points
};

// Grows polytopes in configuration space: `blocked` is the dilated SOGM, so they bound the robot's centre and need no
// shrinking by its radius: search, corridor and check share one definition of free space.
class CorridorBuilder {
 public:
  CorridorBuilder(const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max, const CorridorOptions& options);

  // Polytope around `piece`, flown during [from, to], that holds all its control points. kSeedBlocked when an
  // occupied voxel's centre lies in their hull.
  [[nodiscard]] FiriStatus build(const ControlPoints& piece, const Sogm& blocked, std::int64_t from_utime,
                                 std::int64_t to_utime, Polytope* polytope);

  // Centres of the voxels of the newest build's obstacles, a voxel's edge apart: the surface of the union over its
  // frames.
  const std::vector<PointRun>& obstacles() const { return obstacles_; }

 private:
  void extract_surface(const Sogm& blocked, int first_frame, int last_frame, const Eigen::Vector3d& lower,
                       const Eigen::Vector3d& upper);

  Eigen::Vector3d space_min_, space_max_;
  CorridorOptions options_;
  Firi firi_;
  std::vector<std::uint64_t> columns_;  // union of the frames over the box
  std::vector<PointRun> obstacles_;
};

}  // namespace swarm
