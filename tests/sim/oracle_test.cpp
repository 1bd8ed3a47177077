#include "tests/bench/oracle.h"

#include <gtest/gtest.h>

namespace swarm {
namespace {

World world_with(const std::vector<WorldObstacle>& obstacles) {
  World world;
  world.robots = {{.id = 0, .start = {0, 0, 1}, .mission = {{{5, 0, 1}}}, .radius_m = 0.2},
                  {.id = 1, .start = {0, 7, 1}, .mission = {{{5, 7, 1}}}, .radius_m = 0.2}};
  world.obstacles = obstacles;
  return world;
}

WorldObstacle column(double x, double y, double diameter, double vx) {
  WorldObstacle obstacle;
  obstacle.shape = {.kind = Shape::Kind::kColumn, .size = {diameter, 4.0, 0.0}};
  obstacle.center = {x, y, 2.0};
  obstacle.velocity_mps = {vx, 0.0};
  return obstacle;
}

bool survives(const World& world, const Eigen::Vector3d& velocity, const Eigen::Vector3d& other = {0, 7, 1}) {
  Oracle oracle(world, 0, [other](std::size_t, double) { return other; });
  MotionState start;
  start.position = {0, 0, 1};
  start.velocity = velocity;
  return oracle.can_survive(0.0, 2.0, start);
}

TEST(OracleTest, EscapesWhereThereIsTimeAndRoom) {
  EXPECT_TRUE(survives(world_with({}), {2, 0, 0}));
  EXPECT_TRUE(survives(world_with({column(2.0, 0.0, 1.0, -1.0)}), {0, 0, 0}));
}

TEST(OracleTest, CannotBrakeInNoDistance) {
  // 2 m/s need 0.33 m to stop and 0.6 m aside far longer.
  EXPECT_FALSE(survives(world_with({column(0.95, 0.0, 1.0, 0.0)}), {2, 0, 0}));
  EXPECT_TRUE(survives(world_with({column(1.1, 0.0, 1.0, 0.0)}), {2, 0, 0}));
}

TEST(OracleTest, KnowsThatObstaclesTurnAndWhereOthersAre) {
  World world = world_with({column(1.0, 0.0, 1.0, 1.0)});
  world.obstacle_bounds = {{-8, -8}, {1.05, 8}};  // turns at once and comes back
  EXPECT_FALSE(survives(world, {2, 0, 0}));
  world.obstacle_bounds = {{-8, -8}, {8, 8}};
  EXPECT_TRUE(survives(world, {2, 0, 0}));
  EXPECT_FALSE(survives(world_with({}), {2, 0, 0}, {0.6, 0, 1}));  // into the other robot
}

}  // namespace
}  // namespace swarm
