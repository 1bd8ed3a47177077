// FIRI, "fast iterative regional inflation" (paper section IV-B): grows a convex polytope around a seed among obstacle
// points.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "planner_daemon/corridor/polytope.h"

namespace swarm {

// Obstacle points as occupied voxels come: `count` >= 1 of them, from `first` upwards.
struct PointRun {
  Eigen::Vector3d first;  // W [m]
  int count = 1;
};

struct FiriOptions {
  int iterations = 2;  // polytope, ellipsoid, polytope ...: two give all the volume
  double half_extent_m =
      0;  // obstacle points are cubes of this half edge (half a voxel): faces keep clear of the whole cube
  double spacing_m = 0.0;       // of the points of a run, >= 0
  double log_volume_gap = 1.0;  // of the ellipsoid, > 0: a closer one leads to no larger polytope
};

struct Ellipsoid {
  Eigen::Matrix3d shape = Eigen::Matrix3d::Identity();  // symmetric positive definite B: { B u + center : |u| <= 1 }
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
};

using Normals = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

enum class FiriStatus { kGrown, kSeedBlocked, kTooManyFaces };
const char* to_string(FiriStatus status);

// Keeps its work space between calls: the only allocation in the steady state is the result's, when its size changes.
class Firi {
 public:
  // Grows `polytope` around the convex hull of `seed` (3 x k, k >= 1) inside the box [lower, upper] (which holds the
  // seed; its six faces come first) so that it excludes the obstacle points to within 1e-9 m, and further each one's
  // cube as far as the seed allows: **every seed point stays inside**.
  // kSeedBlocked when an obstacle point lies in the hull of the seed, or within 1e-9 m of it: the polytope is then the
  // box cut by all points that can be excluded.
  // kTooManyFaces when it would need more than a Polytope holds: it is empty then.
  // Throws std::invalid_argument with name, value and rule for an empty seed or options out of range.
  [[nodiscard]] FiriStatus grow(const Eigen::Ref<const Eigen::Matrix3Xd>& seed, std::span<const PointRun> obstacles,
                                const Eigen::Vector3d& lower, const Eigen::Vector3d& upper, const FiriOptions& options,
                                Polytope* polytope);

 private:
  // What of a run is still inside: points [first, last], and the one of them nearest to the centre of the ellipsoid in
  // its metric.
  struct Candidate {
    Eigen::Vector3d base;     // point 0
    Eigen::Vector3d in_ball;  // the same, in the ball that the ellipsoid is the image of
    int first, last, nearest;
    double squared_distance;
  };

  FiriStatus cut(const Ellipsoid& ellipsoid, std::span<const PointRun> obstacles, const Eigen::Vector3d& lower,
                 const Eigen::Vector3d& upper, const FiriOptions& options);
  std::size_t nearest_candidate() const;
  void find_nearest(Candidate* candidate) const;
  void take_out_nearest(std::size_t index);
  bool trim(const Eigen::Vector3d& normal, double limit, Candidate* candidate) const;
  bool inflate(double log_volume_gap, Ellipsoid* ellipsoid) const;
  bool separate(const Eigen::Vector3d& obstacle, const Eigen::Matrix3d& to_ball, const Eigen::Vector3d& center,
                double half_extent_m);
  bool separate_closest(const Eigen::Vector3d& obstacle);
  double support(const Eigen::Vector3d& normal) const;
  void add_face(const Eigen::Vector3d& normal, double offset);

  std::vector<Eigen::Vector3d> seed_, seed_in_ball_;
  std::vector<Candidate> candidates_;
  double spacing_m_ = 0.0;
  Eigen::Vector3d spacing_in_ball_;
  Normals normals_;          // capacity x 3, the first num_faces_ in use
  Eigen::VectorXd offsets_;  // capacity
  int num_faces_ = 0;
};

// Maximum-volume ellipsoid inscribed in a bounded polytope, never outside it; the logarithm of its volume is at most
// about `log_volume_gap` (> 0) short of the maximum. False when `inside` is not an interior point; one within some 1e-9
// of a face costs volume. Unit normals (faces x 3), offsets (faces).
[[nodiscard]] bool inscribed_ellipsoid(const Eigen::Ref<const Normals>& normals,
                                       const Eigen::Ref<const Eigen::VectorXd>& offsets, const Eigen::Vector3d& inside,
                                       double log_volume_gap, Ellipsoid* ellipsoid);
[[nodiscard]] bool inscribed_ellipsoid(const Polytope& polytope, const Eigen::Vector3d& inside, double log_volume_gap,
                                       Ellipsoid* ellipsoid);

}  // namespace swarm
