#include "swarm_sim/environment/judge.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "swarm_sim/world/world_generator.h"

namespace swarm {
namespace {

constexpr double kStep_s = 0.01;

MotionState at(const Eigen::Vector3d& position, const Eigen::Vector3d& velocity = Eigen::Vector3d::Zero()) {
  MotionState state;
  state.position = position;
  state.velocity = velocity;
  return state;
}

// One robot of 0.2 m from the origin to (4, 0, 0) at 1 m/s, nothing else.
World one_robot() {
  World world;
  world.robots = {{5, {0, 0, 0}, {{{4, 0, 0}}}, 0.2}};
  return world;
}

WorldObstacle obstacle(Shape::Kind kind, const Eigen::Vector3d& size, const Eigen::Vector3d& center,
                       double yaw_rad = 0.0) {
  WorldObstacle o;
  o.shape.kind = kind;
  o.shape.size = size;
  o.shape.yaw_rad = yaw_rad;
  o.center = center;
  return o;
}

// Points all over the surface of a solid, relative to its centre, dense enough that one lies within `spacing` of every
// surface point.
std::vector<Eigen::Vector3d> surface(const Shape& shape, double spacing) {
  std::vector<Eigen::Vector3d> points;
  const auto steps = [&](double length) { return std::max(1, static_cast<int>(std::ceil(length / spacing))); };
  const auto circle = [&](double radius, auto&& add) {
    const int n = steps(2 * M_PI * radius);
    for (int i = 0; i < n; ++i) add(2 * M_PI * i / n);
  };
  if (shape.kind == Shape::Kind::kColumn) {
    const double r = 0.5 * shape.size.x(), h = shape.size.y();
    circle(r, [&](double a) {
      for (int k = 0, n = steps(h); k <= n; ++k)
        points.emplace_back(r * std::cos(a), r * std::sin(a), h * k / n - 0.5 * h);
      for (int k = 0, n = steps(r); k <= n; ++k) {
        for (const double z : {-0.5 * h, 0.5 * h})
          points.emplace_back(r * k / n * std::cos(a), r * k / n * std::sin(a), z);
      }
    });
  } else if (shape.kind ==
             Shape::Kind::kRing) {  // in the plane of the axis' normal and z, swept along the axis by the tube
    const Eigen::Vector3d axis(std::cos(shape.yaw_rad), std::sin(shape.yaw_rad), 0), side(-axis.y(), axis.x(), 0);
    circle(shape.size.x() + 0.5 * shape.size.y(), [&](double a) {
      const Eigen::Vector3d outwards = std::cos(a) * side + std::sin(a) * Eigen::Vector3d::UnitZ();
      circle(0.5 * shape.size.y(), [&](double b) {
        points.push_back(shape.size.x() * outwards +
                         0.5 * shape.size.y() * (std::cos(b) * outwards + std::sin(b) * axis));
      });
    });
  } else if (shape.kind == Shape::Kind::kBox) {
    const Eigen::AngleAxisd turn(shape.yaw_rad, Eigen::Vector3d::UnitZ());
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3, nu = steps(shape.size[u]), nv = steps(shape.size[v]);
      for (int i = 0; i <= nu; ++i) {
        for (int j = 0; j <= nv; ++j) {
          for (const double side : {-0.5, 0.5}) {
            Eigen::Vector3d p;
            p[axis] = side * shape.size[axis], p[u] = shape.size[u] * (1.0 * i / nu - 0.5),
            p[v] = shape.size[v] * (1.0 * j / nv - 0.5);
            points.push_back(turn * p);
          }
        }
      }
    }
  } else {
    const double r = 0.5 * shape.size.x();
    for (int k = 0, n = steps(M_PI * r); k <= n; ++k) {
      const double polar = M_PI * k / n;
      circle(r * std::sin(polar), [&](double a) {
        points.emplace_back(r * std::sin(polar) * std::cos(a), r * std::sin(polar) * std::sin(a), r * std::cos(polar));
      });
    }
  }
  return points;
}

TEST(Judge, ClearanceEqualsDenseSamplingOfEveryShape) {
  constexpr double kSpacing_m = 0.01;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const std::vector<Shape> shapes = {obstacle(Shape::Kind::kColumn, {0.8, 2, 0}, {0, 0, 0}).shape,
                                     obstacle(Shape::Kind::kRing, {1.0, 0.1, 0}, {0, 0, 0}, 0.7).shape,
                                     obstacle(Shape::Kind::kBox, {1, 0.5, 0.8}, {0, 0, 0}, 0.6).shape,
                                     obstacle(Shape::Kind::kSphere, {1.2, 0, 0}, {0, 0, 0}).shape};
  for (const Shape& shape : shapes) {
    const std::vector<Eigen::Vector3d> points = surface(shape, kSpacing_m);
    for (int trial = 0; trial < 20; ++trial) {
      World world = one_robot();
      world.obstacles.resize(1);
      world.obstacles[0].shape = shape;
      world.obstacles[0].center = {unit(random), unit(random), unit(random)};
      world.obstacles[0].velocity_mps = {unit(random), unit(random)};
      const double t_s = 20 * (1 + unit(random));
      const Eigen::Vector3d center = state_at(world.obstacles[0], world, t_s)->position;
      const Eigen::Vector3d offset(1.5 * unit(random), 1.5 * unit(random), 1.5 * unit(random));
      double nearest = 1e9;
      for (const Eigen::Vector3d& p : points) nearest = std::min(nearest, (offset - p).norm());
      Judge judge(world, nullptr);
      judge.update(t_s, std::vector{at(center + offset)});
      const Clearance& clearance = judge.robots()[0].to_obstacles;
      SCOPED_TRACE(testing::Message() << "shape " << static_cast<int>(shape.kind) << " offset " << offset.transpose());
      EXPECT_EQ(clearance.other, 0);
      EXPECT_EQ(clearance.t_s, t_s);
      // Inside, the exact distance is 0. Outside, the nearest sample is at most one spacing beside the nearest point.
      if (clearance.distance_m > -0.2 + 1e-12) {
        EXPECT_LE(clearance.distance_m + 0.2, nearest + 1e-12);
        EXPECT_GE(clearance.distance_m + 0.2, nearest - kSpacing_m);
      }
      EXPECT_EQ(judge.outcome() == Outcome::kCollision, clearance.distance_m < 0);
    }
  }
}

TEST(Judge, SurfacesThatJustTouchAreNoCollision) {
  struct Case {
    WorldObstacle obstacle;
    Eigen::Vector3d touching, inwards;
  };
  const std::vector<Case> cases = {
      {obstacle(Shape::Kind::kColumn, {0.8, 4, 0}, {1, 2, 2}), {1.6, 2, 1}, {-1, 0, 0}},
      {obstacle(Shape::Kind::kColumn, {0.8, 4, 0}, {1, 2, 2}), {1.1, 2, 4.2}, {0, 0, -1}},
      {obstacle(Shape::Kind::kRing, {1.5, 0.1, 0}, {0, 3, 1.2}), {0, 4.25, 1.2}, {0, 1, 0}},
      {obstacle(Shape::Kind::kRing, {1.5, 0.1, 0}, {0, 3, 1.2}), {0.25, 3, 2.7}, {-1, 0, 0}},
      {obstacle(Shape::Kind::kBox, {1, 0.5, 2}, {0, -3, 1}), {0, -3.45, 1}, {0, 1, 0}},
      {obstacle(Shape::Kind::kSphere, {0.5, 0, 0}, {2, -3, 1}), {2, -3, 1.45}, {0, 0, -1}},
  };
  for (const Case& c : cases) {
    World world = one_robot();
    world.obstacles = {c.obstacle};
    SCOPED_TRACE(testing::Message() << "shape " << static_cast<int>(c.obstacle.shape.kind) << " at "
                                    << c.touching.transpose());
    Judge judge(world, nullptr);
    judge.update(0.0, std::vector{at(c.touching)});
    EXPECT_NEAR(judge.robots()[0].to_obstacles.distance_m, 0.0, 1e-12);
    EXPECT_TRUE(judge.touches().empty());
    judge.update(0.01, std::vector{at(c.touching + 1e-6 * c.inwards)});
    ASSERT_EQ(judge.touches().size(), 1u);
    EXPECT_NEAR(judge.touches()[0].distance_m, -1e-6, 1e-9);
    EXPECT_EQ(judge.outcome(), Outcome::kCollision);
  }
}

TEST(Judge, RobotsTouchBelowTheSumOfRadii) {
  World world = one_robot();
  world.robots.push_back({9, {0, 2, 0}, {{{4, 2, 0}}}, 0.3});
  for (const auto& [gap, touches] : {std::pair{0.5, false}, {0.5 - 1e-6, true}, {0.5 + 1e-6, false}}) {
    Judge judge(world, nullptr);
    judge.update(0.0, std::vector{at({1, 1, 1}), at({1 + gap, 1, 1})});
    EXPECT_EQ(!judge.touches().empty(), touches) << gap;
    EXPECT_EQ(judge.robots()[0].to_robots.other, 9);
    EXPECT_EQ(judge.robots()[1].to_robots.other, 5);
    EXPECT_NEAR(judge.robots()[1].to_robots.distance_m, gap - 0.5, 1e-12);
  }
}

TEST(Judge, EveryPairIsToldOnceAtItsFirstTime) {
  World world = one_robot();
  world.robots.push_back({9, {0, 2, 0}, {{{4, 2, 0}}}, 0.2});
  world.obstacles = {obstacle(Shape::Kind::kSphere, {1, 0, 0}, {2, 0, 0}),
                     obstacle(Shape::Kind::kSphere, {1, 0, 0}, {0, 9, 0})};
  const OccupiedCubes static_map({{{3, 0, 0}, 0.1}});
  Judge judge(world, &static_map);
  for (int k = 0; k <= 400; ++k) {  // 1 m/s along x through sphere, cube; the other joins at the end
    const double x = k * kStep_s;
    judge.update(x, std::vector{at({x, 0, 0}, {1, 0, 0}), at({4, 2 - 0.5 * x, 0}, {0, -0.5, 0})});
  }
  ASSERT_EQ(judge.touches().size(), 3u);
  EXPECT_EQ(judge.touches()[0].counterpart, Counterpart::kObstacle);
  EXPECT_EQ(judge.touches()[0].other, 0);
  EXPECT_EQ(judge.touches()[0].robot, 5);
  EXPECT_NEAR(judge.touches()[0].t_s, 1.31, 1e-9);  // at 1.30 the surfaces just touch
  EXPECT_FALSE(judge.touches()[0].at_rest);
  EXPECT_EQ(judge.touches()[1].counterpart, Counterpart::kStaticMap);
  EXPECT_NEAR(judge.touches()[1].t_s, 2.71, 1e-9);
  EXPECT_EQ(judge.touches()[2],
            (Touch{judge.touches()[2].t_s, 5, Counterpart::kRobot, 9, judge.touches()[2].distance_m}));
  EXPECT_NEAR(judge.robots()[0].to_obstacles.distance_m, -0.2, 1e-12);
  EXPECT_NEAR(judge.robots()[0].to_static_map.distance_m, -0.2, 1e-12);
  EXPECT_NEAR(judge.robots()[0].to_static_map.t_s, 2.9, 1e-9) << "the first time inside the cube";
}

TEST(Judge, StaticClearanceIsTheMinimumOverTheFlight) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  std::vector<OccupiedCubes::Cube> cubes;
  for (int i = 0; i < 30; ++i) cubes.push_back({{2 * unit(random), 2 * unit(random), 2 * unit(random)}, 0.05});
  const OccupiedCubes static_map(cubes);
  const World world = one_robot();
  Judge judge(world, &static_map);
  judge.update(-1.0, std::vector{at({9, 0, 0})});
  EXPECT_TRUE(std::isinf(judge.robots()[0].to_static_map.distance_m)) << "further away than it looks";
  double least = Judge::kStaticReach_m;
  for (int k = 0; k < 300; ++k) {
    const Eigen::Vector3d p(3 * unit(random), 3 * unit(random), 3 * unit(random));
    judge.update(k * kStep_s, std::vector{at(p)});
    for (const auto& cube : cubes)
      least = std::min(least, ((p - cube.center).cwiseAbs().array() - cube.half_edge_m).max(0.0).matrix().norm() - 0.2);
    const double told = judge.robots()[0].to_static_map.distance_m;
    ASSERT_NEAR(std::min(told, Judge::kStaticReach_m), least, 1e-12) << "step " << k;
  }
}

TEST(Judge, TracksAreJudgedOnlyWhileTheyExist) {
  World world = one_robot();
  world.obstacles = {obstacle(Shape::Kind::kColumn, {0.5, 2, 0}, {0, 0, 1})};
  world.obstacles[0].track = {{1.0, {0, 0}}, {2.0, {0, 0}}};
  Judge judge(world, nullptr);
  judge.update(0.99, std::vector{at({0, 0, 0})});
  EXPECT_TRUE(judge.touches().empty());
  EXPECT_FALSE(std::isfinite(judge.robots()[0].to_obstacles.distance_m));
  judge.update(1.0, std::vector{at({0, 0, 0})});
  ASSERT_EQ(judge.touches().size(), 1u);
  EXPECT_TRUE(judge.touches()[0].at_rest);
}

TEST(Judge, ArrivalNeedsNearnessAndLowSpeed) {
  const World world = one_robot();
  const auto arrives = [&](double distance_m, double speed_mps) {
    Judge judge(world, nullptr);
    judge.update(0.0, std::vector{at({4, 0, distance_m}, {speed_mps, 0, 0})});
    return judge.robots()[0].flight_time_s.has_value();
  };
  EXPECT_TRUE(arrives(0.1, 0.19));
  EXPECT_TRUE(arrives(0.0, 0.0));
  EXPECT_FALSE(arrives(0.101, 0.0));
  EXPECT_FALSE(arrives(0.0, 0.2));
}

TEST(Judge, AMissionIsFlownInItsOrderAndWithItsWaits) {
  World world = one_robot();
  world.robots[0].mission = {{{1, 0, 0}, 0.2, 1.0, 500ms}, {{2, 0, 0}, 0.5}, {{4, 0, 0}}};
  const auto arrives = [&](double wait_s, double aside_m) {
    Judge judge(world, nullptr);
    double t_s = 0.0, x = 4.0;  // the last one first: that does not count
    const auto go = [&](double to, double y, double rest_s) {
      for (x = to, rest_s += t_s; t_s < rest_s; t_s += kStep_s) judge.update(t_s, std::vector{at({x, y, 0})});
    };
    for (const double to : {4.0, 2.0}) go(to, 0.0, 0.1);
    EXPECT_EQ(judge.robots()[0].goals_reached, 0);
    go(1.19, 0.0, wait_s);
    go(2.0, aside_m, 0.1);
    EXPECT_EQ(judge.outcome(), Outcome::kTimeout);
    go(4.0, 0.0, 0.1);
    return judge.robots()[0].flight_time_s.has_value();
  };
  EXPECT_TRUE(arrives(0.52, 0.49));
  EXPECT_FALSE(arrives(0.48, 0.49));
  EXPECT_FALSE(arrives(0.52, 0.51));
}

TEST(Judge, WaitingAtAGoalIsNoDeadlock) {
  World world = one_robot();
  world.robots[0].mission = {{{0, 0, 0}, 0.1, 1.0, 60s}, {{4, 0, 0}}};
  Judge judge(world, nullptr, 10.0);
  for (int k = 0; !judge.finished(); ++k) judge.update(k * kStep_s, std::vector{at({0, 0, 0})});
  EXPECT_EQ(judge.outcome(), Outcome::kTimeout);
}

TEST(Judge, FirstArrivalCountsAndTheFlightEndsTwoSecondsAfterTheLast) {
  World world = one_robot();
  world.robots.push_back({9, {0, 2, 0}, {{{4, 2, 0}}}, 0.2});
  Judge judge(world, nullptr);
  int k = 0;
  for (; !judge.finished(); ++k) {
    const double t = k * kStep_s;
    const bool away = t > 1.5;  // robot 5 arrives at 1 s and later steps aside
    judge.update(t, std::vector{t < 1.0 ? at({0, 0, 0}) : at({4, 0, away ? 1.0 : 0.0}),
                                t < 3.0 ? at({0, 2, 0}) : at({4, 2, 0})});
    ASSERT_LT(k, 10000);
  }
  EXPECT_NEAR(*judge.robots()[0].flight_time_s, 1.0, 1e-9);
  EXPECT_NEAR(*judge.robots()[1].flight_time_s, 3.0, 1e-9);
  EXPECT_EQ(k - 1, 500);
  EXPECT_EQ(judge.outcome(), Outcome::kSuccess);
}

Outcome outcome_at_limit(double rest_from_s, double speed_before, bool arrived_one) {
  World world = one_robot();
  if (arrived_one) world.robots.push_back({9, {0, 2, 0}, {{{4, 2, 0}}}, 0.2});
  Judge judge(world, nullptr, 10.0);
  double x = 0.0;
  for (int k = 0; !judge.finished(); ++k) {
    const double t = k * kStep_s, speed = t < rest_from_s ? speed_before : 0.05;
    std::vector<MotionState> robots = {at({x, 0, 0}, {speed, 0, 0})};
    if (arrived_one) robots.push_back(at({4, 2, 0}));
    judge.update(t, robots);
    x -= speed * kStep_s;
    EXPECT_LE(k, 1000);
  }
  return judge.outcome();
}

TEST(Judge, WhoIsToldWhereToGoNeverArrivesAndTheFlightGoesOn) {
  World world = one_robot();
  world.robots.push_back({6, {0, 3, 0}, {{{0, 3, 0}}}, 0.2});
  world.robots[1].is_told = true;
  Judge judge(world, nullptr, 30.0);
  for (int i = 0; i <= 2900; ++i) {
    const double x = std::min(4.0, i * kStep_s);
    const MotionState states[] = {at({x, 0, 0}, {x < 4.0 ? 1.0 : 0.0, 0, 0}), at({0, 3, 0})};
    judge.update(i * kStep_s, states);
    ASSERT_FALSE(judge.finished());
    ASSERT_EQ(judge.outcome() == Outcome::kSuccess, x == 4.0) << i;
  }
  EXPECT_TRUE(judge.robots()[0].flight_time_s);
  EXPECT_FALSE(judge.robots()[1].flight_time_s);
  const MotionState last[] = {at({4, 0, 0}), at({0, 3, 0})};
  judge.update(30.0, last);
  EXPECT_TRUE(judge.finished());
}

TEST(Judge, RestBeforeTheLimitIsDeadlockAndMotionIsTimeout) {
  EXPECT_EQ(outcome_at_limit(6.9, 1.0, false), Outcome::kDeadlock);
  EXPECT_EQ(outcome_at_limit(7.1, 1.0, false), Outcome::kTimeout);
  EXPECT_EQ(outcome_at_limit(0.0, 1.0, false), Outcome::kDeadlock);
  EXPECT_EQ(outcome_at_limit(20.0, 0.1, false), Outcome::kTimeout);
  EXPECT_EQ(outcome_at_limit(20.0, 0.099, false), Outcome::kDeadlock);
  EXPECT_EQ(outcome_at_limit(20.0, 1.0, true), Outcome::kTimeout) << "who has arrived may rest";
}

TEST(Judge, FollowsPathAndMaxima) {
  const World world = one_robot();
  Judge judge(world, nullptr);
  for (int k = 0; k <= 100; ++k) {  // a quarter turn of radius 1 around (0, 0) in 1 s
    const double a = 0.5 * M_PI * k / 100, w = 0.5 * M_PI;
    MotionState state = at({std::cos(a), std::sin(a), 0}, {-w * std::sin(a), w * std::cos(a), 0});
    state.acceleration = -w * w * state.position;
    judge.update(k * kStep_s, std::vector{state});
  }
  const RobotVerdict& verdict = judge.robots()[0];
  EXPECT_NEAR(verdict.path_length_m, 0.5 * M_PI, 1e-3);
  EXPECT_NEAR(verdict.max_speed_mps.x(), 0.5 * M_PI, 1e-12);
  EXPECT_NEAR(verdict.max_speed_mps.y(), 0.5 * M_PI, 1e-12);
  EXPECT_NEAR(verdict.max_acceleration_mps2.x(), 0.25 * M_PI * M_PI, 1e-12);
  EXPECT_EQ(verdict.max_acceleration_mps2.z(), 0.0);
}

TEST(Judge, RefusesWhatIsNoFlight) {
  const World world = one_robot();
  EXPECT_THROW(Judge(world, nullptr, 0.0), std::invalid_argument);
  Judge judge(world, nullptr);
  EXPECT_THROW(judge.update(0.0, std::vector<MotionState>{}), std::invalid_argument);
  EXPECT_THROW(judge.update(0.0, std::vector{at({NAN, 0, 0})}), std::invalid_argument);
  judge.update(0.0, std::vector{at({0, 0, 0})});
  EXPECT_THROW(judge.update(0.0, std::vector{at({0, 0, 0})}), std::invalid_argument);
}

}  // namespace
}  // namespace swarm
