// The largest ellipsoid inside a polytope (inscribed_ellipsoid.cpp) against NLopt.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <nlopt.hpp>
#include <stdexcept>
#include <vector>

#include "planner_daemon/corridor/firi.h"
#include "tests/support/random_motion.h"

namespace swarm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kTight = 0.02;

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

TEST(InscribedEllipsoid, MatchesNloptWithinTheGap) {
  Rng rng(7);
  int compared = 0;
  for (int trial = 0; trial < 400; ++trial) {
    Vector3d inside;
    const Polytope polytope = random_polytope(rng, &inside);
    SCOPED_TRACE(testing::Message() << "trial " << trial << "\nnormals\n"
                                    << polytope.normals << "\noffsets " << polytope.offsets.transpose() << "\ninside "
                                    << inside.transpose());
    const double reference = nlopt_log_volume(polytope, inside);
    compared += std::isfinite(reference);
    for (const double gap : {kTight, 0.2, 1.0}) {
      Ellipsoid e;
      ASSERT_TRUE(inscribed_ellipsoid(polytope, inside, gap, &e));
      ASSERT_NO_FATAL_FAILURE(expect_inside(polytope, e));
      ASSERT_GE(std::log(e.shape.determinant()), reference - 0.5 * gap) << "gap " << gap;
    }
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
    ASSERT_TRUE(inscribed_ellipsoid(box, center + 0.7 * half, kTight, &e));
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
  ASSERT_TRUE(inscribed_ellipsoid(simplex, Vector3d(0.6, 0.05, 0.2), kTight, &e));
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
    EXPECT_FALSE(inscribed_ellipsoid(polytope, on_face + 0.01 * polytope.normals.row(0).transpose(), kTight, &e));
  }
  Ellipsoid e;
  EXPECT_FALSE(inscribed_ellipsoid(Polytope{}, Vector3d::Zero(), kTight, &e));
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
    ASSERT_TRUE(inscribed_ellipsoid(box, 0.3 * half, kTight, &e));
    expect_inside(box, e);
    if (thin >= 1e-6) {
      EXPECT_GT(e.shape.determinant(), 0.99 * half.prod()) << thin;
    }
  }
}

}  // namespace
}  // namespace swarm
