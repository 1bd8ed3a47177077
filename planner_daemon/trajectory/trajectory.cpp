#include "planner_daemon/trajectory/trajectory.h"

#include <algorithm>
#include <cmath>

#include "lcmtypes/bus/limits.h"
#include "planner_daemon/trajectory/motion_limits.h"

namespace swarm {

Trajectory::Trajectory(std::int32_t seq, Utime start_utime, Duration piece, int num_pieces)
    : seq_(seq), start_utime_(start_utime), piece_(piece), num_pieces_(num_pieces) {}

Trajectory Trajectory::hover(std::int32_t seq, Utime start_utime, const Eigen::Vector3d& position) {
  Trajectory trajectory(seq, start_utime, 100ms, 1);
  MotionState rest;
  rest.position = position;
  trajectory.set_knot(0, rest);
  trajectory.set_knot(1, rest);
  return trajectory;
}

// The velocity falls as a cubic of time does: half of `duration_s` at the first one, and three halves of an even
// braking.
Trajectory Trajectory::braking(std::int32_t seq, Utime start_utime, const Eigen::Vector3d& position,
                               const Eigen::Vector3d& velocity, const MotionLimits& limits) {
  const double v_mps = velocity.cwiseAbs().maxCoeff();
  double longest_s = 1.5 * v_mps / limits.axis_mps2().minCoeff();
  if (limits.limits_jerk()) longest_s = std::max(longest_s, std::sqrt(6.0 * v_mps / limits.j_max_mps3));
  const double duration_s = std::clamp(longest_s, 0.1, 5.0);
  Trajectory trajectory(seq, start_utime, to_duration(duration_s), 1);
  MotionState state;
  state.position = position;
  state.velocity = velocity;
  trajectory.set_knot(0, state);
  state.position += 0.5 * duration_s * velocity;
  state.velocity.setZero();
  trajectory.set_knot(1, state);
  return trajectory;
}

Trajectory Trajectory::from_wire(const sogm_swarm::trajectory_t& wire) {
  Trajectory trajectory(wire.seq, to_utime(wire.start_utime), Duration(std::max(wire.piece_us, 1)), wire.num_pieces);
  for (int i = 0; i <= wire.num_pieces; ++i) {
    const Eigen::Map<const Eigen::Matrix<float, 3, 3>> knot(wire.knots[i]);  // columns: p, v, a
    trajectory.set_knot(i, {knot.col(0).cast<double>(), knot.col(1).cast<double>(), knot.col(2).cast<double>()});
  }
  return trajectory;
}

sogm_swarm::trajectory_t Trajectory::to_wire() const {
  sogm_swarm::trajectory_t wire{};
  if (empty()) return wire;
  wire.seq = seq_;
  wire.start_utime = to_us(start_utime_);
  wire.piece_us = static_cast<std::int32_t>(piece_.count());
  wire.num_pieces = static_cast<std::int16_t>(num_pieces_);
  for (std::size_t i = 0; i <= static_cast<std::size_t>(num_pieces_); ++i)
    std::copy(knots_[i].begin(), knots_[i].end(), wire.knots[i]);
  return wire;
}

void Trajectory::set_knot(int i, const MotionState& state) {
  auto& knot = knots_[static_cast<std::size_t>(i)];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<Eigen::Index>(axis);
    knot[axis] = rounded(state.position[at], kStepsPerMetre);
    if (i == num_pieces_) continue;
    knot[3 + axis] = rounded(state.velocity[at], kStepsPerMps);
    knot[6 + axis] = rounded(state.acceleration[at], kStepsPerMps2);
  }
}

MotionState Trajectory::knot(int i) const {
  const Eigen::Map<const Eigen::Matrix<float, 3, 3>> knot(knots_[static_cast<std::size_t>(i)].data());
  MotionState state;
  state.position = knot.col(0).cast<double>();
  state.velocity = knot.col(1).cast<double>();
  state.acceleration = knot.col(2).cast<double>();
  return state;
}

MotionState Trajectory::state_at(Utime utime) const {
  const Duration since = utime - start_utime_;
  if (since < 0us || since % piece_ != 0us || utime > end_utime()) return at(utime);
  return knot(static_cast<int>(since / piece_));
}

MotionState Trajectory::at(Utime utime) const {
  if (utime <= start_utime_) return knot(0);
  if (utime >= end_utime()) {
    MotionState rest;
    rest.position = knot(num_pieces_).position;
    return rest;
  }
  const Duration since = utime - start_utime_;
  const int piece = static_cast<int>(since / piece_);
  const double s = static_cast<double>((since % piece_).count()) / static_cast<double>(piece_.count());
  return evaluate_bezier(quintic_control_points(knot(piece), knot(piece + 1), piece_s()), piece_s(), s);
}

Utime Trajectory::next_knot_after(Utime utime) const {
  if (empty() || utime >= end_utime()) return kNever;
  if (utime < start_utime_) return start_utime_;
  return start_utime_ + ((utime - start_utime_) / piece_ + 1) * piece_;
}

}  // namespace swarm
