// The polytopes of FIRI; its ellipsoid is in inscribed_ellipsoid_test.cpp. Long because every promise is checked on
// seeds of every rank, and once more for runs of points.
#include "planner_daemon/corridor/firi.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "tests/support/hull_distance.h"
#include "tests/support/random_motion.h"

namespace swarm {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

struct Scene {
  Matrix3Xd seed, obstacles;
  Vector3d lower, upper;
  FiriOptions options;

  void box_around(double margin) {
    lower = seed.rowwise().minCoeff().array() - margin;
    upper = seed.rowwise().maxCoeff().array() + margin;
  }
  std::string describe() const {
    std::ostringstream out;
    out.precision(17);
    out << "iterations " << options.iterations << ", half extent " << options.half_extent_m << "\nseed\n"
        << seed << "\nobstacles\n"
        << obstacles << "\nbox " << lower.transpose() << " .. " << upper.transpose();
    return out.str();
  }
};

std::vector<PointRun> runs_of(const Matrix3Xd& points) {
  std::vector<PointRun> runs;
  for (Eigen::Index i = 0; i < points.cols(); ++i) runs.push_back({points.col(i), 1});
  return runs;
}

// Seeds of every rank (a point, repeated points, collinear, coplanar, solid, a bent row of control points), obstacles
// random or on a grid.
Scene random_scene(Rng& rng) {
  Scene scene;
  const int count = std::uniform_int_distribution<int>(1, 6)(rng), rank = std::uniform_int_distribution<int>(0, 3)(rng);
  const Vector3d start = in_cube(rng, 2.0), along = direction(rng) * uniform(rng, 0.05, 0.8);
  const Matrix3d spread = [&] {
    Matrix3d m = Matrix3d::Zero();
    for (int k = 0; k < rank; ++k) m.col(k) = k == 0 ? along : Vector3d(direction(rng) * uniform(rng, 0.01, 0.4));
    return m;
  }();
  scene.seed.resize(3, count);
  for (int i = 0; i < count; ++i) scene.seed.col(i) = start + spread * in_cube(rng, 1.0);
  scene.box_around(uniform(rng, 0.3, 1.5));
  scene.options.iterations = std::uniform_int_distribution<int>(1, 3)(rng);
  scene.options.half_extent_m = uniform(rng, 0, 1) < 0.3 ? 0.0 : 0.05;
  const int obstacles =
      std::uniform_int_distribution<int>(0, 1)(rng) * std::uniform_int_distribution<int>(0, 300)(rng) +
      std::uniform_int_distribution<int>(0, 10)(rng);
  const bool grid = uniform(rng, 0, 1) < 0.5;
  scene.obstacles.resize(3, obstacles);
  for (int i = 0; i < obstacles; ++i) {
    Vector3d p = start + in_cube(rng, 1.5);
    if (uniform(rng, 0, 1) < 0.05) p = scene.seed.col(0) + in_cube(rng, 0.15);
    if (grid) p = ((p / 0.1).array().floor() + 0.5) * 0.1;
    scene.obstacles.col(i) = p;
  }
  return scene;
}

void expect_sound(const Scene& scene, const Polytope& polytope) {
  const Eigen::Index box_faces = 6;
  ASSERT_GE(polytope.normals.rows(), box_faces);
  ASSERT_EQ(polytope.normals.rows(), polytope.offsets.size());
  ASSERT_LT((polytope.normals.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-12);
  for (Eigen::Index i = 0; i < scene.seed.cols(); ++i) ASSERT_LE(polytope.violation(scene.seed.col(i)), 1e-9);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {1.0, -1.0}) {
      const double bound = sign > 0 ? scene.upper(axis) : -scene.lower(axis);
      bool found = false;
      for (int i = 0; i < polytope.num_faces(); ++i) {
        found |= polytope.normals.row(i) == sign * Vector3d::Unit(axis).transpose() && polytope.offsets(i) == bound;
      }
      ASSERT_TRUE(found) << "box face missing: axis " << axis << " sign " << sign;
    }
  }
}

// Least over the cube's points of the most violated face, over faces: > 0 when one face keeps the whole cube out.
double cube_clearance(const Polytope& polytope, const Vector3d& center, double half) {
  return (polytope.normals * center - polytope.offsets - half * polytope.normals.rowwise().lpNorm<1>()).maxCoeff();
}

TEST(Firi, KeepsTheSeedInsideAndEveryObstacleOutside) {
  Rng rng(1);
  Firi firi;
  int grown = 0, blocked = 0, near = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const Scene scene = random_scene(rng);
    SCOPED_TRACE(testing::Message() << "trial " << trial << "\n" << scene.describe());
    Polytope polytope;
    const FiriStatus status =
        firi.grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope);
    ASSERT_NO_FATAL_FAILURE(expect_sound(scene, polytope));
    const double half = scene.options.half_extent_m;
    double closest = INFINITY;
    for (Eigen::Index i = 0; i < scene.obstacles.cols(); ++i) {
      const Vector3d obstacle = scene.obstacles.col(i);
      const double distance = distance_to_hull(scene.seed, obstacle);
      closest = std::min(closest, distance);
      if (distance > 1e-7) {
        ASSERT_GE(polytope.violation(obstacle), -1e-9) << "obstacle " << obstacle.transpose();
      }
      if (distance > 1e-7 && distance <= std::sqrt(3.0) * half) ++near;
      if (distance > std::sqrt(3.0) * half + 1e-7) {
        ASSERT_GE(cube_clearance(polytope, obstacle, half), -1e-9) << "cube " << obstacle.transpose();
      }
    }
    if (closest > 1e-7) {
      ASSERT_EQ(status, FiriStatus::kGrown);
    }
    if (closest == 0.0) {
      ASSERT_EQ(status, FiriStatus::kSeedBlocked);
    }
    ++(status == FiriStatus::kGrown ? grown : blocked);
  }
  EXPECT_GT(grown, 1000);
  EXPECT_GT(blocked, 5);
  EXPECT_GT(near, 1000);
}

// Points that come as runs, as voxels do: every one of them is kept out as if it came alone.
TEST(Firi, ARunIsAllItsPoints) {
  Rng rng(9);
  Firi firi;
  int same = 0, trials = 0, long_runs = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    Scene scene = random_scene(rng);
    scene.options.spacing_m = 0.1;
    std::vector<PointRun> runs;
    std::vector<Vector3d> points;
    for (Eigen::Index i = 0; i < scene.obstacles.cols() / 4; ++i) {
      const PointRun run{scene.obstacles.col(i), uniform_int(rng, 1, 12)};
      for (int k = 0; k < run.count; ++k) points.push_back(run.first + Vector3d(0, 0, 0.1 * k));
      long_runs += run.count > 4;
      runs.push_back(run);
    }
    scene.obstacles.resize(3, static_cast<Eigen::Index>(points.size()));
    for (std::size_t i = 0; i < points.size(); ++i) scene.obstacles.col(static_cast<Eigen::Index>(i)) = points[i];
    SCOPED_TRACE(testing::Message() << "trial " << trial << "\n" << scene.describe());
    Polytope polytope, alone;
    const FiriStatus status = firi.grow(scene.seed, runs, scene.lower, scene.upper, scene.options, &polytope);
    const FiriStatus status_alone =
        firi.grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &alone);
    ASSERT_NO_FATAL_FAILURE(expect_sound(scene, polytope));
    const double half = scene.options.half_extent_m;
    bool blocked = false, clear = true;
    for (const Vector3d& point : points) {
      const double distance = distance_to_hull(scene.seed, point);
      blocked = blocked || distance == 0.0;
      clear = clear && distance > 1e-7;
      if (distance > 1e-7) {
        ASSERT_GE(polytope.violation(point), -1e-9) << point.transpose();
      }
      if (distance > std::sqrt(3.0) * half + 1e-7) {
        ASSERT_GE(cube_clearance(polytope, point, half), -1e-9);
      }
    }
    if (blocked || clear) {
      ASSERT_EQ(status, blocked ? FiriStatus::kSeedBlocked : FiriStatus::kGrown);
    }
    ++trials;
    same += status == status_alone && polytope.num_faces() == alone.num_faces() &&
            (polytope.normals - alone.normals).norm() < 1e-6;
  }
  EXPECT_GT(long_runs, 10'000);
  EXPECT_GT(same, trials * 9 / 10);  // but for the order of points equally near
}

// Each cube is put behind a random plane through the seed's extreme point, so it can be kept out, however narrowly.
TEST(Firi, KeepsOutEveryCubeThatCanBeSeparated) {
  Rng rng(2);
  Firi firi;
  for (int trial = 0; trial < 1500; ++trial) {
    Scene scene = random_scene(rng);
    scene.options.half_extent_m = 0.05;
    for (Eigen::Index i = 0; i < scene.obstacles.cols(); ++i) {
      const Vector3d n = direction(rng), in_plane = n.cross(direction(rng)) * uniform(rng, 0.0, 0.5);
      Eigen::Index extreme;
      (n.transpose() * scene.seed).maxCoeff(&extreme);
      const double gap = std::pow(10.0, uniform(rng, -6.0, 0.0));
      scene.obstacles.col(i) = scene.seed.col(extreme) + in_plane + n * (gap + 0.05 * n.lpNorm<1>());
    }
    SCOPED_TRACE(testing::Message() << "trial " << trial << "\n" << scene.describe());
    Polytope polytope;
    ASSERT_EQ(firi.grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope),
              FiriStatus::kGrown);
    ASSERT_NO_FATAL_FAILURE(expect_sound(scene, polytope));
    for (Eigen::Index i = 0; i < scene.obstacles.cols(); ++i) {
      ASSERT_GE(cube_clearance(polytope, scene.obstacles.col(i), 0.05), -1e-8) << scene.obstacles.col(i).transpose();
    }
  }
}

TEST(Firi, AnObstacleInTheSeedBlocksAndTheOthersAreStillExcluded) {
  Rng rng(3);
  Firi firi;
  for (int trial = 0; trial < 1000; ++trial) {
    Scene scene = random_scene(rng);
    Eigen::VectorXd weights(scene.seed.cols());
    for (double& weight : weights) weight = uniform(rng, 0.0, 1.0);
    scene.obstacles.conservativeResize(3, scene.obstacles.cols() + 1);
    scene.obstacles.rightCols<1>() = scene.seed * weights / weights.sum();
    SCOPED_TRACE(testing::Message() << "trial " << trial << "\n" << scene.describe());
    Polytope polytope;
    const FiriStatus status =
        firi.grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope);
    ASSERT_NO_FATAL_FAILURE(expect_sound(scene, polytope));
    for (Eigen::Index i = 0; i < scene.obstacles.cols(); ++i) {
      const Vector3d obstacle = scene.obstacles.col(i);
      if (distance_to_hull(scene.seed, obstacle) > 1e-7) {
        ASSERT_GE(polytope.violation(obstacle), -1e-9);
      }
    }
    // A point on the rim may still be touched by a face.
    if (polytope.violation(scene.obstacles.rightCols<1>()) < -1e-8) {
      ASSERT_EQ(status, FiriStatus::kSeedBlocked);
    }
  }
}

TEST(Firi, WithoutObstaclesGivesTheBox) {
  Firi firi;
  for (const int count : {1, 2, 5}) {
    Polytope polytope;
    const Matrix3Xd seed = Vector3d(0.2, -0.1, 1.0).replicate(1, count);
    ASSERT_EQ(firi.grow(seed, {}, Vector3d(-1, -2, 0), Vector3d(1, 2, 3), {}, &polytope), FiriStatus::kGrown);
    ASSERT_EQ(polytope.num_faces(), 6);
    EXPECT_DOUBLE_EQ(polytope.violation({1, 2, 3}), 0.0);
    EXPECT_DOUBLE_EQ(polytope.violation({-1, -2, 0}), 0.0);
    EXPECT_DOUBLE_EQ(polytope.violation({1.5, 0, 1}), 0.5);
  }
}

TEST(Firi, AWallBecomesOneFaceAtTheCubesSurface) {
  Scene scene;
  scene.seed.resize(3, 2);
  scene.seed << 0.0, 0.5, 0.0, 0.0, 1.0, 1.0;
  scene.box_around(1.2);
  scene.options.half_extent_m = 0.05;
  scene.obstacles.resize(3, 0);
  for (double x = -2.05; x < 2.5; x += 0.1) {
    for (double z = 0.05; z < 2.0; z += 0.1) {
      scene.obstacles.conservativeResize(3, scene.obstacles.cols() + 1);
      scene.obstacles.rightCols<1>() = Vector3d(x, 0.45, z);
    }
  }
  Polytope polytope;
  ASSERT_EQ(Firi().grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope),
            FiriStatus::kGrown);
  ASSERT_EQ(polytope.num_faces(), 7);
  EXPECT_LT((polytope.normals.row(6) - Eigen::RowVector3d(0, 1, 0)).norm(), 1e-9);
  EXPECT_NEAR(polytope.offsets(6), 0.4, 1e-9);
}

// A seed that grazes a wall, nearer than the cubes' surface: the face touches the seed, once for all voxels.
TEST(Firi, AWallTooNearIsKeptOutAsFarAsTheSeedAllows) {
  Scene scene;
  scene.seed.resize(3, 3);
  scene.seed << 0.0, 0.2, 0.5, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0;
  scene.box_around(1.2);
  scene.options.half_extent_m = 0.05;
  scene.obstacles.resize(3, 12);
  for (int i = 0; i < 12; ++i) scene.obstacles.col(i) = Vector3d(-0.3 + 0.1 * i, 0.02, 1.0);
  Polytope polytope;
  ASSERT_EQ(Firi().grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope),
            FiriStatus::kGrown);
  expect_sound(scene, polytope);
  for (Eigen::Index i = 0; i < 12; ++i) EXPECT_GE(polytope.violation(scene.obstacles.col(i)), 0.0199);
  EXPECT_LE(polytope.num_faces(), 10);
}

// A gap no wider than the seed: nothing to inflate, but the seed is still inside.
TEST(Firi, AFlatGapKeepsTheSeed) {
  Scene scene;
  scene.seed.resize(3, 2);
  scene.seed << 0.0, 0.4, 0.0, 0.0, 0.0, 0.0;
  scene.box_around(1.0);
  scene.options = {3, 0.05};
  scene.obstacles.resize(3, 2);
  scene.obstacles << 0.2, 0.2, 0.03, -0.03, 0.0, 0.0;
  Polytope polytope;
  ASSERT_EQ(Firi().grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope),
            FiriStatus::kGrown);
  expect_sound(scene, polytope);
  EXPECT_GT(polytope.violation({0.2, 0.001, 0.0}), 0.0);
  EXPECT_GT(polytope.violation({0.2, -0.001, 0.0}), 0.0);
}

// The second polytope contains the first one's ellipsoid wherever all cubes can be kept out.
TEST(Firi, TheSecondIterationGrowsTheVolume) {
  Rng rng(4);
  Firi firi;
  std::vector<double> ratios;
  for (int trial = 0; trial < 600; ++trial) {
    Scene scene = random_scene(rng);
    scene.options.log_volume_gap = 0.02;
    const double clear = std::sqrt(3.0) * scene.options.half_extent_m + 0.1;
    bool free = true;
    for (Eigen::Index i = 0; i < scene.obstacles.cols(); ++i) {
      free &= distance_to_hull(scene.seed, scene.obstacles.col(i)) > clear;
    }
    if (!free || scene.obstacles.cols() == 0) continue;
    SCOPED_TRACE(testing::Message() << "trial " << trial << "\n" << scene.describe());
    double volume[2];
    Ellipsoid ellipsoid;
    ellipsoid.center = scene.seed.rowwise().mean();
    for (const int iterations : {1, 2}) {
      scene.options.iterations = iterations;
      Polytope polytope;
      ASSERT_EQ(firi.grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope),
                FiriStatus::kGrown);
      ASSERT_TRUE(inscribed_ellipsoid(polytope, Vector3d(ellipsoid.center), scene.options.log_volume_gap, &ellipsoid));
      volume[iterations - 1] = ellipsoid.shape.determinant();
    }
    ratios.push_back(volume[1] / volume[0]);
    ASSERT_GE(ratios.back(), 0.98);
  }
  ASSERT_GT(ratios.size(), 100u);
  std::nth_element(ratios.begin(), ratios.begin() + static_cast<long>(ratios.size() / 2), ratios.end());
  EXPECT_GT(ratios[ratios.size() / 2], 1.0);
}

// Ellipsoids that are not quite the largest lead to polytopes as large.
TEST(Firi, ALooseEllipsoidCostsNoVolume) {
  Rng rng(9);
  Firi firi;
  std::array<double, 2> volume = {};  // with the loose ellipsoid and the largest; in volumes of the boxes, summed
  for (int trial = 0; trial < 300; ++trial) {
    Scene scene = random_scene(rng);
    scene.options.iterations = 2;
    std::array<Polytope, 2> polytopes;
    bool grown = true;
    for (Polytope& polytope : polytopes) {
      grown = grown && firi.grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options,
                                 &polytope) == FiriStatus::kGrown;
      scene.options.log_volume_gap = 0.01;
    }
    constexpr int kPoints = 2000;
    for (int i = 0; grown && i < kPoints; ++i) {
      const Vector3d point = in_box(rng, scene.lower, scene.upper);
      for (std::size_t k = 0; k < 2; ++k) volume[k] += (polytopes[k].violation(point) <= 0.0) / double{kPoints};
    }
  }
  EXPECT_GT(volume[1], 30.0);
  EXPECT_GT(volume[0], 0.99 * volume[1]);
}

TEST(Firi, RepeatsToTheLastBitAndForgetsEarlierCalls) {
  Rng rng(5);
  Firi used;
  for (int trial = 0; trial < 300; ++trial) {
    const Scene s = random_scene(rng);
    Polytope first, second;
    const FiriStatus status = used.grow(s.seed, runs_of(s.obstacles), s.lower, s.upper, s.options, &first);
    ASSERT_EQ(Firi().grow(s.seed, runs_of(s.obstacles), s.lower, s.upper, s.options, &second), status);
    ASSERT_TRUE(first.normals == second.normals && first.offsets == second.offsets) << s.describe();
  }
}

TEST(Firi, ThousandsOfObstacles) {
  Rng rng(6);
  Scene scene;
  scene.seed = Matrix3Xd::Zero(3, 1);
  scene.box_around(2.0);
  scene.options.half_extent_m = 0.05;
  scene.obstacles.resize(3, 20000);
  for (Eigen::Index i = 0; i < 20000; ++i) scene.obstacles.col(i) = direction(rng) * uniform(rng, 0.5, 3.0);
  Polytope polytope;
  ASSERT_EQ(Firi().grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope),
            FiriStatus::kGrown);
  expect_sound(scene, polytope);
  for (Eigen::Index i = 0; i < 20000; ++i) ASSERT_GE(cube_clearance(polytope, scene.obstacles.col(i), 0.05), -1e-9);
}

// Points of one sphere exclude each other's neighbours no farther than themselves: a face each.
TEST(Firi, MoreFacesThanAPolytopeHoldsAreSaidAndGiveNone) {
  Rng rng(7);
  Scene scene;
  scene.seed = Matrix3Xd::Zero(3, 1);
  scene.box_around(2.0);
  Polytope polytope;
  for (const int points : {Polytope::kMaxFaces - 6, Polytope::kMaxFaces - 5}) {
    scene.obstacles.resize(3, points);
    for (int i = 0; i < points; ++i) scene.obstacles.col(i) = direction(rng);
    scene.options.iterations = 1;
    const FiriStatus status =
        Firi().grow(scene.seed, runs_of(scene.obstacles), scene.lower, scene.upper, scene.options, &polytope);
    const bool fits = points + 6 <= Polytope::kMaxFaces;
    EXPECT_EQ(status, fits ? FiriStatus::kGrown : FiriStatus::kTooManyFaces);
    EXPECT_EQ(polytope.num_faces(), fits ? points + 6 : 0);
  }
}

TEST(Firi, RefusesBadArguments) {
  Firi firi;
  Polytope polytope;
  const Matrix3Xd none(3, 0), seed = Matrix3Xd::Zero(3, 1);
  const Vector3d one = Vector3d::Ones();
  const auto grow = [&](const Matrix3Xd& points, const FiriOptions& options) {
    return firi.grow(points, {}, -one, one, options, &polytope);
  };
  EXPECT_THROW((void)grow(none, {}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {0, 0.0}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {2, -0.1}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {2, NAN}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {2, 0.0, -0.1}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {2, 0.0, INFINITY}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {2, 0.0, 0.0, 0.0}), std::invalid_argument);
}

TEST(Firi, StatusesHaveNames) {
  EXPECT_STREQ(to_string(FiriStatus::kGrown), "grown");
  EXPECT_STREQ(to_string(FiriStatus::kSeedBlocked), "seed blocked");
}

}  // namespace
}  // namespace swarm
