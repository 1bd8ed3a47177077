#include "tools/bridge/position_controller.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "planner_daemon/trajectory/motion_limits.h"

namespace swarm {
namespace {

constexpr double kLeastUp_mps2 = 2.0;
constexpr double kMostAmiss_m = 1.0;
constexpr double kMostIntegral_mps2 = 4.0;
constexpr double kRateStep_s = 1e-5;

// Upwards first: height is kept when there is not enough for both.
Eigen::Vector3d within_limits(const Eigen::Vector3d& thrust, const PositionGains& gains) {
  const double most = MotionLimits::kGravity_mps2 / gains.hover_thrust,
               up = std::clamp(thrust.z(), kLeastUp_mps2, most);
  const double sideways = thrust.head<2>().norm();
  const double most_sideways =
      std::min(std::tan(gains.tilt_max_deg * std::numbers::pi / 180.0) * up, std::sqrt(most * most - up * up));
  const double share = sideways > most_sideways ? most_sideways / sideways : 1.0;
  return {share * thrust.x(), share * thrust.y(), up};
}

Eigen::Quaterniond turn_of(const Eigen::Vector3d& thrust, double yaw_rad) {
  Eigen::Matrix3d axes;
  axes.col(2) = -thrust.normalized();
  axes.col(0) = Eigen::Vector3d(-std::sin(yaw_rad), std::cos(yaw_rad), 0.0).cross(axes.col(2)).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return Eigen::Quaterniond(axes);
}

}  // namespace

Eigen::Vector3d PositionController::thrust(const MotionState& wanted, const Eigen::Vector3d& acceleration,
                                           const MotionState& is, double dt_s) {
  Eigen::Vector3d amiss = wanted.position - is.position;
  if (const double distance = amiss.norm(); distance > kMostAmiss_m) amiss *= kMostAmiss_m / distance;
  const Eigen::Vector3d integral =
      (integral_ + dt_s * gains_.integral_per_s3 * amiss).cwiseMax(-kMostIntegral_mps2).cwiseMin(kMostIntegral_mps2);
  const Eigen::Vector3d gravity(0.0, 0.0, MotionLimits::kGravity_mps2);
  const Eigen::Vector3d wind(integral.x(), integral.y(), 0.0);
  const double weakness = 1.0 + integral.z() / gravity.z();  // of the rotors, against what is said of them
  const Eigen::Vector3d told = weakness * (gravity + acceleration + gains_.position_per_s2 * amiss +
                                           gains_.velocity_per_s * (wanted.velocity - is.velocity) + wind);
  const Eigen::Vector3d thrust = within_limits(told, gains_);
  if (thrust == told) integral_ = integral;  // at a limit it would only wind up
  return thrust;
}

BodyTarget body_of(const Eigen::Vector3d& thrust, const Eigen::Vector3d& change, double yaw_rad, double yaw_rate) {
  const Eigen::Quaterniond turn = turn_of(thrust, yaw_rad);
  const Eigen::Quaterniond later = turn_of(thrust + kRateStep_s * change, yaw_rad + kRateStep_s * yaw_rate);
  const Eigen::Quaterniond turned = turn.conjugate() * later;
  return {turn, std::copysign(2.0 / kRateStep_s, turned.w()) * turned.vec()};
}

}  // namespace swarm
