// A motion from one place to another for tests.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "planner_daemon/trajectory/trajectory.h"

namespace swarm::test {

// From `from` at `start` to rest at `to`: one quintic, cut into pieces.
inline Trajectory quintic_to(const MotionState& from, Utime start, const Eigen::Vector3d& to, double seconds,
                             int pieces = 5, std::int32_t seq = 1) {
  const Duration piece = to_duration(seconds / pieces);
  MotionState rest;
  rest.position = to;
  const double duration_s = to_seconds(piece) * pieces;
  const ControlPoints points = quintic_control_points(from, rest, duration_s);
  Trajectory trajectory(seq, start, piece, pieces);
  for (int k = 0; k < pieces; ++k) {
    trajectory.set_knot(k, evaluate_bezier(points, duration_s, static_cast<double>(k) / pieces));
  }
  trajectory.set_knot(0, from);
  trajectory.set_knot(pieces, rest);
  return trajectory;
}

}  // namespace swarm::test
