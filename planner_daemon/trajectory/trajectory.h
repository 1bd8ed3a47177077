// A committed trajectory: a C2 quintic spline that ends at rest (paper section IV-C; degree 5 instead of 4, so that
// position, velocity and acceleration at the knots determine it and C2 holds by construction, also after quantisation
// on the wire).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "sogm_swarm/announcement_t.hpp"
#include "sogm_swarm/trajectory_t.hpp"

namespace swarm {

// Position [m], velocity [m/s], acceleration [m/s^2] and jerk [m/s^3] in W.
struct MotionState {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();
  Eigen::Vector3d jerk = Eigen::Vector3d::Zero();
};

using ControlPoints = Eigen::Matrix<double, 3, 6>;  // of one quintic Bezier piece, points are columns [m]

// Bezier control points of the quintic of duration `h_s` > 0 between two states: their hull contains the piece.
ControlPoints quintic_control_points(const MotionState& from, const MotionState& to, double h_s);

// State of the quintic with these control points at s in [0, 1].
MotionState evaluate_bezier(const ControlPoints& points, double h_s, double s);

// Its position alone.
Eigen::Vector3d bezier_position(const ControlPoints& points, double s);

// Control points of the part of the quintic within s in [from, to], 0 <= from < to <= 1.
ControlPoints part_of(const ControlPoints& points, double from, double to);

// Largest per-axis |velocity| and |acceleration| control point of a piece: bounds on the piece itself.
double max_speed_bound(const ControlPoints& points, double h_s);
double max_acceleration_bound(const ControlPoints& points, double h_s);

class Trajectory {
 public:
  static constexpr int kMaxPieces = sogm_swarm::trajectory_t::kMaxPieces;

  // No trajectory (seq 0).
  Trajectory() = default;
  // Hover at `position` from `start_utime` on. seq >= 1.
  static Trajectory hover(std::int32_t seq, std::int64_t start_utime, const Eigen::Vector3d& position);
  // From a message that passed decode().
  static Trajectory from_wire(const sogm_swarm::trajectory_t& wire);
  sogm_swarm::trajectory_t to_wire() const;

  // Appends nothing yet: an empty spline that set_knot fills. 1 <= num_pieces <= kMaxPieces.
  Trajectory(std::int32_t seq, std::int64_t start_utime, std::int32_t piece_us, int num_pieces);
  // Knot i in [0, num_pieces], rounded to what the wire carries.
  void set_knot(int i, const MotionState& state);
  // Knot i (jerk is zero).
  MotionState knot(int i) const;

  bool empty() const { return num_pieces_ == 0; }
  std::int32_t seq() const { return seq_; }
  void set_seq(std::int32_t seq) { seq_ = seq; }
  std::int64_t start_utime() const { return start_utime_; }
  void shift(std::int64_t later_us) { start_utime_ += later_us; }
  std::int64_t end_utime() const { return start_utime_ + std::int64_t{piece_us_} * num_pieces_; }
  std::int32_t piece_us() const { return piece_us_; }
  double piece_s() const { return piece_us_ * 1e-6; }
  int num_pieces() const { return num_pieces_; }

  // State at `utime`: clamped to knot 0 before the start, hovering at the last knot after the end. Not for empty ones.
  MotionState at(std::int64_t utime) const;
  // The same but for the jerk, which is zero at knots; faster there.
  MotionState state_at(std::int64_t utime) const;
  // First knot time later than `utime`, or INT64_MAX after the end: between knots the motion is one quintic.
  std::int64_t next_knot_after(std::int64_t utime) const;

 private:
  std::int32_t seq_ = 0;
  std::int64_t start_utime_ = 0;
  std::int32_t piece_us_ = 1;
  int num_pieces_ = 0;
  std::array<std::array<float, 9>, kMaxPieces + 1> knots_{};
};

// What a robot is bound to: it flies `committed`, and from the start of `next` on (when there is one) flies that.
struct Motion {
  Trajectory committed;
  Trajectory next;  // empty, or starts on `committed`

  MotionState at(std::int64_t utime) const {
    return !next.empty() && utime >= next.start_utime() ? next.at(utime) : committed.at(utime);
  }
  // First time later than `utime` at which the polynomial changes, or INT64_MAX.
  std::int64_t next_knot_after(std::int64_t utime) const;
  // Of the trajectory it ends with.
  std::int32_t seq() const { return next.empty() ? committed.seq() : next.seq(); }
  // The robot hovers from here on.
  std::int64_t end_utime() const { return next.empty() ? committed.end_utime() : next.end_utime(); }
};

// What an announcement says its robot is bound to, and what it would like to be. From a message that passed decode();
// `announced` is empty when nothing waits for acknowledgements.
void read_announcement(const sogm_swarm::announcement_t& message, Motion* motion, Trajectory* announced);

// Control points of the motion during [from, to], which must hold no knot inside.
ControlPoints control_points_between(const Motion& motion, std::int64_t from_utime, std::int64_t to_utime);

}  // namespace swarm
