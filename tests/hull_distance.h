// Exact distance to the convex hull of a piece's control points, by enumeration.
#pragma once

#include <Eigen/Core>
#include <Eigen/QR>
#include <algorithm>
#include <bit>
#include <cmath>

#include "planner_daemon/trajectory.h"

namespace swarm {

// By Caratheodory the nearest point is a combination of at most four of them, and the nearest on their affine hull.
inline double distance_to_hull(const ControlPoints& points, const Eigen::Vector3d& from) {
  double least = INFINITY;
  for (unsigned subset = 1; subset < 64; ++subset) {
    const int count = std::popcount(subset);
    if (count > 4) continue;
    Eigen::MatrixXd chosen(3, count);
    for (int k = 0, column = 0; k < 6; ++k) {
      if (subset >> k & 1) chosen.col(column++) = points.col(k) - from;
    }
    Eigen::MatrixXd system = Eigen::MatrixXd::Ones(count + 1, count + 1);
    system.topLeftCorner(count, count) = chosen.transpose() * chosen;
    system(count, count) = 0.0;
    const Eigen::VectorXd one = Eigen::VectorXd::Unit(count + 1, count);
    const Eigen::VectorXd weights = system.completeOrthogonalDecomposition().solve(one).head(count);
    if (weights.minCoeff() > -1e-12 && std::abs(weights.sum() - 1.0) < 1e-9) {
      least = std::min(least, (chosen * weights).norm());
    }
  }
  return least;
}

}  // namespace swarm
