// Long because it judges two sources of one header, the polytopes and the inscribed ellipsoid, each by its own oracle.
#include "planner_daemon/firi.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <nlopt.hpp>
#include <random>
#include <sstream>
#include <stdexcept>
#include <vector>

namespace swarm {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Rng = std::mt19937_64;

double uniform(Rng& rng, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(rng);
}
Vector3d in_cube(Rng& rng, double half) {
  const double x = uniform(rng, -half, half), y = uniform(rng, -half, half), z = uniform(rng, -half, half);
  return {x, y, z};
}
Vector3d direction(Rng& rng) {
  std::normal_distribution<double> normal;
  const double x = normal(rng), y = normal(rng), z = normal(rng);
  return Vector3d(x, y, z).normalized();
}

// Distance of `p` to the hull of `points`: the least over all their vertices, edges and triangles, none in a
// tetrahedron.
double distance_to_hull(const Vector3d& p, const Matrix3Xd& points) {
  const int n = static_cast<int>(points.cols());
  double least = INFINITY;
  for (int a = 0; a < n; ++a) {
    const Vector3d A = points.col(a) - p;
    least = std::min(least, A.norm());
    for (int b = a + 1; b < n; ++b) {
      const Vector3d B = points.col(b) - p, ab = B - A;
      if (ab.norm() > 0) least = std::min(least, (A + std::clamp(-A.dot(ab) / ab.squaredNorm(), 0.0, 1.0) * ab).norm());
      for (int c = b + 1; c < n; ++c) {
        const Vector3d C = points.col(c) - p, cross = ab.cross(C - A);
        if (cross.norm() > 1e-12) {
          const Vector3d normal = cross.normalized(), foot = normal * normal.dot(A);
          const double u = (B - foot).cross(C - foot).dot(normal), v = (C - foot).cross(A - foot).dot(normal),
                       w = (A - foot).cross(B - foot).dot(normal);
          if (u >= 0 && v >= 0 && w >= 0) least = std::min(least, foot.norm());
        }
        for (int d = c + 1; d < n; ++d) {
          const Vector3d D = points.col(d) - p;
          const double volume = (B - A).cross(C - A).dot(D - A);
          if (std::abs(volume) < 1e-12) continue;
          const double parts[4] = {B.cross(C).dot(D), -A.cross(C).dot(D), A.cross(B).dot(D), -A.cross(B).dot(C)};
          if (std::all_of(parts, parts + 4, [&](double part) { return part / volume >= 0; })) return 0.0;
        }
      }
    }
  }
  return least;
}

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
        firi.grow(scene.seed, scene.obstacles, scene.lower, scene.upper, scene.options, &polytope);
    ASSERT_NO_FATAL_FAILURE(expect_sound(scene, polytope));
    const double half = scene.options.half_extent_m;
    double closest = INFINITY;
    for (Eigen::Index i = 0; i < scene.obstacles.cols(); ++i) {
      const Vector3d obstacle = scene.obstacles.col(i);
      const double distance = distance_to_hull(obstacle, scene.seed);
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
    ASSERT_EQ(firi.grow(scene.seed, scene.obstacles, scene.lower, scene.upper, scene.options, &polytope),
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
        firi.grow(scene.seed, scene.obstacles, scene.lower, scene.upper, scene.options, &polytope);
    ASSERT_NO_FATAL_FAILURE(expect_sound(scene, polytope));
    for (Eigen::Index i = 0; i < scene.obstacles.cols(); ++i) {
      const Vector3d obstacle = scene.obstacles.col(i);
      if (distance_to_hull(obstacle, scene.seed) > 1e-7) {
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
  const Matrix3Xd none(3, 0);
  for (const int count : {1, 2, 5}) {
    Polytope polytope;
    const Matrix3Xd seed = Vector3d(0.2, -0.1, 1.0).replicate(1, count);
    ASSERT_EQ(firi.grow(seed, none, Vector3d(-1, -2, 0), Vector3d(1, 2, 3), {}, &polytope), FiriStatus::kGrown);
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
  ASSERT_EQ(Firi().grow(scene.seed, scene.obstacles, scene.lower, scene.upper, scene.options, &polytope),
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
  ASSERT_EQ(Firi().grow(scene.seed, scene.obstacles, scene.lower, scene.upper, scene.options, &polytope),
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
  ASSERT_EQ(Firi().grow(scene.seed, scene.obstacles, scene.lower, scene.upper, scene.options, &polytope),
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
    const double clear = std::sqrt(3.0) * scene.options.half_extent_m + 0.1;
    bool free = true;
    for (Eigen::Index i = 0; i < scene.obstacles.cols(); ++i) {
      free &= distance_to_hull(scene.obstacles.col(i), scene.seed) > clear;
    }
    if (!free || scene.obstacles.cols() == 0) continue;
    SCOPED_TRACE(testing::Message() << "trial " << trial << "\n" << scene.describe());
    double volume[2];
    Ellipsoid ellipsoid;
    ellipsoid.center = scene.seed.rowwise().mean();
    for (const int iterations : {1, 2}) {
      scene.options.iterations = iterations;
      Polytope polytope;
      ASSERT_EQ(firi.grow(scene.seed, scene.obstacles, scene.lower, scene.upper, scene.options, &polytope),
                FiriStatus::kGrown);
      ASSERT_TRUE(inscribed_ellipsoid(polytope, Vector3d(ellipsoid.center), &ellipsoid));
      volume[iterations - 1] = ellipsoid.shape.determinant();
    }
    ratios.push_back(volume[1] / volume[0]);
    ASSERT_GE(ratios.back(), 0.98);
  }
  ASSERT_GT(ratios.size(), 100u);
  std::nth_element(ratios.begin(), ratios.begin() + static_cast<long>(ratios.size() / 2), ratios.end());
  EXPECT_GT(ratios[ratios.size() / 2], 1.0);
}

TEST(Firi, RepeatsToTheLastBitAndForgetsEarlierCalls) {
  Rng rng(5);
  Firi used;
  for (int trial = 0; trial < 300; ++trial) {
    const Scene s = random_scene(rng);
    Polytope first, second;
    const FiriStatus status = used.grow(s.seed, s.obstacles, s.lower, s.upper, s.options, &first);
    ASSERT_EQ(Firi().grow(s.seed, s.obstacles, s.lower, s.upper, s.options, &second), status);
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
  ASSERT_EQ(Firi().grow(scene.seed, scene.obstacles, scene.lower, scene.upper, scene.options, &polytope),
            FiriStatus::kGrown);
  expect_sound(scene, polytope);
  for (Eigen::Index i = 0; i < 20000; ++i) ASSERT_GE(cube_clearance(polytope, scene.obstacles.col(i), 0.05), -1e-9);
}

TEST(Firi, RefusesBadArguments) {
  Firi firi;
  Polytope polytope;
  const Matrix3Xd none(3, 0), seed = Matrix3Xd::Zero(3, 1);
  const Vector3d one = Vector3d::Ones();
  const auto grow = [&](const Matrix3Xd& points, const FiriOptions& options) {
    return firi.grow(points, none, -one, one, options, &polytope);
  };
  EXPECT_THROW((void)grow(none, {}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {0, 0.0}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {2, -0.1}), std::invalid_argument);
  EXPECT_THROW((void)grow(seed, {2, NAN}), std::invalid_argument);
}

TEST(Firi, StatusesHaveNames) {
  EXPECT_STREQ(to_string(FiriStatus::kGrown), "grown");
  EXPECT_STREQ(to_string(FiriStatus::kSeedBlocked), "seed blocked");
}

// ---- inscribed ellipsoid

// The unit box, its faces, and random tangent planes of a ball around the origin, all moved by a random affine map.
Polytope random_polytope(Rng& rng, Vector3d* inside) {
  const int cuts = std::uniform_int_distribution<int>(0, 24)(rng);
  Polytope polytope;
  polytope.normals.resize(6 + cuts, 3);
  polytope.normals << Matrix3d::Identity(), -Matrix3d::Identity(), Eigen::MatrixXd::Zero(cuts, 3);
  polytope.offsets.setOnes(6 + cuts);
  for (int i = 6; i < 6 + cuts; ++i) {
    polytope.normals.row(i) = direction(rng);
    polytope.offsets(i) = uniform(rng, 0.2, 1.5);
  }
  const Matrix3d map = Eigen::AngleAxisd(uniform(rng, 0, 3), direction(rng)) *
                       Eigen::Scaling(uniform(rng, 0.1, 2), uniform(rng, 0.1, 2), uniform(rng, 0.1, 2)) *
                       Eigen::AngleAxisd(uniform(rng, 0, 3), direction(rng)).toRotationMatrix();
  const Vector3d shift = in_cube(rng, 5.0);
  polytope.normals *= map.inverse();
  polytope.offsets += polytope.normals * shift;
  const Eigen::VectorXd lengths = polytope.normals.rowwise().norm();
  polytope.normals.array().colwise() /= lengths.array();
  polytope.offsets.array() /= lengths.array();
  *inside = map * (uniform(rng, 0.0, 0.1999) * direction(rng)) + shift;
  return polytope;
}

void expect_inside(const Polytope& polytope, const Ellipsoid& e) {
  ASSERT_EQ(e.shape, e.shape.transpose());
  ASSERT_GT(Eigen::SelfAdjointEigenSolver<Matrix3d>(e.shape).eigenvalues().minCoeff(), 0.0);
  for (int i = 0; i < polytope.num_faces(); ++i) {
    const Vector3d n = polytope.normals.row(i);
    ASSERT_LE(n.dot(e.center) + (e.shape * n).norm(), polytope.offsets(i) + 1e-12) << "face " << i;
  }
}

// The same problem by NLopt's SLSQP over (L, d), shape L L' (L lower triangular): largest log det, from `inside` in the
// unit of its ball.
double nlopt_log_volume(const Polytope& polytope, const Vector3d& inside) {
  struct Problem {
    const Polytope* polytope;
    static Matrix3d lower(const double* y) {
      Matrix3d L;
      L << y[0], 0, 0, y[1], y[2], 0, y[3], y[4], y[5];
      return L;
    }
    static double objective(unsigned, const double* y, double* gradient, void*) {
      if (gradient != nullptr) {
        std::fill(gradient, gradient + 9, 0.0);
        for (const int k : {0, 2, 5}) gradient[k] = -1.0 / y[k];
      }
      return -std::log(y[0]) - std::log(y[2]) - std::log(y[5]);
    }
    static void faces(unsigned m, double* result, unsigned, const double* y, double* gradient, void* data) {
      const Polytope& p = *static_cast<Problem*>(data)->polytope;
      const Vector3d d(y[6], y[7], y[8]);
      for (unsigned i = 0; i < m; ++i) {
        const Vector3d n = p.normals.row(i), w = lower(y).transpose() * n;
        result[i] = w.norm() + n.dot(d) - p.offsets(i);
        if (gradient == nullptr) continue;
        const Vector3d v = w.normalized();
        const double row[9] = {v(0) * n(0), v(0) * n(1), v(1) * n(1), v(0) * n(2), v(1) * n(2),
                               v(2) * n(2), n(0),        n(1),        n(2)};
        std::copy(row, row + 9, gradient + 9 * i);
      }
    }
  } problem{&polytope};
  const double radius = 0.5 * -polytope.violation(inside);
  std::vector<double> y = {radius, 0, radius, 0, 0, radius, inside.x(), inside.y(), inside.z()};
  nlopt::opt solver(nlopt::LD_SLSQP, 9);
  std::vector<double> least(9, -HUGE_VAL);
  for (const int k : {0, 2, 5}) least[k] = 1e-4;
  solver.set_lower_bounds(least);
  solver.set_min_objective(&Problem::objective, nullptr);
  solver.add_inequality_mconstraint(&Problem::faces, &problem, std::vector<double>(polytope.num_faces(), 1e-9));
  solver.set_xtol_rel(1e-8);
  solver.set_maxeval(2000);
  double value = 0.0;
  try {
    solver.optimize(y, value);
  } catch (const std::runtime_error&) {  // as near as it gets: judged by its constraints below
  }
  std::vector<double> violations(polytope.num_faces());
  Problem::faces(static_cast<unsigned>(violations.size()), violations.data(), 9, y.data(), nullptr, &problem);
  const bool feasible = *std::max_element(violations.begin(), violations.end()) < 1e-6;
  return feasible ? -Problem::objective(9, y.data(), nullptr, nullptr) : -INFINITY;
}

TEST(InscribedEllipsoid, MatchesNloptWithinAPercent) {
  Rng rng(7);
  int compared = 0;
  for (int trial = 0; trial < 400; ++trial) {
    Vector3d inside;
    const Polytope polytope = random_polytope(rng, &inside);
    SCOPED_TRACE(testing::Message() << "trial " << trial << "\nnormals\n"
                                    << polytope.normals << "\noffsets " << polytope.offsets.transpose() << "\ninside "
                                    << inside.transpose());
    Ellipsoid e;
    ASSERT_TRUE(inscribed_ellipsoid(polytope, inside, &e));
    ASSERT_NO_FATAL_FAILURE(expect_inside(polytope, e));
    const double reference = nlopt_log_volume(polytope, inside);
    compared += std::isfinite(reference);
    ASSERT_GE(std::log(e.shape.determinant()), reference - 0.01);
  }
  EXPECT_GT(compared, 350);
}

TEST(InscribedEllipsoid, KnownAnswers) {
  Polytope box;
  box.normals.resize(6, 3);
  box.normals << Matrix3d::Identity(), -Matrix3d::Identity();
  for (const Vector3d& half : {Vector3d(1, 1, 1), Vector3d(0.01, 1, 30), Vector3d(2, 0.5, 2)}) {
    const Vector3d center(3, -1, 2);
    box.offsets.resize(6);
    box.offsets << half + center, half - center;
    Ellipsoid e;
    ASSERT_TRUE(inscribed_ellipsoid(box, center + 0.7 * half, &e));
    expect_inside(box, e);
    EXPECT_GT(e.shape.determinant(), 0.99 * half.prod());
    EXPECT_LT(((e.center - center).array() / half.array()).abs().maxCoeff(), 0.05);
  }
  // The simplex x, y, z >= 0, x + y + z <= 1: its Steiner inellipsoid has the fraction pi / (6 sqrt 3) of its volume
  // 1/6.
  Polytope simplex;
  simplex.normals.resize(4, 3);
  simplex.normals << -Matrix3d::Identity(), Eigen::RowVector3d::Constant(1.0 / std::sqrt(3.0));
  simplex.offsets.resize(4);
  simplex.offsets << Vector3d::Zero(), 1.0 / std::sqrt(3.0);
  Ellipsoid e;
  ASSERT_TRUE(inscribed_ellipsoid(simplex, Vector3d(0.6, 0.05, 0.2), &e));
  expect_inside(simplex, e);
  const double exact = 1.0 / (48.0 * std::sqrt(3.0));  // det B
  EXPECT_NEAR(e.shape.determinant() / exact, 1.0, 0.01);
  EXPECT_LT((e.center - Vector3d::Constant(0.25)).norm(), 0.01);
}

TEST(InscribedEllipsoid, RefusesAPointNotInside) {
  Rng rng(8);
  for (int trial = 0; trial < 50; ++trial) {
    Vector3d inside;
    const Polytope polytope = random_polytope(rng, &inside);
    const Vector3d on_face = inside + polytope.normals.row(0).transpose() *
                                          (polytope.offsets(0) - polytope.normals.row(0).dot(inside.transpose()));
    Ellipsoid e;
    EXPECT_FALSE(inscribed_ellipsoid(polytope, on_face + 0.01 * polytope.normals.row(0).transpose(), &e));
  }
  Ellipsoid e;
  EXPECT_FALSE(inscribed_ellipsoid(Polytope{}, Vector3d::Zero(), &e));
}

// Slivers strain the arithmetic; the ellipsoid must be inside all the same.
TEST(InscribedEllipsoid, StaysInsideSlivers) {
  Polytope box;
  box.normals.resize(6, 3);
  box.normals << Matrix3d::Identity(), -Matrix3d::Identity();
  for (const double thin : {1e-2, 1e-4, 1e-6, 1e-9}) {
    const Vector3d half(thin, 1.0, 2.0);
    box.offsets.resize(6);
    box.offsets << half, half;
    Ellipsoid e;
    ASSERT_TRUE(inscribed_ellipsoid(box, 0.3 * half, &e));
    expect_inside(box, e);
    if (thin >= 1e-6) {
      EXPECT_GT(e.shape.determinant(), 0.99 * half.prod()) << thin;
    }
  }
}

}  // namespace
}  // namespace swarm
