// Seeded random motions for the tests, and how to print them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <ostream>
#include <random>

#include "planner_daemon/trajectory/motion.h"

namespace swarm {

using Rng = std::mt19937_64;

inline double uniform(Rng& rng, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(rng);
}

inline int uniform_int(Rng& rng, int low, int high) {
  return std::uniform_int_distribution<int>(low, high)(rng);
}

inline Duration uniform_duration(Rng& rng, Duration low, Duration high) {
  return Duration(uniform_int(rng, static_cast<int>(low.count()), static_cast<int>(high.count())));
}

inline Eigen::Vector3d in_box(Rng& rng, const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  Eigen::Vector3d p;
  for (int axis = 0; axis < 3; ++axis) p[axis] = uniform(rng, low[axis], high[axis]);
  return p;
}

inline Eigen::Vector3d in_cube(Rng& rng, double half) {
  return in_box(rng, Eigen::Vector3d::Constant(-half), Eigen::Vector3d::Constant(half));
}

inline Eigen::Vector3d direction(Rng& rng) {
  std::normal_distribution<double> normal;
  const double x = normal(rng), y = normal(rng), z = normal(rng);
  return Eigen::Vector3d(x, y, z).normalized();
}

inline MotionState random_state(Rng& rng, double half_m, double speed_mps, double acceleration_mps2) {
  MotionState state;
  state.position = in_cube(rng, half_m);
  state.velocity = in_cube(rng, speed_mps);
  state.acceleration = in_cube(rng, acceleration_mps2);
  return state;
}

// From `start` through random knots within `half_m` of the origin to rest.
inline Trajectory random_trajectory(Rng& rng, std::int32_t seq, Utime start_utime, const MotionState& start,
                                    double half_m) {
  const int pieces = uniform_int(rng, 1, Trajectory::kMaxPieces);
  Trajectory trajectory(seq, start_utime, uniform_duration(rng, 100ms, 400ms), pieces);
  trajectory.set_knot(0, start);
  for (int i = 1; i <= pieces; ++i) {
    MotionState knot = random_state(rng, 1.5 * trajectory.piece_s(), 1.5, i < pieces ? 4.0 : 0.0);
    if (i == pieces) knot.velocity.setZero();
    knot.position += trajectory.knot(i - 1).position + trajectory.piece_s() * trajectory.knot(i - 1).velocity;
    knot.position = knot.position.cwiseMax(-half_m).cwiseMin(half_m);
    trajectory.set_knot(i, knot);
  }
  return trajectory;
}

// Starts at `start_utime` at rest; half of them have a `next` that leaves `committed` anywhere, also after its end.
inline Motion random_motion(Rng& rng, Utime start_utime, double half_m) {
  Motion motion;
  motion.committed = random_trajectory(rng, 1, start_utime, random_state(rng, half_m, 0, 0), half_m);
  if (uniform_int(rng, 0, 1) == 1) {
    const Duration length = motion.committed.end_utime() - start_utime;
    const Utime leave = start_utime + to_duration(uniform(rng, 0.0, 1.2) * to_seconds(length));
    motion.next = random_trajectory(rng, 2, leave, motion.committed.at(leave), half_m);
  }
  return motion;
}

inline std::ostream& operator<<(std::ostream& out, const MotionState& state) {
  const Eigen::IOFormat format(17, Eigen::DontAlignCols, " ", " ");
  return out << "p " << state.position.format(format) << " v " << state.velocity.format(format) << " a "
             << state.acceleration.format(format);
}

inline std::ostream& operator<<(std::ostream& out, const Trajectory& trajectory) {
  if (trajectory.empty()) return out << "none";
  out << "start " << to_us(trajectory.start_utime()) << " us, pieces of " << trajectory.piece().count() << " us";
  for (int i = 0; i <= trajectory.num_pieces(); ++i) out << "\n  " << trajectory.knot(i);
  return out;
}

inline std::ostream& operator<<(std::ostream& out, const Motion& motion) {
  return out << "committed: " << motion.committed << "\nnext: " << motion.next;
}

}  // namespace swarm
