#include "planner_daemon/optimize/acceleration_polytope.h"

#include <cmath>
#include <numbers>

#include "lcmtypes/bus/portable_math.h"

namespace swarm {

Polytope acceleration_polytope(const Eigen::Vector3d& axis_mps2, double slope, double gravity_mps2, int sides) {
  Polytope polytope;
  polytope.normals.resize(6 + sides, 3);
  polytope.offsets.resize(6 + sides);
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      polytope.normals.row(2 * axis + side) = (side == 0 ? 1.0 : -1.0) * Eigen::RowVector3d::Unit(axis);
      polytope.offsets(2 * axis + side) = axis_mps2[axis];
    }
  }
  const double length = std::sqrt(1.0 + slope * slope);
  for (int i = 0; i < sides; ++i) {
    const auto [sin, cos] = sin_cos(2.0 * std::numbers::pi * i / sides);
    polytope.normals.row(6 + i) = Eigen::RowVector3d(cos, sin, -slope) / length;
    polytope.offsets(6 + i) = slope * gravity_mps2 / length;
  }
  return polytope;
}

}  // namespace swarm
