// The trajectory optimisation of the paper (section IV-C): a piecewise Bezier curve of minimum jerk, C2 at its joints,
// with fixed ends, inside one polytope per piece and within per-axis bounds on the control points of velocity,
// acceleration and jerk; those of the acceleration in a polytope as well.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "planner_daemon/corridor/polytope.h"

namespace swarm {

struct EndState {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();      // W [m]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();      // [m/s]
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();  // [m/s^2]
};

struct SplineProblem {
  EndState start, end;
  double v_max_mps = 2.0;                // per axis [m/s], > 0
  double a_max_mps2 = 6.0;               // per axis [m/s^2], > 0
  std::vector<Polytope> corridors = {};  // one per piece; no faces: the piece is free
  double j_max_mps3 = 0.0;               // per axis [m/s^3]; 0: not bounded
  Polytope accelerations = {};           // [m/s^2]; no faces: bounded by a_max_mps2 alone
  // Where they are greater, the limits of the control points that the end states alone decide.
  double end_v_max_mps = 0.0, end_a_max_mps2 = 0.0;
};

enum class SplineStatus { kSolved, kInfeasible, kIterationLimit };
const char* to_string(SplineStatus status);

struct SplineSolution {
  static constexpr int kMaxPoints = 640;
  // 3 x (pieces * (degree + 1)), piece after piece; memory of its own.
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxPoints> control_points;
  double jerk_integral = 0.0;  // integral of |jerk|^2 dt [m^2/s^5], without weights
  double max_violation = 0.0;  // over all bounds and faces, in their units
  int iterations = 0;
};

// Built once per (degree, durations): eliminates the equalities and factors the Hessian; then solves many problems.
class SplineQp {
 public:
  // degree in [3, 9], 1..64 pieces, durations > 0 [s], pieces * (degree - 2) >= 3 (else the end states over-determine
  // the curve). jerk_weights: how much the jerk of each piece counts, in (0, 1]; empty: 1. Throws std::invalid_argument
  // with name, value and rule.
  explicit SplineQp(int degree, const std::vector<double>& durations_s, const std::vector<double>& jerk_weights = {});
  ~SplineQp();
  SplineQp(SplineQp&&) noexcept;

  // corridors.size() must equal the number of pieces and the bounds be > 0 (std::invalid_argument). kSolved: optimal,
  // violations below 1e-7, but up to 1e-6 at control points that the end states alone decide. kInfeasible: certified;
  // also when an input is not a number. Otherwise the curve in `solution` breaks bounds and is for diagnosis only.
  // Deterministic; iterations are counted, not timed. Allocates only when the problem outgrows all earlier ones.
  [[nodiscard]] SplineStatus solve(const SplineProblem& problem, SplineSolution* solution);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace swarm
