#include "planner_daemon/trajectory/trajectory.h"

#include <algorithm>
#include <limits>

namespace swarm {

ControlPoints quintic_control_points(const MotionState& from, const MotionState& to, double h_s) {
  ControlPoints c;
  c.col(0) = from.position;
  c.col(1) = from.position + h_s / 5 * from.velocity;
  c.col(2) = 2 * c.col(1) - c.col(0) + h_s * h_s / 20 * from.acceleration;
  c.col(5) = to.position;
  c.col(4) = to.position - h_s / 5 * to.velocity;
  c.col(3) = 2 * c.col(4) - c.col(5) + h_s * h_s / 20 * to.acceleration;
  return c;
}

MotionState evaluate_bezier(const ControlPoints& points, double h_s, double s) {
  // de Casteljau: the last triangles are the differences of the derivatives.
  ControlPoints c = points;
  MotionState state;
  for (int left = 5; left > 0; --left) {
    if (left == 3) state.jerk = 60 / (h_s * h_s * h_s) * (c.col(3) - 3 * c.col(2) + 3 * c.col(1) - c.col(0));
    if (left == 2) state.acceleration = 20 / (h_s * h_s) * (c.col(2) - 2 * c.col(1) + c.col(0));
    if (left == 1) state.velocity = 5 / h_s * (c.col(1) - c.col(0));
    for (int j = 0; j < left; ++j) c.col(j) = (1 - s) * c.col(j) + s * c.col(j + 1);
  }
  state.position = c.col(0);
  return state;
}

Eigen::Vector3d bezier_position(const ControlPoints& points, double s) {
  const double r = 1.0 - s, r2 = r * r, s2 = s * s;
  return r2 * r * (r2 * points.col(0) + 5 * r * s * points.col(1) + 10 * s2 * points.col(2)) +
         s2 * s * (10 * r2 * points.col(3) + 5 * r * s * points.col(4) + s2 * points.col(5));
}

// De Casteljau: what is left of `to`, and of that what is right of `from`.
ControlPoints part_of(const ControlPoints& points, double from, double to) {
  ControlPoints part = points;
  for (int level = 1; level <= 5; ++level) {
    for (int i = 5; i >= level; --i) part.col(i) = (1.0 - to) * part.col(i - 1) + to * part.col(i);
  }
  const double u = from / to;
  for (int level = 1; level <= 5; ++level) {
    for (int i = 0; i <= 5 - level; ++i) part.col(i) = (1.0 - u) * part.col(i) + u * part.col(i + 1);
  }
  return part;
}

double max_speed_bound(const ControlPoints& points, double h_s) {
  return 5 / h_s * (points.rightCols<5>() - points.leftCols<5>()).cwiseAbs().maxCoeff();
}

double max_acceleration_bound(const ControlPoints& points, double h_s) {
  return 20 / (h_s * h_s) *
         (points.rightCols<4>() - 2 * points.middleCols<4>(1) + points.leftCols<4>()).cwiseAbs().maxCoeff();
}

Trajectory::Trajectory(std::int32_t seq, std::int64_t start_utime, std::int32_t piece_us, int num_pieces)
    : seq_(seq), start_utime_(start_utime), piece_us_(piece_us), num_pieces_(num_pieces) {}

Trajectory Trajectory::hover(std::int32_t seq, std::int64_t start_utime, const Eigen::Vector3d& position) {
  Trajectory trajectory(seq, start_utime, 100'000, 1);
  MotionState rest;
  rest.position = position;
  trajectory.set_knot(0, rest);
  trajectory.set_knot(1, rest);
  return trajectory;
}

Trajectory Trajectory::from_wire(const sogm_swarm::trajectory_t& wire) {
  Trajectory trajectory(wire.seq, wire.start_utime, std::max(wire.piece_us, 1), wire.num_pieces);
  for (std::size_t i = 0; i < trajectory.knots_.size(); ++i) {
    std::copy(std::begin(wire.knots[i]), std::end(wire.knots[i]), trajectory.knots_[i].begin());
  }
  return trajectory;
}

sogm_swarm::trajectory_t Trajectory::to_wire() const {
  sogm_swarm::trajectory_t wire{};
  if (empty()) return wire;
  wire.seq = seq_;
  wire.start_utime = start_utime_;
  wire.piece_us = piece_us_;
  wire.num_pieces = static_cast<std::int16_t>(num_pieces_);
  for (int i = 0; i <= num_pieces_; ++i) std::copy(knots_[i].begin(), knots_[i].end(), wire.knots[i]);
  return wire;
}

void Trajectory::set_knot(int i, const MotionState& state) {
  for (int axis = 0; axis < 3; ++axis) {
    knots_[i][axis] = static_cast<float>(state.position[axis]);
    knots_[i][3 + axis] = static_cast<float>(state.velocity[axis]);
    knots_[i][6 + axis] = static_cast<float>(state.acceleration[axis]);
  }
}

MotionState Trajectory::knot(int i) const {
  MotionState state;
  for (int axis = 0; axis < 3; ++axis) {
    state.position[axis] = knots_[i][axis];
    state.velocity[axis] = knots_[i][3 + axis];
    state.acceleration[axis] = knots_[i][6 + axis];
  }
  return state;
}

MotionState Trajectory::state_at(std::int64_t utime) const {
  const std::int64_t since = utime - start_utime_;
  if (since < 0 || since % piece_us_ != 0 || utime > end_utime()) return at(utime);
  return knot(static_cast<int>(since / piece_us_));
}

MotionState Trajectory::at(std::int64_t utime) const {
  if (utime <= start_utime_) return knot(0);
  if (utime >= end_utime()) {
    MotionState rest;
    rest.position = knot(num_pieces_).position;
    return rest;
  }
  const std::int64_t since = utime - start_utime_;
  const int piece = static_cast<int>(since / piece_us_);
  const double s = static_cast<double>(since % piece_us_) / piece_us_;
  return evaluate_bezier(quintic_control_points(knot(piece), knot(piece + 1), piece_s()), piece_s(), s);
}

std::int64_t Trajectory::next_knot_after(std::int64_t utime) const {
  if (empty() || utime >= end_utime()) return std::numeric_limits<std::int64_t>::max();
  if (utime < start_utime_) return start_utime_;
  return start_utime_ + ((utime - start_utime_) / piece_us_ + 1) * piece_us_;
}

std::int64_t Motion::next_knot_after(std::int64_t utime) const {
  if (!next.empty() && utime >= next.start_utime()) return next.next_knot_after(utime);
  const std::int64_t knot = committed.next_knot_after(utime);
  return next.empty() ? knot : std::min(knot, next.start_utime());
}

void read_announcement(const sogm_swarm::announcement_t& message, Motion* motion, Trajectory* announced) {
  using sogm_swarm::announcement_t;
  const Trajectory pending = Trajectory::from_wire(message.pending);
  const bool binding = message.pending_state == announcement_t::kCommitted;
  *motion = {Trajectory::from_wire(message.committed), binding ? pending : Trajectory()};
  *announced = message.pending_state == announcement_t::kAnnounced ? pending : Trajectory();
}

ControlPoints control_points_between(const Motion& motion, std::int64_t from_utime, std::int64_t to_utime) {
  // Both ends must come from the trajectory in force during the interval: its right end may be the start of the next.
  const bool on_next = !motion.next.empty() && from_utime >= motion.next.start_utime();
  const Trajectory& trajectory = on_next ? motion.next : motion.committed;
  return quintic_control_points(trajectory.state_at(from_utime), trajectory.state_at(to_utime),
                                1e-6 * static_cast<double>(to_utime - from_utime));
}

}  // namespace swarm
