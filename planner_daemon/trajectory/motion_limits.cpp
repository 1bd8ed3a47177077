#include "planner_daemon/trajectory/motion_limits.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/portable_math.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

SinCos tilt(const ThrustLimits& thrust) {
  return sin_cos(thrust.tilt_deg * std::numbers::pi / 180.0);
}

}  // namespace

// The quintic between two knots that are off by half a step, at its worst: as the ends' second and third derivatives in
// the piece's own time are.
Slack Slack::of_rounded(double factor, double piece_s) {
  const double p_m = 0.5 / kStepsPerMetre, v_mps = 0.5 / kStepsPerMps, a_mps2 = 0.5 / kStepsPerMps2, h = piece_s;
  return {factor, 12.0 * p_m / (h * h) + 6.0 * v_mps / h + 1.5 * a_mps2,
          120.0 * p_m / (h * h * h) + 60.0 * v_mps / (h * h) + 12.0 * a_mps2 / h};
}

double MotionLimits::tilt_slope() const {
  const auto [sin, cos] = tilt(thrust);
  return sin / cos * sin_cos(std::numbers::pi / kTiltSides).cos;
}

Eigen::Vector3d MotionLimits::axis_mps2() const {
  if (!limits_thrust()) return Eigen::Vector3d::Constant(a_max_mps2);
  const double sideways = tilt_slope() * kGravity_mps2 / std::numbers::sqrt2;
  const double upright =
      std::min(thrust.most_mps2 * tilt(thrust).cos - kGravity_mps2, kGravity_mps2 - thrust.least_mps2);
  return {sideways, sideways, upright};
}

double MotionLimits::stopping_mps2() const {
  const double a_mps2 = axis_mps2().minCoeff();
  return limits_jerk() ? std::min(a_mps2, std::sqrt(v_max_mps * j_max_mps3 / 6.0)) : a_mps2;
}

bool MotionLimits::can_pull(const Eigen::Vector3d& acceleration, const Slack& slack) const {
  if (!limits_thrust()) return acceleration.cwiseAbs().maxCoeff() <= slack.factor * a_max_mps2 + slack.a_mps2;
  const auto [sin, cos] = tilt(thrust);
  const Eigen::Vector3d pull = acceleration + Eigen::Vector3d(0.0, 0.0, kGravity_mps2);
  return cos * pull.head<2>().norm() <= slack.factor * sin * pull.z() + slack.a_mps2 &&
         pull.norm() <= slack.factor * thrust.most_mps2 + slack.a_mps2 &&
         slack.factor * pull.norm() >= thrust.least_mps2 - slack.a_mps2;
}

bool MotionLimits::can_follow(const MotionState& state, const Slack& slack) const {
  return can_pull(state.acceleration, slack) &&
         (!limits_jerk() || state.jerk.cwiseAbs().maxCoeff() <= slack.factor * j_max_mps3 + slack.j_mps3);
}

// What can be pulled is convex: a curve keeps within it when its control points do.
bool MotionLimits::can_follow(const ControlPoints& points, double h_s, const Slack& slack) const {
  const AccelerationPoints acceleration = acceleration_points(points, h_s);
  for (int i = 0; i < 4; ++i) {
    if (!can_pull(acceleration.col(i), slack)) return false;
  }
  const Eigen::Matrix<double, 3, 3> jerk = 3 / h_s * (acceleration.rightCols<3>() - acceleration.leftCols<3>());
  return !limits_jerk() || jerk.cwiseAbs().maxCoeff() <= slack.factor * j_max_mps3 + slack.j_mps3;
}

bool keeps(const Trajectory& trajectory, const MotionLimits& limits) {
  constexpr double kTolerance = 1.005;
  const double v_max_mps = kTolerance * limits.v_max_mps;
  const double h = trajectory.piece_s();
  const Slack slack = Slack::of_rounded(kTolerance, h);
  for (int k = 0; k < trajectory.num_pieces(); ++k) {
    const ControlPoints points = quintic_control_points(trajectory.knot(k), trajectory.knot(k + 1), h);
    if (max_speed_bound(points, h) <= v_max_mps && limits.can_follow(points, h, slack)) continue;
    for (double s = 0.0; s < 1.0; s += 0.05) {  // the bounds are not tight
      const MotionState state = evaluate_bezier(points, h, s);
      if (state.velocity.cwiseAbs().maxCoeff() > v_max_mps || !limits.can_follow(state, slack)) return false;
    }
  }
  return true;
}

void declare(OptionSet& options, MotionLimits& limits) {
  options.add("v-max", &limits.v_max_mps, 0.01, 100, "m/s", "speed limit per axis");
  options.add("a-max", &limits.a_max_mps2, 0.01, 1000, "m/s^2", "acceleration limit per axis");
  options.add("j-max", &limits.j_max_mps3, 0, 1e5, "m/s^3", "jerk limit per axis; 0: none");
  declare_thrust(options, limits);
}

void declare_thrust(OptionSet& options, MotionLimits& limits) {
  options.add("limits", &limits.kind, "what limits accelerations: axes, each by itself; or thrust and tilt",
              [](const std::string& kind) {
                if (kind != "axes" && kind != "thrust") throw OptionError("must be axes or thrust");
              });
  options.add("thrust-min", &limits.thrust.least_mps2, 0, 9.8, "m/s^2", "least thrust per mass, of limits by thrust");
  options.add("thrust-max", &limits.thrust.most_mps2, 9.82, 1000, "m/s^2", "most thrust per mass, of limits by thrust");
  options.add("tilt-max", &limits.thrust.tilt_deg, 1, 80, "deg",
              "of the thrust to the vertical at most, of limits by thrust");
}

void verify(const MotionLimits& limits) {
  const double upward = limits.thrust.most_mps2 * tilt(limits.thrust).cos;
  if (limits.limits_thrust() && !(upward > MotionLimits::kGravity_mps2)) {
    throw OptionError("--thrust-max: " + text_of(limits.thrust.most_mps2) + " m/s^2 tilted by --tilt-max, " +
                      text_of(limits.thrust.tilt_deg) + " deg, is " + fixed(upward, 2) +
                      " m/s^2 upwards; must be more than gravity, 9.81 m/s^2");
  }
}

}  // namespace swarm
