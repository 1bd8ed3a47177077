// Where rays end: exactly, on everything that a world holds.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "swarm_sim/world/occupied_cubes.h"
#include "swarm_sim/world/world.h"

namespace swarm {

class RayCaster {
 public:
  struct Ball {
    Eigen::Vector3d center;  // W [m]
    double radius_m;
  };

  // Both must outlive it; `static_map` may be null. Walls of a world are seen by its static map.
  RayCaster(const World& world, const OccupiedCubes* static_map) : world_(world), static_map_(static_map) {}

  // Rays start at `from` now, at world time `t_s`, and are as long as `range_m`. `balls`: the robots.
  void look(double t_s, const Eigen::Vector3d& from, double range_m, const std::vector<Ball>& balls);

  // How far the ray in `direction` (of length 1) gets, or the range; 0 from within something.
  double cast(const Eigen::Vector3d& direction) const;

 private:
  struct Solid {
    Shape shape;
    Eigen::Vector3d center;  // from where rays start
    double reach_m;          // the solid is within so much of its centre
  };

  const World& world_;
  const OccupiedCubes* static_map_;
  Eigen::Vector3d from_ = Eigen::Vector3d::Zero();
  double range_m_ = 0.0;
  std::vector<Solid> solids_;
};

// Of a ray from the origin in `direction` (of length 1): how far it gets before it meets the shape at `center`, at most
// `range_m`. Not for voxels.
double ray_length(const Shape& shape, const Eigen::Vector3d& center, const Eigen::Vector3d& direction, double range_m);

}  // namespace swarm
