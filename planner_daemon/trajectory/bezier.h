// Quintic Bezier pieces: what a trajectory is made of (paper section IV-C; degree 5 instead of 4, so that position,
// velocity and acceleration at the ends determine a piece).
#pragma once

#include <Eigen/Core>

#include "lcmtypes/bus/eigen_alignment.h"

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

// Control points of a piece's acceleration [m/s^2]: their hull contains it.
using AccelerationPoints = Eigen::Matrix<double, 3, 4>;
AccelerationPoints acceleration_points(const ControlPoints& points, double h_s);

// Largest per-axis |velocity| and |acceleration| control point of a piece: bounds on the piece itself.
double max_speed_bound(const ControlPoints& points, double h_s);
double max_acceleration_bound(const ControlPoints& points, double h_s);

}  // namespace swarm
