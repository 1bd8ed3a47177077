// Where rays end, against marching along them in small steps, and against every cube by itself.
#include "swarm_sim/environment/ray_caster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/random_motion.h"

namespace swarm {
namespace {

constexpr Shape::Kind kSolidKinds[] = {Shape::Kind::kColumn, Shape::Kind::kBox, Shape::Kind::kSphere,
                                       Shape::Kind::kRing};

Shape random_solid(Shape::Kind kind, Rng& rng) {
  Shape shape{.kind = kind, .size = in_box(rng, {0.1, 0.1, 0.1}, {2.0, 2.0, 2.0}), .yaw_rad = uniform(rng, -3.1, 3.1)};
  if (kind == Shape::Kind::kRing) shape.size.y() = uniform(rng, 0.02, 0.4);
  return shape;
}

std::string described(const Shape& shape, const Eigen::Vector3d& center, const Eigen::Vector3d& direction) {
  std::ostringstream out;
  out << "kind " << static_cast<int>(shape.kind) << " size " << shape.size.transpose() << " yaw " << shape.yaw_rad
      << " at " << center.transpose() << " along " << direction.transpose();
  return out.str();
}

// Either way.
Eigen::Vector3d along_axis(Rng& rng, int axis) {
  return Eigen::Vector3d::Unit(axis % 3) * (uniform_int(rng, 0, 1) == 0 ? -1.0 : 1.0);
}

// Rays that go near their shape, every eighth along an axis.
Eigen::Vector3d towards_it(Rng& rng, int i, const Eigen::Vector3d& center) {
  return i % 8 == 0 ? along_axis(rng, i / 8) : Eigen::Vector3d((center + in_cube(rng, 0.8)).normalized());
}

// What the ray passes is free, step by step, and where it ends the shape is.
void expect_first_contact(const Shape& shape, const Eigen::Vector3d& center, const Eigen::Vector3d& direction,
                          double range_m, double length) {
  constexpr double kStep_m = 1e-3, kExact = 1.5e-4;
  ASSERT_GE(length, 0.0);
  ASSERT_LE(length, range_m);
  for (double t = 0.0; t < length - 1e-9;) {
    const double free_m = distance(shape, t * direction - center);
    ASSERT_GT(free_m, 0.0) << "passes the shape at " << t << ", ends at " << length;
    t += std::max(free_m, kStep_m);
  }
  ASSERT_TRUE(length == range_m || distance(shape, length * direction - center) < kExact) << "ends at " << length;
}

TEST(RayLength, EndsWhereItFirstMeetsTheShape) {
  Rng rng(1);
  for (const Shape::Kind kind : kSolidKinds) {
    int met = 0, missed = 0;
    for (int i = 0; i < 4000; ++i) {
      const Shape shape = random_solid(kind, rng);
      Eigen::Vector3d center = in_cube(rng, 4.0);
      const Eigen::Vector3d direction = towards_it(rng, i, center);
      if (i % 8 == 0) center = uniform(rng, -4.0, 4.0) * direction + in_cube(rng, 0.8);
      const double range_m = uniform(rng, 1.0, 10.0);
      SCOPED_TRACE(described(shape, center, direction));
      const double length = ray_length(shape, center, direction, range_m);
      ASSERT_NO_FATAL_FAILURE(expect_first_contact(shape, center, direction, range_m, length));
      ++(length < range_m ? met : missed);
    }
    EXPECT_GT(met, 400) << static_cast<int>(kind);
    EXPECT_GT(missed, 500) << static_cast<int>(kind);
  }
}

TEST(RayLength, IsZeroFromInside) {
  Rng rng(2);
  for (const Shape::Kind kind : kSolidKinds) {
    for (int i = 0; i < 2000;) {
      const Shape shape = random_solid(kind, rng);
      const Eigen::Vector3d center = in_cube(rng, 1.0), way = direction(rng);
      if (distance(shape, -center) > 0.0) continue;
      EXPECT_EQ(ray_length(shape, center, way, 5.0), 0.0) << described(shape, center, way);
      ++i;
    }
  }
}

// Straight at it; away from it; and at it from further away than rays are long.
TEST(RayLength, KeepsTheRange) {
  const Eigen::Vector3d ahead = Eigen::Vector3d::UnitX();
  for (const Shape::Kind kind : kSolidKinds) {
    SCOPED_TRACE(static_cast<int>(kind));
    const Shape shape{.kind = kind, .size = {1.0, 0.5, 0.5}, .yaw_rad = std::numbers::pi / 2};
    const double near_m = kind == Shape::Kind::kBox ? 2.75 : kind == Shape::Kind::kRing ? 1.75 : 2.5;
    EXPECT_NEAR(ray_length(shape, {3, 0, 0}, ahead, 9.0), near_m, 1e-3);
    EXPECT_EQ(ray_length(shape, {-3, 0, 0}, ahead, 9.0), 9.0);
    EXPECT_EQ(ray_length(shape, {3, 0, 0}, ahead, near_m - 0.01), near_m - 0.01);
    EXPECT_EQ(ray_length(shape, {3, 2, 0}, ahead, 9.0), 9.0);
    EXPECT_EQ(ray_length(shape, {3, 0, 2}, ahead, 9.0), 9.0);
  }
  const Shape ring{.kind = Shape::Kind::kRing, .size = {1.0, 0.5, 0.0}};
  EXPECT_EQ(ray_length(ring, {3, 0.2, -0.2}, ahead, 9.0), 9.0) << "through its hole";
}

// Where within [0, max_m] a ray is in a cube, axis by axis.
double length_to_cube(const OccupiedCubes::Cube& cube, const Eigen::Vector3d& from, const Eigen::Vector3d& way,
                      double max_m) {
  double begin = 0.0, end = max_m;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = cube.center[axis] - cube.half_edge_m - from[axis], high = low + 2.0 * cube.half_edge_m;
    if (way[axis] == 0.0 && (low > 0.0 || high < 0.0)) return max_m;
    if (way[axis] == 0.0) continue;
    begin = std::max(begin, (way[axis] > 0.0 ? low : high) / way[axis]);
    end = std::min(end, (way[axis] > 0.0 ? high : low) / way[axis]);
  }
  return begin <= end ? begin : max_m;
}

OccupiedCubes random_cubes(Rng& rng, int count) {
  std::vector<OccupiedCubes::Cube> cubes;
  cubes.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) cubes.push_back({in_cube(rng, 3.0), uniform(rng, 0.02, 0.2)});
  return OccupiedCubes(std::move(cubes));
}

TEST(OccupiedCubes, RaysEndAtTheNearestCube) {
  Rng rng(3);
  int met = 0, inside = 0;
  for (const int count : {0, 1, 7, 9, 60, 400}) {
    const OccupiedCubes cubes = random_cubes(rng, count);
    for (int i = 0; i < 2000; ++i) {
      const bool begins_in_one = i % 10 == 0 && count > 0;
      const Eigen::Vector3d from =
          begins_in_one ? cubes.cubes()[static_cast<std::size_t>(i % count)].center : in_cube(rng, 4.0);
      Eigen::Vector3d way = direction(rng);
      if (i % 4 == 0 && count > 0)
        way = (cubes.cubes()[static_cast<std::size_t>(i / 4 % count)].center - from + in_cube(rng, 0.2)).normalized();
      if (i % 4 == 1) way = along_axis(rng, i / 4);
      if (i % 4 == 2) way[i / 4 % 3] = i % 8 == 2 ? 0.0 : -0.0, way.normalize();
      const double max_m = uniform(rng, 0.1, 8.0);
      double expected = max_m;
      for (const OccupiedCubes::Cube& cube : cubes.cubes())
        expected = std::min(expected, length_to_cube(cube, from, way, max_m));
      const double length = cubes.ray_length(from, way, max_m);
      ASSERT_NEAR(length, expected, 1e-9)
          << count << " cubes, from " << from.transpose() << " along " << way.transpose() << " up to " << max_m;
      met += length > 0.0 && length < max_m ? 1 : 0;
      inside += length == 0.0 ? 1 : 0;
    }
  }
  EXPECT_GT(met, 600);
  EXPECT_GT(inside, 500);
}

TEST(OccupiedCubes, RaysAlongAFaceMeetIt) {
  const OccupiedCubes cubes({{{1, 1, 1}, 0.5}});
  for (const double x : {0.5, 1.5}) {
    EXPECT_EQ(cubes.ray_length({x, -2, 1}, {0, 1, 0}, 9.0), 2.5);
    EXPECT_EQ(cubes.ray_length({x, 4, 1}, {-0.0, -1, 0}, 9.0), 2.5);
  }
  EXPECT_EQ(cubes.ray_length({0.499, -2, 1}, {0, 1, 0}, 9.0), 9.0);
}

// Some move, some are there for a time only.
World crowded_world(Rng& rng) {
  World world;
  world.obstacle_bounds = {{-6, -6}, {6, 6}};
  for (int i = 0; i < 12; ++i) {
    WorldObstacle& obstacle = world.obstacles.emplace_back();
    obstacle.shape = random_solid(kSolidKinds[i % 4], rng);
    obstacle.center = in_cube(rng, 4.0);
    if (i % 3 == 1) obstacle.velocity_mps = in_cube(rng, 1.0).head<2>();
    if (i % 3 == 2) obstacle.track = {{2.0, in_cube(rng, 4.0).head<2>()}, {6.0, in_cube(rng, 4.0).head<2>()}};
  }
  return world;
}

double least_length(const World& world, const OccupiedCubes* cubes, const std::vector<RayCaster::Ball>& balls,
                    double t_s, const Eigen::Vector3d& from, const Eigen::Vector3d& way, double range_m) {
  double least = cubes ? cubes->ray_length(from, way, range_m) : range_m;
  for (const WorldObstacle& obstacle : world.obstacles)
    if (const auto state = state_at(obstacle, world, t_s))
      least = std::min(least, ray_length(obstacle.shape, state->position - from, way, range_m));
  for (const RayCaster::Ball& ball : balls)
    least = std::min(least, ray_length({.kind = Shape::Kind::kSphere, .size = {2.0 * ball.radius_m, 0, 0}},
                                       ball.center - from, way, range_m));
  return least;
}

TEST(RayCaster, RaysEndAtTheNearestOfAllThereIs) {
  Rng rng(4);
  int met = 0, rays = 0;
  for (int i = 0; i < 60; ++i) {
    SCOPED_TRACE(testing::Message() << "world " << i);
    const World world = crowded_world(rng);
    const OccupiedCubes cubes = random_cubes(rng, 40);
    RayCaster with_map(world, &cubes), without(world, nullptr);
    for (const double t_s : {0.0, 3.0, 7.0}) {
      const Eigen::Vector3d from = in_cube(rng, 5.0);
      const double range_m = uniform(rng, 1.0, 12.0);
      std::vector<RayCaster::Ball> balls;
      balls.reserve(4);
      for (int k = 0; k < i % 4; ++k) balls.push_back({in_cube(rng, 4.0), uniform(rng, 0.1, 0.5)});
      with_map.look(t_s, from, range_m, balls);
      without.look(t_s, from, range_m, balls);
      for (int k = 0; k < 100; ++k) {
        const Eigen::Vector3d way = (in_cube(rng, 3.0) - from).normalized();
        ASSERT_NEAR(with_map.cast(way), least_length(world, &cubes, balls, t_s, from, way, range_m), 2e-4);
        const double length = without.cast(way);
        ASSERT_NEAR(length, least_length(world, nullptr, balls, t_s, from, way, range_m), 2e-4);
        met += length < range_m ? 1 : 0, ++rays;
      }
    }
  }
  EXPECT_GT(met, rays / 8);
}

// What there was is not there any more at the next look; before its start a world stands still.
TEST(RayCaster, LooksAnewEachTime) {
  World world;
  WorldObstacle& obstacle = world.obstacles.emplace_back();
  obstacle.shape = {.kind = Shape::Kind::kSphere, .size = {1.0, 0, 0}};
  obstacle.track = {{0.0, {5, 0}}, {2.0, {7, 0}}};
  RayCaster caster(world, nullptr);
  const Eigen::Vector3d ahead = Eigen::Vector3d::UnitX();
  caster.look(-1.0, {0, 0, 0}, 20.0, {{{3, 0, 0}, 0.25}});
  EXPECT_DOUBLE_EQ(caster.cast(ahead), 2.75);
  EXPECT_EQ(caster.cast(-ahead), 20.0);
  caster.look(-1.0, {0, 0, 0}, 20.0, {});
  EXPECT_DOUBLE_EQ(caster.cast(ahead), 4.5);
  caster.look(1.0, {-1, 0, 0}, 20.0, {});
  EXPECT_DOUBLE_EQ(caster.cast(ahead), 6.5);
  caster.look(1.0, {-1, 0, 0}, 6.0, {});
  EXPECT_EQ(caster.cast(ahead), 6.0);
  caster.look(3.0, {-1, 0, 0}, 20.0, {});
  EXPECT_EQ(caster.cast(ahead), 20.0);
}

}  // namespace
}  // namespace swarm
