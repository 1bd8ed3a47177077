// What a robot can fly: bounds on speed, acceleration and jerk, those of the acceleration per axis (as in the paper) or
// by what thrust and tilt allow.
#pragma once

#include <Eigen/Core>
#include <string>

#include "lcmtypes/bus/option_set.h"
#include "planner_daemon/trajectory/trajectory.h"

namespace swarm {

// Of a multicopter: its acceleration is thrust per mass, along its own vertical, less gravity.
struct ThrustLimits {
  double least_mps2 = 2.0, most_mps2 = 20.0;  // thrust per mass
  double tilt_deg = 45.0;                     // at most, < 90
  bool operator==(const ThrustLimits&) const = default;
};

// By how much limits may be passed: by a factor, and by what rounding makes of accelerations and jerks.
struct Slack {
  double factor;
  double a_mps2 = 1e-5, j_mps3 = 0.1;  // where it begins in floats

  // Of pieces between knots that are rounded as a Trajectory's are.
  static Slack of_rounded(double factor, double piece_s);
};

struct MotionLimits {
  static constexpr double kGravity_mps2 = 9.81;
  // A cone of tilt is taken for an upright pyramid of so many sides inside it.
  static constexpr int kTiltSides = 16;

  double v_max_mps = 2.0;     // per axis
  double a_max_mps2 = 6.0;    // per axis, where accelerations are limited by axes
  double j_max_mps3 = 0.0;    // per axis; 0: not limited
  std::string kind = "axes";  // or "thrust": accelerations are limited by
  ThrustLimits thrust = {};
  bool operator==(const MotionLimits&) const = default;

  bool limits_jerk() const { return j_max_mps3 > 0.0; }
  bool limits_thrust() const { return kind == "thrust"; }
  // Largest acceleration of each axis [m/s^2], the same both ways. By thrust: level flight's in any direction; and as
  // much up as down, at any tilt.
  Eigen::Vector3d axis_mps2() const;
  // Largest sideways acceleration over upward acceleration and gravity's together: of the pyramid's sides.
  double tilt_slope() const;
  // What braking from v_max achieves on average: where jerk is limited, less than an axis does.
  double stopping_mps2() const;

  // Whether a state, or a whole piece by its control points, keeps the limits of acceleration and jerk.
  bool can_follow(const MotionState& state, const Slack& slack) const;
  bool can_follow(const ControlPoints& points, double h_s, const Slack& slack) const;

 private:
  bool can_pull(const Eigen::Vector3d& acceleration, const Slack& slack) const;
};

// Whether a trajectory keeps all of them, but for rounding.
bool keeps(const Trajectory& trajectory, const MotionLimits& limits);

void declare(OptionSet& options, MotionLimits& limits);
void declare_thrust(OptionSet& options, MotionLimits& limits);  // the part of it that --limits thrust needs
// Throws OptionError where the robot could not hover.
void verify(const MotionLimits& limits);

}  // namespace swarm
