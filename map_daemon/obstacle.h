// Obstacle shapes: exact distance (for judging) and rasterisation (for the SOGM) from one description.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "map_daemon/sogm.h"

namespace swarm {

// Upright or turned by yaw about W z; centred at the obstacle's position.
struct Shape {
  enum class Kind : std::uint8_t { kColumn, kRing, kBox, kSphere, kVoxels };
  Kind kind = Kind::kColumn;
  // column: (diameter, height, -), a vertical solid cylinder; ring: (major radius, tube diameter, -), a torus whose
  // axis is horizontal along yaw; box: (length along yaw, width, height); sphere: (diameter, -, -); voxels: (voxel
  // edge, -, -) [m].
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
  double yaw_rad = 0.0;
  std::vector<Eigen::Vector3i> voxels = {};  // kVoxels only: cubes centred at size.x() * index, axes of W
};

// Euclidean distance from a point to the solid [m]; 0 inside. `offset` is the point minus the shape's centre, W [m].
double distance(const Shape& shape, const Eigen::Vector3d& offset);

// The shape made so thick, where it is thinner, that with `margin_m` around it holds the centre of every voxel that the
// axis of the given shape passes (a sphere's centre, a box's middle). Thick shapes stay as they are, and so do voxels.
Shape thickened(const Shape& shape, double resolution_m, double margin_m);

// A tracked obstacle with a constant-velocity prediction.
struct Obstacle {
  Shape shape;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // of the centre at `utime`, W [m]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // W [m/s]
  Utime utime{};                                       // of position (age already subtracted)
  double acceleration_mps2 = 0.0;                      // it may accelerate by so much, in any direction
};

inline constexpr double kUnseen_s = 0.5;  // what an obstacle does later is seen in time to plan anew

// Marks in every frame of `sogm` each voxel whose centre comes within `margin_m` of the thickened obstacle at some time
// of the frame's interval (union over the interval, paper section III-B); voxels finer than the map's are thickened to
// one of those. So no obstacle slips through between the centres, however thin. Static obstacles (zero velocity) work
// too. `growth_mps` widens the margin with prediction time (per second after sogm.start_utime); so does half of the
// obstacle's acceleration times the square of the time since its utime, but no longer than for kUnseen_s.
void rasterize(const Obstacle& obstacle, double margin_m, double growth_mps, Sogm* sogm);

}  // namespace swarm
