// The position loop of a multicopter whose flight controller is told how to stand in the air and how hard to push.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "planner_daemon/trajectory/bezier.h"

namespace swarm {

struct PositionGains {
  double position_per_s2 = 8.0, velocity_per_s = 5.0, integral_per_s3 = 4.0;
  double tilt_max_deg = 45.0;  // of the thrust to the vertical
  double hover_thrust = 0.5;   // share of the most thrust at which the robot hovers
};

// Feed-forward, proportional to what is amiss in position and velocity, and integral, which finds wind (level) and how
// much weaker the rotors are than they are said to be (upwards). From further away than a metre the robot comes as from
// there: not at full tilt.
class PositionController {
 public:
  explicit PositionController(const PositionGains& gains) : gains_(gains) {}

  // Force per mass [m/s^2] of the rotors, W: so that a robot that is where `is` says comes to `wanted`, which
  // accelerates by `acceleration`. `dt_s`: since the call before. Within tilt and thrust, and never without thrust.
  Eigen::Vector3d thrust(const MotionState& wanted, const Eigen::Vector3d& acceleration, const MotionState& is,
                         double dt_s);
  // Whatever the integral has found is forgotten.
  void reset() { integral_.setZero(); }

 private:
  PositionGains gains_;
  Eigen::Vector3d integral_ = Eigen::Vector3d::Zero();
};

// A body (forward, right, down) in north, east, down: its turn, and its rates about its own axes [rad/s].
struct BodyTarget {
  Eigen::Quaterniond turn;
  Eigen::Vector3d rates;
};

// The body that pushes by `thrust` [m/s^2], which changes by `change` [m/s^3], north, east, down, and is not level with
// the horizon; its nose above or below `yaw_rad` clockwise from north. As differential flatness has it (Mellinger and
// Kumar, ICRA 2011, section III).
BodyTarget body_of(const Eigen::Vector3d& thrust, const Eigen::Vector3d& change, double yaw_rad, double yaw_rate);

}  // namespace swarm
