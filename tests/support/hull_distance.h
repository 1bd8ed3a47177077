// Exact distance to the convex hull of a few points, by enumeration.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace swarm {

// Least over all their vertices, edges and triangles; zero in a tetrahedron.
inline double distance_to_hull(const Eigen::Matrix3Xd& points, const Eigen::Vector3d& p) {
  using Eigen::Vector3d;
  const int n = static_cast<int>(points.cols());
  double least = INFINITY;
  for (int a = 0; a < n; ++a) {
    const Vector3d A = points.col(a) - p;
    least = std::min(least, A.norm());
    for (int b = a + 1; b < n; ++b) {
      const Vector3d B = points.col(b) - p, ab = B - A;
      if (ab.norm() > 0) least = std::min(least, (A + std::clamp(-A.dot(ab) / ab.squaredNorm(), 0.0, 1.0) * ab).norm());
      for (int c = b + 1; c < n; ++c) {
        const Vector3d C = points.col(c) - p, cross = ab.cross(C - A);
        if (cross.norm() > 1e-12) {
          const Vector3d normal = cross.normalized(), foot = normal * normal.dot(A);
          const double u = (B - foot).cross(C - foot).dot(normal), v = (C - foot).cross(A - foot).dot(normal),
                       w = (A - foot).cross(B - foot).dot(normal);
          if (u >= 0 && v >= 0 && w >= 0) least = std::min(least, foot.norm());
        }
        for (int d = c + 1; d < n; ++d) {
          const Vector3d D = points.col(d) - p;
          const double volume = (B - A).cross(C - A).dot(D - A);
          if (std::abs(volume) < 1e-12) continue;
          const double parts[4] = {B.cross(C).dot(D), -A.cross(C).dot(D), A.cross(B).dot(D), -A.cross(B).dot(C)};
          if (std::all_of(parts, parts + 4, [&](double part) { return part / volume >= 0; })) return 0.0;
        }
      }
    }
  }
  return least;
}

}  // namespace swarm
