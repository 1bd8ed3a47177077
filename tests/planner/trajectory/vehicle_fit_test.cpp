// What a controller is told.
#include "planner_daemon/trajectory/vehicle_fit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace swarm {
namespace {

TEST(VehicleFit, TellsTheFuture) {
  const MotionState state{{1, 2, 3}, {2, 0, -1}, {0, 3, 0}, {6, 0, 0}};
  const MotionState same = fitted(state, {});
  EXPECT_EQ(same.position, state.position);
  EXPECT_EQ(same.velocity, state.velocity);
  EXPECT_EQ(same.acceleration, state.acceleration);

  const MotionState told = fitted(state, {.lead_s = 0.1, .lag_s = 0.05, .drag_per_s = 0.5});
  EXPECT_TRUE(told.position.isApprox(Eigen::Vector3d(1.201, 2.015, 2.9), 1e-12));
  EXPECT_TRUE(told.velocity.isApprox(Eigen::Vector3d(2.03, 0.3, -1), 1e-12));
  // 0.1 s and 0.05 s of jerk, half the velocity
  EXPECT_TRUE(told.acceleration.isApprox(Eigen::Vector3d(0.9 + 1.015, 3 + 0.15, -0.5), 1e-12));
  EXPECT_EQ(told.jerk, state.jerk);
}

// A first-order lag that is told so flies what it should.
TEST(VehicleFit, MakesUpForALag) {
  const double lag_s = 0.1, dt_s = 1e-4;
  double acceleration = 0.0, worst = 0.0, worst_without = 0.0, without = 0.0;
  for (double t = 0.0; t < 2.0; t += dt_s) {
    MotionState state;
    state.acceleration.x() = t * (2 - t);
    state.jerk.x() = 2 - 2 * t;
    acceleration += dt_s / lag_s * (fitted(state, {.lag_s = lag_s}).acceleration.x() - acceleration);
    without += dt_s / lag_s * (state.acceleration.x() - without);
    worst = std::max(worst, std::abs(acceleration - state.acceleration.x()));
    worst_without = std::max(worst_without, std::abs(without - state.acceleration.x()));
  }
  EXPECT_LT(worst, 1e-3);
  EXPECT_GT(worst_without, 0.1);
}

}  // namespace
}  // namespace swarm
