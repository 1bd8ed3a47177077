#include "planner_daemon/trajectory/motion_limits.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/random_motion.h"

namespace swarm {
namespace {

using Eigen::Vector3d;

constexpr Utime kStart{1'000s};

MotionLimits by_thrust(double least_mps2, double most_mps2, double tilt_deg) {
  MotionLimits limits;
  limits.kind = "thrust";
  limits.thrust = {least_mps2, most_mps2, tilt_deg};
  return limits;
}

MotionState accelerating(const Vector3d& acceleration) {
  MotionState state;
  state.acceleration = acceleration;
  return state;
}

TEST(MotionLimitsTest, ThrustAndTiltDecideWhatCanBePulled) {
  Rng rng(1);
  const MotionLimits limits = by_thrust(3.0, 18.0, 35.0);
  int pulled = 0, refused = 0;
  for (int trial = 0; trial < 20'000; ++trial) {
    const Vector3d a = in_cube(rng, 12.0), thrust = a + Vector3d(0, 0, 9.81);
    const double tilt_deg = std::acos(thrust.z() / thrust.norm()) * 180.0 / M_PI;
    const bool can = thrust.norm() > 3.0 && thrust.norm() < 18.0 && tilt_deg < 35.0;
    if (std::abs(thrust.norm() - 3.0) < 1e-3 || std::abs(thrust.norm() - 18.0) < 1e-3 || std::abs(tilt_deg - 35) < 1e-3)
      continue;
    EXPECT_EQ(limits.can_follow(accelerating(a), {1.0}), can) << a.transpose();
    (can ? pulled : refused) += 1;
  }
  EXPECT_GT(pulled, 1000);
  EXPECT_GT(refused, 1000);
}

// What search and optimisation may use can be pulled, in every combination that the pyramid's sides allow.
TEST(MotionLimitsTest, WhatTheAxesMayDoCanBePulled) {
  Rng rng(2);
  for (int trial = 0; trial < 200; ++trial) {
    const MotionLimits limits = by_thrust(uniform(rng, 0.5, 8.0), uniform(rng, 16.0, 40.0), uniform(rng, 10.0, 50.0));
    if (limits.thrust.most_mps2 * std::cos(limits.thrust.tilt_deg * M_PI / 180.0) < 9.9) continue;
    const Vector3d axis = limits.axis_mps2();
    EXPECT_GT(axis.minCoeff(), 0.0);
    for (int i = 0; i < 50; ++i) {
      const Vector3d a = axis.cwiseProduct(in_cube(rng, 1.0));
      // Of 16 sides the corners lie farthest out.
      if (a.head<2>().norm() * std::cos(M_PI / 16) > limits.tilt_slope() * (9.81 + a.z())) continue;
      EXPECT_TRUE(limits.can_follow(accelerating(a), {1.0})) << a.transpose();
    }
    const double level = std::sqrt(2.0) * axis.x();  // in any direction, without climbing
    EXPECT_LE(level, std::tan(limits.thrust.tilt_deg * M_PI / 180.0) * 9.81);
    EXPECT_GE(level, 0.98 * std::tan(limits.thrust.tilt_deg * M_PI / 180.0) * 9.81);
  }
}

TEST(MotionLimitsTest, KeepsJerkAndThrustAlongTheWholeTrajectory) {
  // From rest to rest over 1 m in 1 s: a quintic of 5.77 m/s^2 and 60 m/s^3.
  Trajectory line(1, kStart, 1s, 1);
  line.set_knot(0, {});
  MotionState end;
  end.position = {1, 0, 0};
  line.set_knot(1, end);
  MotionLimits limits;
  EXPECT_TRUE(keeps(line, limits));
  limits.j_max_mps3 = 61.0;
  EXPECT_TRUE(keeps(line, limits));
  limits.j_max_mps3 = 59.0;
  EXPECT_FALSE(keeps(line, limits));
  limits.j_max_mps3 = 0.0;
  limits.a_max_mps2 = 5.7;
  EXPECT_FALSE(keeps(line, limits));
  limits.a_max_mps2 = 6.0;
  limits.v_max_mps = 1.85;  // 1.875 m/s
  EXPECT_FALSE(keeps(line, limits));
  EXPECT_TRUE(keeps(line, by_thrust(2, 20, 45)));
  EXPECT_FALSE(keeps(line, by_thrust(2, 20, 30)));  // atan(5.77 / 9.81) = 30.5 degrees
  EXPECT_FALSE(keeps(line, by_thrust(2, 11.2, 28)));
}

TEST(MotionLimitsTest, BrakesWithinItsJerk) {
  MotionLimits limits;
  limits.j_max_mps3 = 12.0;
  const Trajectory braking = Trajectory::braking(1, kStart, {0, 0, 1}, {1.5, -0.3, 0.7}, limits);
  double most_mps3 = 0.0;
  for (Utime t = kStart; t < braking.end_utime(); t += 1ms)
    most_mps3 = std::max(most_mps3, braking.at(t).jerk.cwiseAbs().maxCoeff());
  EXPECT_NEAR(most_mps3, 12.0, 0.1);
  EXPECT_NEAR(limits.stopping_mps2(), std::sqrt(2.0 * 12.0 / 6.0), 1e-12);
}

TEST(MotionLimitsTest, RefusesWhatCouldNotHover) {
  const auto verified = [](const MotionLimits& limits) -> std::string {
    try {
      verify(limits);
      return "";
    } catch (const OptionError& error) {
      return error.what();
    }
  };
  EXPECT_EQ(verified(by_thrust(2, 20, 45)), "");
  EXPECT_EQ(verified(by_thrust(2, 12, 45)),
            "--thrust-max: 12 m/s^2 tilted by --tilt-max, 45 deg, is 8.49 m/s^2 upwards; must be more than gravity, "
            "9.81 m/s^2");
  MotionLimits axes = by_thrust(2, 12, 45);
  axes.kind = "axes";
  EXPECT_EQ(verified(axes), "");
}

}  // namespace
}  // namespace swarm
