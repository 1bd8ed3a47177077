// What a multicopter's acceleration may be, as a polytope for the optimisation.
#pragma once

#include "planner_daemon/corridor/polytope.h"

namespace swarm {

// Accelerations a [m/s^2] with |a_i| <= axis_mps2_i that need no more tilt than the sides of an upright pyramid,
// regular and of `sides` sides, whose apex is free fall: sideways at most `slope` times (gravity_mps2 + a_z) along each
// side's normal.
Polytope acceleration_polytope(const Eigen::Vector3d& axis_mps2, double slope, double gravity_mps2, int sides);

}  // namespace swarm
