// A convex polytope as an intersection of half-spaces.
#pragma once

#include <Eigen/Core>

namespace swarm {

// Points p with normals.row(i) . p <= offsets(i) for all i. Normals have unit length and point outwards; W [m]. Holds
// its faces itself, so that polytopes are copied without taking memory.
struct Polytope {
  static constexpr int kMaxFaces = 128;
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor, kMaxFaces, 3> normals;  // faces x 3
  Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxFaces, 1> offsets;  // faces

  int num_faces() const { return static_cast<int>(offsets.size()); }
  // Largest violation of any face by `p` [m]; negative inside.
  double violation(const Eigen::Vector3d& p) const {
    return num_faces() == 0 ? -1e30 : (normals * p - offsets).maxCoeff();
  }
};

}  // namespace swarm
