// What a sensor reports of what is there: noise, gaps, delays, and what is not there.
#include "swarm_sim/environment/sensor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace swarm {
namespace {

using sogm_swarm::obstacle_t;
using sogm_swarm::obstacles_t;

World two_columns() {
  World world;
  world.name = "columns";
  world.space = {{-50, -50, 0}, {50, 50, 4}};
  world.obstacle_bounds = {{-50, -50}, {50, 50}};
  world.robots = {{0, {0, 0, 1}, {{{3, 0, 1}}}, 0.2}};
  for (const double y : {1.0, -2.0}) {
    WorldObstacle& column = world.obstacles.emplace_back();
    column.shape = {.kind = Shape::Kind::kColumn, .size = {0.5, 2.0, 0.0}};
    column.center = {2, y, 1};
    column.velocity_mps = {0.0, 0.01};
  }
  return world;
}

Eigen::Vector3d position_of(const obstacle_t& obstacle) {
  return Eigen::Vector3d(obstacle.position);
}

TEST(Sensor, SeesAllThereIsByDefault) {
  const World world = two_columns();
  Sensor sensor(world, 0);
  const obstacles_t seen = sensor.look(10.0, {0, 0, 1}, Eigen::Vector3d::Zero());
  ASSERT_EQ(seen.num_obstacles, 2);
  EXPECT_TRUE(seen.complete);
  EXPECT_TRUE(position_of(seen.obstacles[0]).isApprox(Eigen::Vector3d(2, 1.1, 1), 1e-12));
  EXPECT_EQ(seen.obstacles[0].velocity[1], 0.01);
  EXPECT_EQ(seen.obstacles[0].age_s, 0.0);
  EXPECT_EQ(seen.obstacles[0].position_sigma, 0.0f);
  EXPECT_EQ(sensor.look(10.0, {0, 20, 1}, Eigen::Vector3d::Zero()).num_obstacles, 0);  // out of reach
}

TEST(Sensor, ErrsAsMuchAsItSays) {
  World world = two_columns();
  world.sensor.position_m = 0.05;
  world.sensor.velocity_mps = 0.2;
  world.sensor.latency_ms = 100;
  Sensor sensor(world, 0);
  double position2 = 0.0, velocity2 = 0.0;
  constexpr int kLooks = 4000;
  for (int k = 0; k < kLooks; ++k) {
    const obstacles_t seen = sensor.look(10.1, {0, 0, 1}, {0, 0, 0.5});
    ASSERT_EQ(seen.num_obstacles, 2);
    EXPECT_TRUE(seen.complete);
    EXPECT_EQ(seen.obstacles[0].age_s, 0.1);
    EXPECT_EQ(seen.obstacles[0].position_sigma, 0.05f);
    EXPECT_EQ(seen.obstacles[0].velocity_sigma, 0.2f);
    position2 += (position_of(seen.obstacles[0]) - Eigen::Vector3d(2, 1.1, 1.5)).squaredNorm() / 3;
    velocity2 += (Eigen::Vector3d(seen.obstacles[0].velocity) - Eigen::Vector3d(0, 0.01, 0)).squaredNorm() / 3;
  }
  EXPECT_NEAR(std::sqrt(position2 / kLooks), 0.05, 0.003);
  EXPECT_NEAR(std::sqrt(velocity2 / kLooks), 0.2, 0.012);
}

TEST(Sensor, MissesAsManyAsItSays) {
  World world = two_columns();
  world.sensor.dropout = 0.3;
  Sensor sensor(world, 0);
  int seen = 0, both = 0;
  constexpr int kLooks = 4000;
  for (int k = 0; k < kLooks; ++k) {
    const obstacles_t report = sensor.look(0.05 * k, {0, 0, 1}, Eigen::Vector3d::Zero());
    EXPECT_FALSE(report.complete);
    seen += report.num_obstacles;
    both += report.num_obstacles == 2 ? 1 : 0;
  }
  EXPECT_NEAR(seen, 2 * 0.7 * kLooks, 0.03 * kLooks);
  EXPECT_NEAR(both, 0.49 * kLooks, 0.03 * kLooks);  // each for itself
}

TEST(Sensor, BurstsLastHalfASecond) {
  World world = two_columns();
  world.sensor.burst = 0.2;
  world.obstacles[0].velocity_mps.setZero();
  Sensor sensor(world, 0);
  int missing = 0, longest = 0, shortest = 1000, run = 0;
  constexpr int kLooks = 20'000;
  for (int k = 0; k < kLooks; ++k) {
    std::set<int> ids;
    for (const obstacle_t& obstacle : sensor.look(0.05 * k, {0, 0, 1}, Eigen::Vector3d::Zero()).obstacles)
      ids.insert(obstacle.id);
    if (ids.contains(0)) {
      if (run > 0) longest = std::max(longest, run), shortest = std::min(shortest, run);
      run = 0;
    } else {
      ++missing, ++run;
    }
  }
  EXPECT_NEAR(missing, 0.2 * kLooks, 0.03 * kLooks);
  EXPECT_GE(shortest, 10);
  EXPECT_GT(longest, 15);  // one after the other
}

TEST(Sensor, NothingThereIsSeenAsOftenAsItSays) {
  World world = two_columns();
  world.sensor.false_alarms = 1.5;
  Sensor sensor(world, 0);
  int seen = 0;
  std::set<int> ids;
  constexpr int kLooks = 2000;
  for (int k = 0; k < kLooks; ++k) {
    for (const obstacle_t& obstacle : sensor.look(0.05 * k, {0, 0, 1}, Eigen::Vector3d::Zero()).obstacles) {
      if (obstacle.id < 2) continue;
      EXPECT_TRUE(ids.insert(obstacle.id).second);
      EXPECT_LE(position_of(obstacle).head<2>().norm(), world.sensing_radius_m);
      ++seen;
    }
  }
  EXPECT_NEAR(seen, 1.5 * kLooks, 0.05 * kLooks);
}

// What a slow sensor says at the beginning was seen before it, when obstacles moved as well; the world stands only
// while the flight is waited for. Who comes into being with the flight is there.
TEST(Sensor, SeesWhatWasBeforeTheFlight) {
  World world = two_columns();
  world.sensor.latency_ms = 100;
  world.obstacles[0].velocity_mps = {0.0, 1.0};
  world.obstacles[1].track = {{0.0, {0.5, 0.5}}, {1.0, {1.5, 0.5}}};
  const double y = world.obstacles[0].center.y();
  for (const double t_s : {-1.0, 0.0, 0.05, 0.1, 0.3}) {
    SCOPED_TRACE(t_s);
    const obstacles_t seen = Sensor(world, 0).look(t_s, {0, 0, 1}, Eigen::Vector3d::Zero());
    ASSERT_EQ(seen.num_obstacles, 2);
    EXPECT_NEAR(seen.obstacles[0].position[1], t_s < 0.0 ? y : y + t_s - 0.1, 1e-12);
    EXPECT_EQ(seen.obstacles[0].velocity[1], t_s < 0.0 ? 0.0 : 1.0);
    EXPECT_NEAR(seen.obstacles[1].position[0], 0.5 + std::max(t_s - 0.1, 0.0), 1e-12);
    EXPECT_EQ(seen.obstacles[1].velocity[0], t_s < 0.0 ? 0.0 : 1.0);
  }
}

TEST(Sensor, ColumnsThatAreNearAreOneThatHoldsBoth) {
  World world = two_columns();
  world.sensor.merge_m = 0.5;
  EXPECT_EQ(Sensor(world, 0).look(0.0, {0, 0, 1}, Eigen::Vector3d::Zero()).num_obstacles, 2);
  world.obstacles[1].center.y() = 0.2;
  const obstacles_t seen = Sensor(world, 0).look(0.0, {0, 0, 1}, Eigen::Vector3d::Zero());
  ASSERT_EQ(seen.num_obstacles, 1);
  EXPECT_FALSE(seen.complete);
  EXPECT_NEAR(seen.obstacles[0].position[1], 0.6, 1e-12);
  EXPECT_NEAR(seen.obstacles[0].size[0], 1.3, 1e-12);
}

}  // namespace
}  // namespace swarm
