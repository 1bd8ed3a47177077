// Worlds: how obstacles move, and where robots may start.
#include "swarm_sim/world/world.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "swarm_sim/world/occupied_cubes.h"
#include "swarm_sim/world/walls.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

// Moves in small steps and turns at the border: the meaning of "reflects", without the closed form.
struct Stepped {
  double position, velocity;
  void advance(double low, double high, double dt) {
    position += velocity * dt;
    if (position > high) position = 2 * high - position, velocity = -velocity;
    if (position < low) position = 2 * low - position, velocity = -velocity;
  }
};

TEST(Motion, ReflectionEqualsSteppedSimulation) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int trial = 0; trial < 50; ++trial) {
    World world;
    world.obstacle_bounds = {{-7, -3}, {7, 2}};
    WorldObstacle obstacle;
    obstacle.center = {-7 + 14 * unit(random), -3 + 5 * unit(random), 2.0};
    obstacle.velocity_mps = {4 * unit(random) - 2, 20 * unit(random) - 10};
    Stepped x{obstacle.center.x(), obstacle.velocity_mps.x()}, y{obstacle.center.y(), obstacle.velocity_mps.y()};
    SCOPED_TRACE(testing::Message() << "trial " << trial << " centre " << obstacle.center.transpose() << " velocity "
                                    << obstacle.velocity_mps.transpose());
    constexpr double kDt = 0.01;
    for (int step = 0; step <= 3000; ++step) {
      const auto state = state_at(obstacle, world, step * kDt);
      ASSERT_TRUE(state);
      ASSERT_NEAR(state->position.x(), x.position, 1e-9);
      ASSERT_NEAR(state->position.y(), y.position, 1e-9);
      ASSERT_EQ(state->position.z(), 2.0);
      ASSERT_EQ(state->velocity, Eigen::Vector3d(x.velocity, y.velocity, 0.0)) << "step " << step;
      x.advance(-7, 7, kDt);
      y.advance(-3, 2, kDt);
    }
  }
}

TEST(Motion, ReflectsForwardsBackwardsAndFarAway) {
  World world;
  world.obstacle_bounds = {{-7, -7}, {7, 7}};
  WorldObstacle obstacle;
  obstacle.center = {6, 0, 1};
  obstacle.velocity_mps = {1, 0};
  EXPECT_DOUBLE_EQ(state_at(obstacle, world, 1.5)->position.x(), 6.5);
  EXPECT_EQ(state_at(obstacle, world, 1.5)->velocity.x(), -1.0);
  EXPECT_EQ(state_at(obstacle, world, 1.0)->velocity.x(), -1.0)
      << "at the border the velocity is the one after the turn";
  EXPECT_DOUBLE_EQ(state_at(obstacle, world, -14.0)->position.x(), -6.0);
  EXPECT_NEAR(state_at(obstacle, world, 28e6 + 1.5)->position.x(), 6.5, 1e-8);
  obstacle.velocity_mps = {0, 0};
  obstacle.center = {20, 0, 1};  // stands outside the bounds: stays there
  EXPECT_EQ(state_at(obstacle, world, 5.0)->position, obstacle.center);
}

// By finite differences; what is left without the uniform motion is a circle through the start.
TEST(Motion, AccelerationHasItsMagnitudeAtAnyTime) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  World world;
  world.obstacle_bounds = {{-1000, -1000}, {1000, 1000}};
  for (int trial = 0; trial < 100; ++trial) {
    WorldObstacle uniform;
    uniform.center = {unit(random), unit(random), 2.0};
    uniform.velocity_mps = {unit(random), unit(random)};
    WorldObstacle obstacle = uniform;
    obstacle.acceleration_mps2 = 1.0 + unit(random);
    const double a = obstacle.acceleration_mps2, vx = obstacle.velocity_mps.x(), vy = obstacle.velocity_mps.y();
    SCOPED_TRACE(testing::Message() << "trial " << trial << " velocity " << vx << ' ' << vy << " acceleration " << a);
    EXPECT_EQ(state_at(obstacle, world, 0.0)->position, state_at(uniform, world, 0.0)->position);
    const auto acceleration_at = [&](double t_s) {
      constexpr double kStep_s = 1e-4;
      const ObstacleState before = *state_at(obstacle, world, t_s - kStep_s), now = *state_at(obstacle, world, t_s),
                          after = *state_at(obstacle, world, t_s + kStep_s);
      EXPECT_LT(((after.position - before.position) / (2 * kStep_s) - now.velocity).norm(), 1e-7) << t_s;
      return Eigen::Vector3d((after.velocity - before.velocity) / (2 * kStep_s));
    };
    double farthest_m = 0.0;
    for (double t_s = -20.0; t_s < 20.0; t_s += 0.37) {
      const Eigen::Vector3d now = acceleration_at(t_s), later = acceleration_at(t_s + 0.5);
      EXPECT_NEAR(now.norm(), a, 1e-6) << t_s;
      EXPECT_EQ(now.cross(later).z() > 0, vx * vy > 0) << t_s << ": not all turn alike";
      const Eigen::Vector3d off = state_at(obstacle, world, t_s)->position - state_at(uniform, world, t_s)->position;
      EXPECT_EQ(off.z(), 0.0);
      farthest_m = std::max(farthest_m, off.norm());
      const Eigen::Vector3d round = state_at(obstacle, world, t_s + kSwayPeriod_s)->position;
      EXPECT_LT((round - state_at(uniform, world, t_s + kSwayPeriod_s)->position - off).norm(), 1e-9) << t_s;
    }
    EXPECT_NEAR(farthest_m, 2 * obstacle.sway_radius_m(), 0.05 * farthest_m);
    EXPECT_LE(farthest_m, 2 * obstacle.sway_radius_m() + 1e-9);
    const Eigen::Vector3d heading = acceleration_at(0.0).normalized();
    EXPECT_NEAR(heading.head<2>().dot(obstacle.velocity_mps.normalized()), 1.0, 1e-6) << "along its velocity at first";
  }
}

TEST(Motion, AccelerationChangesNoReflection) {
  World narrow, wide;
  narrow.obstacle_bounds = {{-1, -1}, {1, 1}};
  wide.obstacle_bounds = {{-1000, -1000}, {1000, 1000}};
  WorldObstacle uniform;
  uniform.velocity_mps = {0.7, 0.0};
  WorldObstacle obstacle = uniform;
  obstacle.acceleration_mps2 = 1.0;
  for (const double t_s : {-9.3, 0.0, 1.7, 25.0, 4e6 + 0.7}) {
    const auto off = [&](const World& world) {
      const ObstacleState state = *state_at(obstacle, world, t_s), base = *state_at(uniform, world, t_s);
      return std::pair<Eigen::Vector3d, Eigen::Vector3d>(state.position - base.position,
                                                         state.velocity - base.velocity);
    };
    EXPECT_LT((off(narrow).first - off(wide).first).norm(), 1e-9) << t_s;
    EXPECT_LT((off(narrow).second - off(wide).second).norm(), 1e-9) << t_s;
  }
  obstacle.velocity_mps.setZero();
  EXPECT_EQ(state_at(obstacle, narrow, 1.0)->position, obstacle.center) << "what stands does not sway";
  EXPECT_EQ(state_at(obstacle, narrow, 1.0)->velocity, Eigen::Vector3d(0, 0, 0));
}

TEST(Motion, TrackIsLinearBetweenItsPointsAndExistsOnlyThere) {
  WorldObstacle obstacle;
  obstacle.center = {0, 0, 0.9};
  obstacle.track = {{-1, {0, 0}}, {1, {2, 4}}, {3, {2, 0}}};
  const World world;
  EXPECT_FALSE(state_at(obstacle, world, -1.001));
  EXPECT_FALSE(state_at(obstacle, world, 3.001));
  EXPECT_EQ(state_at(obstacle, world, -1)->position, Eigen::Vector3d(0, 0, 0.9));
  EXPECT_EQ(state_at(obstacle, world, 0)->position, Eigen::Vector3d(1, 2, 0.9));
  EXPECT_EQ(state_at(obstacle, world, 0)->velocity, Eigen::Vector3d(1, 2, 0));
  EXPECT_EQ(state_at(obstacle, world, 1)->position, Eigen::Vector3d(2, 4, 0.9));
  EXPECT_EQ(state_at(obstacle, world, 1)->velocity, Eigen::Vector3d(0, -2, 0));
  EXPECT_EQ(state_at(obstacle, world, 3)->position, Eigen::Vector3d(2, 0, 0.9));
  EXPECT_EQ(state_at(obstacle, world, 3)->velocity, Eigen::Vector3d(0, -2, 0));
}

TEST(World, StartsInTheStaticMapAreRefused) {
  World world;
  world.robots = {{0, {0, 0, 1}, {{{4, 0, 1}}}, 0.2}, {1, {8, 1, 1}, {{{-8, 1, 1}}}, 0.2}};
  const OccupiedCubes touching({{{8, 1.25, 1}, 0.08}}), clear({{{8, 1.29, 1}, 0.08}});
  EXPECT_NO_THROW(check_starts(world, clear));
  try {
    check_starts(world, touching);
    FAIL();
  } catch (const WorldError& error) {
    EXPECT_STREQ(error.what(), "robots[1].start: [8,1,1] must not touch the static map");
  }
}

}  // namespace
}  // namespace swarm::test
