// A committed trajectory: a C2 quintic spline that ends at rest (paper section IV-C). Its knots determine it, so C2
// holds by construction. They are rounded to what announcements carry (kStepsPerMetre, kStepsPerMps, kStepsPerMps2) as
// they are set, and the last one is at rest: whoever checks, flies or hears a trajectory has the same one.
#pragma once

#include <array>
#include <cstdint>

#include "lcmtypes/bus/time.h"
#include "planner_daemon/trajectory/bezier.h"
#include "sogm_swarm/trajectory_t.hpp"

namespace swarm {

struct MotionLimits;

class Trajectory {
 public:
  static constexpr int kMaxPieces = sogm_swarm::trajectory_t::kMaxPieces;

  // No trajectory (seq 0).
  Trajectory() = default;
  // Hover at `position` from `start_utime` on. seq >= 1.
  static Trajectory hover(std::int32_t seq, Utime start_utime, const Eigen::Vector3d& position);
  // From this place at this velocity to rest, within the limits of acceleration and jerk; for 5 s at most, so a faster
  // one brakes harder. seq >= 1.
  static Trajectory braking(std::int32_t seq, Utime start_utime, const Eigen::Vector3d& position,
                            const Eigen::Vector3d& velocity, const MotionLimits& limits);
  // From a message that passed decode(); knots that are not rounded are.
  static Trajectory from_wire(const sogm_swarm::trajectory_t& wire);
  sogm_swarm::trajectory_t to_wire() const;

  // A spline whose knots are all zero until set_knot fills them. 1 <= num_pieces <= kMaxPieces;
  // `piece`, the duration of each, [10 ms, 10 s] as on the wire.
  Trajectory(std::int32_t seq, Utime start_utime, Duration piece, int num_pieces);
  // Knot i in [0, num_pieces], rounded; of the last one the position alone.
  void set_knot(int i, const MotionState& state);
  // Knot i (jerk is zero).
  MotionState knot(int i) const;

  bool empty() const { return num_pieces_ == 0; }
  std::int32_t seq() const { return seq_; }
  void set_seq(std::int32_t seq) { seq_ = seq; }
  Utime start_utime() const { return start_utime_; }
  void shift(Duration later) { start_utime_ += later; }
  Utime end_utime() const { return start_utime_ + num_pieces_ * piece_; }
  Duration piece() const { return piece_; }  // the duration of one
  double piece_s() const { return to_seconds(piece_); }
  int num_pieces() const { return num_pieces_; }

  // State at `utime`: clamped to knot 0 before the start, hovering at the last knot after the end. Not for empty ones.
  MotionState at(Utime utime) const;
  // The same but for the jerk, which is zero at knots; faster there.
  MotionState state_at(Utime utime) const;
  // First knot time later than `utime`, or kNever after the end: between knots the motion is one quintic.
  Utime next_knot_after(Utime utime) const;

 private:
  static float rounded(double value, double steps) {
    constexpr double kWhole = 0x1.8p52;  // no fraction of a number has a place beside it
    return static_cast<float>(((steps * value + kWhole) - kWhole) / steps);
  }

  std::int32_t seq_ = 0;
  Utime start_utime_{};
  Duration piece_{1};
  int num_pieces_ = 0;
  std::array<std::array<float, 9>, kMaxPieces + 1> knots_{};
};

}  // namespace swarm
