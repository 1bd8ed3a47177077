// Long because the model of the curve, the KKT conditions, Farkas certificates and SLSQP that judge the solver are
// written here a second time, on purpose without its code.
#include "planner_daemon/optimize/spline_qp.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlopt.hpp>
#include <random>
#include <stdexcept>
#include <utility>

#include "tests/support/qp_problems.h"

namespace swarm {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// One axis as matrices over x = (first position, first velocity, acceleration control points): the oracle of all tests.
// C2 by construction; jerk holds samples weighted such that |jerk * x|^2 is the jerk integral by Simpson's rule.
struct AxisModel {
  AxisModel(int curve_degree, const std::vector<double>& durations)
      : degree(curve_degree), pieces(static_cast<int>(durations.size())), size(pieces * (degree - 2) + 3) {
    const int n = degree;
    position = MatrixXd::Zero(pieces * (n + 1), size);
    velocity = MatrixXd::Zero(pieces * n, size);
    acceleration = MatrixXd::Zero(pieces * (n - 1), size);
    jerk_points = MatrixXd::Zero(pieces * (n - 2), size);
    jerk = MatrixXd::Zero(pieces * (kIntervals + 1), size);
    Eigen::RowVectorXd p = Eigen::RowVectorXd::Unit(size, 0), v = Eigen::RowVectorXd::Unit(size, 1);
    for (int k = 0; k < pieces; ++k) {
      const double h = durations[k];
      for (int j = 0; j < n - 1; ++j) acceleration(k * (n - 1) + j, 2 + k * (n - 2) + j) = 1.0;
      for (int j = 0; j < n; ++j) {
        velocity.row(k * n + j) = v;
        if (j < n - 1) v += h / (n - 1) * acceleration.row(k * (n - 1) + j);
      }
      for (int j = 0; j <= n; ++j) {
        position.row(k * (n + 1) + j) = p;
        if (j < n) p += h / n * velocity.row(k * n + j);
      }
      jerk_points.middleRows(k * (n - 2), n - 2) =
          (n - 2) / h * (acceleration.middleRows(k * (n - 1) + 1, n - 2) - acceleration.middleRows(k * (n - 1), n - 2));
      for (int i = 0; i <= kIntervals; ++i) {
        const double s = static_cast<double>(i) / kIntervals;
        const double weight = (i == 0 || i == kIntervals ? 1.0 : 2.0 + 2.0 * (i % 2)) * h / (3.0 * kIntervals);
        MatrixXd points = jerk_points.middleRows(k * (n - 2), n - 2);
        for (int level = n - 3; level > 0; --level) {
          points.topRows(level) = ((1.0 - s) * points.topRows(level) + s * points.middleRows(1, level)).eval();
        }
        jerk.row(k * (kIntervals + 1) + i) = std::sqrt(weight) * points.row(0);
      }
    }
    ends = MatrixXd::Zero(6, size);
    ends << position.row(0), velocity.row(0), acceleration.row(0), position.bottomRows(1), velocity.bottomRows(1),
        acceleration.bottomRows(1);
  }
  static constexpr int kIntervals = 160;
  int degree, pieces, size;
  MatrixXd position, velocity, acceleration, jerk_points, jerk, ends;
};

using Curve = Eigen::Matrix<double, Eigen::Dynamic, 3>;  // x of each axis

// All equalities E x = e and inequalities A x <= b of a problem over x of three axes.
struct Constraints {
  MatrixXd equalities, inequalities;
  VectorXd values, bounds;
};

Constraints constraints_of(const SplineProblem& problem, const AxisModel& model) {
  const int n = model.size;
  std::vector<VectorXd> rows;
  std::vector<double> bounds;
  Constraints c;
  c.equalities = MatrixXd::Zero(18, 3 * n);
  c.values.resize(18);
  for (int axis = 0; axis < 3; ++axis) {
    c.equalities.block(6 * axis, axis * n, 6, n) = model.ends;
    c.values.segment<6>(6 * axis) << problem.start.position(axis), problem.start.velocity(axis),
        problem.start.acceleration(axis), problem.end.position(axis), problem.end.velocity(axis),
        problem.end.acceleration(axis);
    auto add_box = [&](const MatrixXd& outputs, double bound) {
      for (int i = 0; i < outputs.rows(); ++i) {
        for (double sign : {-1.0, 1.0}) {
          rows.push_back(VectorXd::Zero(3 * n));
          rows.back().segment(axis * n, n) = sign * outputs.row(i);
          bounds.push_back(bound);
        }
      }
    };
    add_box(model.velocity, problem.v_max_mps);
    add_box(model.acceleration, problem.a_max_mps2);
    if (problem.j_max_mps3 > 0.0) add_box(model.jerk_points, problem.j_max_mps3);
  }
  for (int f = 0; f < problem.accelerations.num_faces(); ++f) {
    for (int i = 1; i + 1 < model.acceleration.rows(); ++i) {  // but for the ends
      rows.push_back(VectorXd(3 * n));
      for (int axis = 0; axis < 3; ++axis) {
        rows.back().segment(axis * n, n) =
            problem.accelerations.normals(f, axis) * model.acceleration.row(i).transpose();
      }
      bounds.push_back(problem.accelerations.offsets(f));
    }
  }
  for (int k = 0; k < model.pieces; ++k) {
    const Polytope& corridor = problem.corridors[k];
    for (int f = 0; f < corridor.num_faces(); ++f) {
      for (int j = 0; j <= model.degree; ++j) {
        rows.push_back(VectorXd(3 * n));
        for (int axis = 0; axis < 3; ++axis) {
          rows.back().segment(axis * n, n) =
              corridor.normals(f, axis) * model.position.row(k * (model.degree + 1) + j).transpose();
        }
        bounds.push_back(corridor.offsets(f));
      }
    }
  }
  c.inequalities.resize(rows.size(), 3 * n);
  for (size_t i = 0; i < rows.size(); ++i) c.inequalities.row(i) = rows[i];
  c.bounds = Eigen::Map<VectorXd>(bounds.data(), bounds.size());
  return c;
}

// Lawson and Hanson: the x >= 0 nearest to columns * x = target; returns the residual's length.
double nnls_residual(const MatrixXd& columns, const VectorXd& target) {
  const int n = static_cast<int>(columns.cols());
  const double tolerance = 1e-11 * target.norm();
  VectorXd x = VectorXd::Zero(n), residual = target;
  std::vector<bool> free(n, false);
  for (int outer = 0; outer < 3 * n; ++outer) {
    const VectorXd slope = columns.transpose() * residual;
    int enter = -1;
    for (int i = 0; i < n; ++i) {
      if (!free[i] && slope(i) > tolerance && (enter < 0 || slope(i) > slope(enter))) enter = i;
    }
    if (enter < 0) break;
    free[enter] = true;
    for (;;) {
      std::vector<int> ids;
      for (int i = 0; i < n; ++i) {
        if (free[i]) ids.push_back(i);
      }
      const VectorXd z = MatrixXd(columns(Eigen::all, ids)).completeOrthogonalDecomposition().solve(target);
      double step = 1.0;
      int leaving = -1;
      for (size_t i = 0; i < ids.size(); ++i) {
        if (z(i) > 0.0) continue;
        const double ratio = x(ids[i]) / (x(ids[i]) - z(i));
        if (leaving < 0 || ratio < step) step = std::min(step, ratio), leaving = ids[i];
      }
      for (size_t i = 0; i < ids.size(); ++i) x(ids[i]) += step * (z(i) - x(ids[i]));
      if (leaving < 0) break;
      x(leaving) = 0.0;
      free[leaving] = false;
    }
    residual = target - columns * x;
  }
  return residual.norm();
}

MatrixXd unit_columns(MatrixXd columns) {
  columns.colwise().normalize();
  return columns;
}

// Farkas: either some x meets all constraints or some l >= 0 and m give A'l + E'm = 0, b'l + e'm = -1.
bool has_infeasibility_certificate(const Constraints& c) {
  MatrixXd columns(c.inequalities.cols() + 1, c.inequalities.rows() + 36);
  columns.topRows(c.inequalities.cols()) << c.inequalities.transpose(), c.equalities.transpose(),
      -c.equalities.transpose();
  columns.bottomRows(1) << c.bounds.transpose(), c.values.transpose(), -c.values.transpose();
  return nnls_residual(unit_columns(columns), -VectorXd::Unit(columns.rows(), columns.rows() - 1)) < 1e-7;
}

double jerk_integral(const AxisModel& model, const Curve& curve) {
  return (model.jerk * curve).squaredNorm();
}

double weighted_jerk(const AxisModel& model, const Curve& curve, const std::vector<double>& weights) {
  const Eigen::Index rows = model.jerk.rows() / model.pieces;  // of a piece
  double sum = 0.0;
  for (int k = 0; k < model.pieces; ++k) {
    const double weight = weights.empty() ? 1.0 : weights[static_cast<std::size_t>(k)];
    sum += weight * (model.jerk.middleRows(k * rows, rows) * curve).squaredNorm();
  }
  return sum;
}

Curve curve_of(const SplineProblem& problem, const AxisModel& model, const std::vector<double>& durations,
               const Matrix3Xd& points) {
  const int n = model.degree;
  Curve curve(model.size, 3);
  curve.row(0) = problem.start.position;
  curve.row(1) = problem.start.velocity;
  for (int k = 0; k < model.pieces; ++k) {
    for (int j = 0; j < n - 1; ++j) {
      const int i = k * (n + 1) + j;
      curve.row(2 + k * (n - 2) + j) = n * (n - 1) / (durations[k] * durations[k]) *
                                       (points.col(i + 2) - 2.0 * points.col(i + 1) + points.col(i)).transpose();
    }
  }
  return curve;
}

VectorXd flatten(const Curve& curve) {
  return Eigen::Map<const VectorXd>(curve.data(), curve.size());
}

double violation(const Constraints& c, const Curve& curve) {
  return (c.inequalities * flatten(curve) - c.bounds).maxCoeff();
}

// Everything the header promises of a solved problem, but optimality, which the callers judge.
void expect_valid(const SplineProblem& problem, int degree, const std::vector<double>& durations,
                  const SplineSolution& solution, double tolerance = 1e-7) {
  const AxisModel model(degree, durations);
  ASSERT_EQ(solution.control_points.cols(), model.pieces * (degree + 1));
  const Curve curve = curve_of(problem, model, durations, solution.control_points);
  // Rebuilt from its accelerations the curve is C2 and has the same points and ends: then so are and have the
  // solution's.
  EXPECT_LT((model.position * curve - solution.control_points.transpose()).cwiseAbs().maxCoeff(), 1e-9);
  const Constraints c = constraints_of(problem, model);
  EXPECT_LT((c.equalities * flatten(curve) - c.values).cwiseAbs().maxCoeff(), 1e-8);
  EXPECT_LT(violation(c, curve), tolerance);
  EXPECT_NEAR(std::max(0.0, violation(c, curve)), solution.max_violation, 1e-9);
  const double jerk = jerk_integral(model, curve);
  EXPECT_NEAR(solution.jerk_integral, jerk, 1e-6 * (1.0 + jerk));
}

// The gradient's part that the active rows cannot balance, relative.
double kkt_residual(const SplineProblem& problem, int degree, const std::vector<double>& durations,
                    const SplineSolution& solution) {
  const AxisModel model(degree, durations);
  const Constraints c = constraints_of(problem, model);
  const Curve curve = curve_of(problem, model, durations, solution.control_points);
  const VectorXd gradient = flatten(model.jerk.transpose() * (model.jerk * curve));
  const VectorXd excess = c.inequalities * flatten(curve) - c.bounds;
  std::vector<int> active;
  for (int i = 0; i < excess.size(); ++i) {
    if (excess(i) > -1e-7) active.push_back(i);
  }
  MatrixXd columns(c.equalities.cols(), active.size() + 36);
  columns << MatrixXd(c.inequalities(active, Eigen::all)).transpose(), c.equalities.transpose(),
      -c.equalities.transpose();
  return nnls_residual(unit_columns(columns), -gradient) / (1e-9 + gradient.norm());
}

double uniform(std::mt19937* rng, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(*rng);
}

Vector3d direction(std::mt19937* rng) {
  std::normal_distribution<double> normal;
  Vector3d n;
  for (double& value : n) value = normal(*rng);
  return n.normalized();
}

void add_face(Polytope* polytope, const Vector3d& n, double offset) {
  const int faces = polytope->num_faces();
  polytope->normals.conservativeResize(faces + 1, 3);
  polytope->offsets.conservativeResize(faces + 1);
  polytope->normals.row(faces) = n;
  polytope->offsets(faces) = offset;
}

// A curve with random accelerations, and bounds and faces around its control points at random distances up to `margin`.
struct RandomProblem {
  RandomProblem(std::mt19937* rng, int curve_degree, int pieces, int faces, double margin) : degree(curve_degree) {
    for (int k = 0; k < pieces; ++k) durations.push_back(uniform(rng, 0.1, 0.5));
    const AxisModel model(degree, durations);
    reference = Curve::Zero(model.size, 3).unaryExpr([&](double) { return uniform(rng, -5.0, 5.0); });
    reference.row(1) *= 0.2;
    surround(rng, faces, margin);
  }

  void surround(std::mt19937* rng, int faces, double margin) {
    const AxisModel model(degree, durations);
    const Curve ends = model.ends * reference;
    problem.start = {ends.row(0), ends.row(1), ends.row(2)};
    problem.end = {ends.row(3), ends.row(4), ends.row(5)};
    problem.v_max_mps = (model.velocity * reference).cwiseAbs().maxCoeff() * (1.0 + margin * uniform(rng, 0.0, 1.0));
    problem.a_max_mps2 =
        (model.acceleration * reference).cwiseAbs().maxCoeff() * (1.0 + margin * uniform(rng, 0.0, 1.0));
    problem.corridors.assign(durations.size(), {});
    const Curve points = model.position * reference;
    for (size_t k = 0; k < durations.size(); ++k) {
      for (int f = 0; f < faces; ++f) {
        const Vector3d n = direction(rng);
        const double support = (points.middleRows(k * (degree + 1), degree + 1) * n).maxCoeff();
        add_face(&problem.corridors[k], n, support + margin * uniform(rng, 0.0, 0.3));
      }
    }
  }

  std::string text() const {
    std::ostringstream out;
    out.precision(17);
    out << "degree " << degree << ", v_max_mps " << problem.v_max_mps << ", a_max_mps2 " << problem.a_max_mps2
        << ", durations";
    for (double h : durations) out << ' ' << h;
    out << "\nreference\n" << reference;
    for (const Polytope& c : problem.corridors)
      out << "\nfaces\n" << c.normals << "\noffsets " << c.offsets.transpose();
    return out.str();
  }

  int degree;
  std::vector<double> durations;
  Curve reference;  // feasible
  SplineProblem problem;
};

TEST(SplineQp, MeetsTheOptimalityConditions) {
  std::mt19937 rng(1);
  int with_active_rows = 0;
  for (int trial = 0; trial < 90; ++trial) {
    const RandomProblem random(&rng, trial % 3 == 2 ? 6 : 4 + trial % 3, 3 + trial % 6, trial % 20, trial % 4 * 0.2);
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + random.text());
    SplineQp qp(random.degree, random.durations);
    SplineSolution solution;
    ASSERT_EQ(qp.solve(random.problem, &solution), SplineStatus::kSolved);
    expect_valid(random.problem, random.degree, random.durations, solution);
    EXPECT_LT(kkt_residual(random.problem, random.degree, random.durations, solution), 1e-5);
    with_active_rows += solution.iterations > 3;
  }
  EXPECT_GT(with_active_rows, 30);
}

// The same with jerks and what thrust allows.
TEST(SplineQp, MeetsTheOptimalityConditionsWithinJerkAndThrust) {
  std::mt19937 rng(21);
  int by_jerk = 0, by_thrust = 0;
  for (int trial = 0; trial < 60; ++trial) {
    RandomProblem random(&rng, 4 + trial % 2, 2 + trial % 7, trial % 6, 0.2 + trial % 3 * 0.2);
    const AxisModel model(random.degree, random.durations);
    if (trial % 3 != 1) {
      const Curve accelerations = model.acceleration * random.reference;
      for (int f = 0; f < 20; ++f) {
        const Vector3d n = direction(&rng);
        add_face(&random.problem.accelerations, n, (accelerations * n).maxCoeff() + uniform(&rng, 0.0, 0.03));
      }
    }
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + random.text());
    SplineQp qp(random.degree, random.durations);
    SplineSolution solution;
    if (trial % 3 != 0) {  // less than it takes without a bound
      ASSERT_EQ(qp.solve(random.problem, &solution), SplineStatus::kSolved);
      for (int k = 0; k < model.pieces; ++k) {
        const Eigen::Matrix3Xd points = solution.control_points.middleCols(k * (model.degree + 1), model.degree + 1);
        Eigen::Matrix3Xd steps = points;
        for (int level = 0; level < 3; ++level)
          steps = (steps.rightCols(steps.cols() - 1) - steps.leftCols(steps.cols() - 1)).eval();
        const double scale = model.degree * (model.degree - 1) * (model.degree - 2) / std::pow(random.durations[k], 3);
        random.problem.j_max_mps3 = std::max(random.problem.j_max_mps3, 0.95 * scale * steps.cwiseAbs().maxCoeff());
      }
    }
    const SplineStatus status = qp.solve(random.problem, &solution);
    const bool certificate = has_infeasibility_certificate(constraints_of(random.problem, model));
    ASSERT_EQ(status, certificate ? SplineStatus::kInfeasible : SplineStatus::kSolved);
    if (certificate) continue;
    expect_valid(random.problem, random.degree, random.durations, solution);
    EXPECT_LT(kkt_residual(random.problem, random.degree, random.durations, solution), 1e-5);
    // And it costs more than without them.
    const double cost = solution.jerk_integral;
    SplineProblem freer = random.problem;
    freer.j_max_mps3 = 0.0;
    ASSERT_EQ(qp.solve(freer, &solution), SplineStatus::kSolved);
    EXPECT_LE(solution.jerk_integral, cost * (1 + 1e-6));
    by_jerk += solution.jerk_integral < cost * (1 - 1e-4);
    const double without_jerk = solution.jerk_integral;
    freer.accelerations = {};
    ASSERT_EQ(qp.solve(freer, &solution), SplineStatus::kSolved);
    EXPECT_LE(solution.jerk_integral, without_jerk * (1 + 1e-6));
    by_thrust += solution.jerk_integral < without_jerk * (1 - 1e-4);
  }
  EXPECT_GT(by_jerk, 5);
  EXPECT_GT(by_thrust, 5);
}

TEST(SplineQp, NoFeasibleNeighbourIsCheaper) {
  std::mt19937 rng(2);
  int tried = 0;
  for (int trial = 0; trial < 30; ++trial) {
    const RandomProblem random(&rng, 4 + trial % 2, 3 + trial % 8, 6, 0.5);
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + random.text());
    const AxisModel model(random.degree, random.durations);
    const Constraints c = constraints_of(random.problem, model);
    std::vector<double> jerk_weights;
    if (trial % 3 > 0)
      std::generate_n(std::back_inserter(jerk_weights), model.pieces, [&] { return uniform(&rng, 0.01, 1.0); });
    SplineQp qp(random.degree, random.durations, jerk_weights);
    SplineSolution solution;
    ASSERT_EQ(qp.solve(random.problem, &solution), SplineStatus::kSolved);
    const Curve best = curve_of(random.problem, model, random.durations, solution.control_points);
    const MatrixXd kernel = model.ends.fullPivLu().kernel();
    for (int i = 0; i < 60; ++i) {
      const MatrixXd weights = MatrixXd::Zero(kernel.cols(), 3).unaryExpr([&](double) { return uniform(&rng, -1, 1); });
      const double towards = uniform(&rng, 0.0, 1.0), scale = std::pow(10.0, uniform(&rng, -4.0, 0.0));
      const Curve other = best + towards * (random.reference - best) + scale * kernel * weights;
      if (violation(c, other) > 0.0) continue;
      ++tried;
      EXPECT_GE(weighted_jerk(model, other, jerk_weights),
                weighted_jerk(model, best, jerk_weights) * (1.0 - 1e-6) - 1e-9);
    }
  }
  EXPECT_GT(tried, 200);
}

TEST(SplineQp, AgreesWithSlsqp) {
  std::mt19937 rng(3);
  for (int trial = 0; trial < 24; ++trial) {
    const RandomProblem random(&rng, 4 + trial % 2, 2 + trial / 2 % 2, 5, 0.5);
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + random.text());
    SplineQp qp(random.degree, random.durations);
    SplineSolution solution;
    ASSERT_EQ(qp.solve(random.problem, &solution), SplineStatus::kSolved);

    const AxisModel model(random.degree, random.durations);
    const Constraints c = constraints_of(random.problem, model);
    // Over the null space of the equalities around the reference.
    struct Reduced {
      MatrixXd jerk, rows;
      VectorXd jerk_offset, room;
    } reduced;
    MatrixXd jerk = MatrixXd::Zero(3 * model.jerk.rows(), 3 * model.size);
    for (int axis = 0; axis < 3; ++axis) {
      jerk.block(axis * model.jerk.rows(), axis * model.size, model.jerk.rows(), model.size) = model.jerk;
    }
    const MatrixXd kernel = c.equalities.fullPivLu().kernel();
    const VectorXd origin = flatten(random.reference);
    reduced = {jerk * kernel, c.inequalities * kernel, jerk * origin, c.bounds - c.inequalities * origin};
    nlopt::opt slsqp(nlopt::LD_SLSQP, static_cast<unsigned>(kernel.cols()));
    slsqp.set_min_objective(
        [](unsigned n, const double* x, double* gradient, void* data) {
          const Reduced& r = *static_cast<Reduced*>(data);
          const VectorXd value = r.jerk * Eigen::Map<const VectorXd>(x, n) + r.jerk_offset;
          if (gradient) Eigen::Map<VectorXd>(gradient, n) = 2.0 * r.jerk.transpose() * value;
          return value.squaredNorm();
        },
        &reduced);
    slsqp.add_inequality_mconstraint(
        [](unsigned m, double* result, unsigned n, const double* x, double* gradient, void* data) {
          const Reduced& r = *static_cast<Reduced*>(data);
          Eigen::Map<VectorXd>(result, m) = r.rows * Eigen::Map<const VectorXd>(x, n) - r.room;
          using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
          if (gradient) Eigen::Map<RowMajor>(gradient, m, n) = r.rows;
        },
        &reduced, std::vector<double>(c.bounds.size(), 1e-9));
    slsqp.set_ftol_rel(1e-12);
    slsqp.set_maxeval(500);
    std::vector<double> x(kernel.cols(), 0.0);
    double optimum = 0.0;
    ASSERT_GT(slsqp.optimize(x, optimum), 0);
    EXPECT_NEAR(solution.jerk_integral, optimum, 1e-5 * optimum);
  }
}

TEST(SplineQp, CertifiesInfeasibilityExactlyWhenFarkasDoes) {
  std::mt19937 rng(4);
  int infeasible = 0;
  for (int trial = 0; trial < 120; ++trial) {
    RandomProblem random(&rng, 4 + trial % 2, 2 + trial % 3, 4, 0.3);
    switch (trial % 4) {
      case 0:
        random.problem.v_max_mps *= uniform(&rng, 0.7, 1.0);
        break;
      case 1:
        random.problem.a_max_mps2 *= uniform(&rng, 0.5, 1.0);
        break;
      case 2:
        random.problem.corridors[1].offsets.array() -= uniform(&rng, 0.0, 0.2);
        break;
      default:
        random.problem.end.position += 0.3 * direction(&rng);
        break;
    }
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + random.text());
    SplineQp qp(random.degree, random.durations);
    SplineSolution solution;
    const SplineStatus status = qp.solve(random.problem, &solution);
    const AxisModel model(random.degree, random.durations);
    const bool certificate = has_infeasibility_certificate(constraints_of(random.problem, model));
    EXPECT_EQ(status, certificate ? SplineStatus::kInfeasible : SplineStatus::kSolved);
    infeasible += certificate;
  }
  EXPECT_GT(infeasible, 20);
  EXPECT_LT(infeasible, 100);
}

TEST(SplineQp, ContradictoryFacesAtAJointAreInfeasible) {
  std::mt19937 rng(5);
  for (int trial = 0; trial < 50; ++trial) {
    RandomProblem random(&rng, 4 + trial % 2, 4 + trial % 7, 3, 1.0);
    const int joint = 1 + trial % (static_cast<int>(random.durations.size()) - 1);
    const AxisModel model(random.degree, random.durations);
    const Vector3d n = direction(&rng), at = (model.position.row(joint * (random.degree + 1)) * random.reference);
    const double gap = std::pow(10.0, -1 - trial % 5);  // [m]
    add_face(&random.problem.corridors[joint - 1], n, n.dot(at));
    add_face(&random.problem.corridors[joint], -n, -n.dot(at) - gap);
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + random.text());
    SplineQp qp(random.degree, random.durations);
    SplineSolution solution;
    EXPECT_EQ(qp.solve(random.problem, &solution), SplineStatus::kInfeasible);
  }
}

TEST(SplineQp, WithoutFacesAndFarBoundsIsTheUnconstrainedOptimum) {
  // A quintic is the minimum of jerk between two states, whatever the pieces.
  SplineProblem problem;
  problem.v_max_mps = problem.a_max_mps2 = 1e3;
  problem.start = {{1.0, -2.0, 0.5}, {0.3, 0.2, -0.1}, {-0.5, 0.4, 0.2}};
  problem.end = {{2.0, 1.0, 1.5}, {-0.2, 0.5, 0.0}, {0.1, -0.3, 0.6}};
  SplineSolution one, many;
  problem.corridors.resize(1);
  ASSERT_EQ(SplineQp(5, {1.2}).solve(problem, &one), SplineStatus::kSolved);
  problem.corridors.resize(4);
  ASSERT_EQ(SplineQp(6, {0.1, 0.5, 0.4, 0.2}).solve(problem, &many), SplineStatus::kSolved);
  expect_valid(problem, 6, {0.1, 0.5, 0.4, 0.2}, many);
  EXPECT_NEAR(many.jerk_integral, one.jerk_integral, 1e-9 * one.jerk_integral);
  EXPECT_EQ(many.iterations, 0);
}

TEST(SplineQp, DuplicateAndNearlyDuplicateFacesChangeNothing) {
  std::mt19937 rng(6);
  for (int trial = 0; trial < 60; ++trial) {
    RandomProblem random(&rng, 4 + trial % 2, 2 + trial % 8, 6, 0.2);
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + random.text());
    SplineQp qp(random.degree, random.durations);
    SplineSolution once, doubled;
    ASSERT_EQ(qp.solve(random.problem, &once), SplineStatus::kSolved);
    const double tilt = trial % 12 < 2 ? 0.0 : std::pow(10.0, -3 - trial % 12);
    const AxisModel model(random.degree, random.durations);
    const Matrix3Xd reference = (model.position * random.reference).transpose();
    for (size_t k = 0; k < random.durations.size(); ++k) {
      Polytope& corridor = random.problem.corridors[k];
      for (int f = 0, faces = corridor.num_faces(); f < faces; ++f) {
        const Vector3d n = (corridor.normals.row(f).transpose() + tilt * direction(&rng)).normalized();
        const auto points = reference.middleCols(k * (random.degree + 1), random.degree + 1);
        add_face(&corridor, n, std::max(corridor.offsets(f), (n.transpose() * points).maxCoeff()));
      }
    }
    ASSERT_EQ(qp.solve(random.problem, &doubled), SplineStatus::kSolved);
    expect_valid(random.problem, random.degree, random.durations, doubled);
    EXPECT_GE(doubled.jerk_integral, once.jerk_integral * (1.0 - 1e-6));
    EXPECT_LT(kkt_residual(random.problem, random.degree, random.durations, doubled), 1e-5);
    if (tilt == 0.0) {
      EXPECT_NEAR(doubled.jerk_integral, once.jerk_integral, 1e-6 * once.jerk_integral);
    }
  }
}

TEST(SplineQp, EndsOnTheirFacesAreAcceptedAndEndsOutsideRefused) {
  SplineProblem problem;
  problem.start.velocity = {0.0, 1.0, 0.0};
  problem.end.position = {0.4, 0.8, 0.0};
  problem.corridors.resize(4);
  for (Polytope& corridor : problem.corridors) add_face(&corridor, -Vector3d::UnitX(), 0.0);
  const std::vector<double> durations(4, 0.3);
  SplineQp qp(5, durations);
  SplineSolution solution;
  ASSERT_EQ(qp.solve(problem, &solution), SplineStatus::kSolved);
  expect_valid(problem, 5, durations, solution);
  problem.start.position.x() = -9e-7;
  ASSERT_EQ(qp.solve(problem, &solution), SplineStatus::kSolved);
  expect_valid(problem, 5, durations, solution, 1e-6);
  problem.start.position.x() = -1e-5;
  EXPECT_EQ(qp.solve(problem, &solution), SplineStatus::kInfeasible);
  problem.start.position.x() = 0.0;
  problem.start.velocity.y() = problem.v_max_mps + 1e-5;
  EXPECT_EQ(qp.solve(problem, &solution), SplineStatus::kInfeasible);
  problem.start.velocity.y() = 1.0;
  ASSERT_EQ(qp.solve(problem, &solution), SplineStatus::kSolved);
  for (double* value : {&problem.start.velocity.y(), &problem.end.acceleration.z(), &problem.corridors[2].offsets(0)}) {
    const double good = std::exchange(*value, std::nan(""));
    EXPECT_EQ(qp.solve(problem, &solution), SplineStatus::kInfeasible);
    *value = good;
  }
}

// Search primitives at full acceleration: a(s) = a0 + (a1 - a0)(2 s - s^2) has its control points (a0, a1, a1) on the
// bounds.
// A start that still rises: what it alone decides passes the limits, nothing else does.
TEST(SplineQp, LimitsOfTheEndsAreTheirOwn) {
  const std::vector<double> durations(6, 0.2);
  SplineQp qp(5, durations);
  SplineProblem problem;
  problem.start.velocity = {1.98, 0, 0};
  problem.start.acceleration = {1.0, 0, 0};  // the next control point of the velocity: 2.03
  problem.end.position = {1.5, 0, 0};
  problem.corridors.resize(6);
  SplineSolution solution;
  EXPECT_EQ(qp.solve(problem, &solution), SplineStatus::kInfeasible);
  problem.end_v_max_mps = 2.03;
  ASSERT_EQ(qp.solve(problem, &solution), SplineStatus::kSolved);
  for (int i = 0; i + 1 < 36; ++i) {
    if (i % 6 == 5) continue;
    const double speed = 5 / 0.2 * (solution.control_points.col(i + 1) - solution.control_points.col(i)).x();
    EXPECT_LE(speed, i == 1 ? 2.03 + 1e-6 : 2.0 + 1e-6) << i;
  }
  problem.end_v_max_mps = 0.0;
  problem.start.velocity.x() = 1.0;
  problem.start.acceleration.x() = 6.1;
  EXPECT_EQ(qp.solve(problem, &solution), SplineStatus::kInfeasible);
  problem.end_a_max_mps2 = 6.1;
  EXPECT_EQ(qp.solve(problem, &solution), SplineStatus::kSolved);
}

TEST(SplineQp, CurvesThatRideOnEveryBoundAreFeasible) {
  std::mt19937 rng(7);
  const double h = 0.2, a_max_mps2 = 6.0;
  for (int trial = 0; trial < 120; ++trial) {
    RandomProblem random(&rng, 4 + trial % 2, 3 + trial % 8, 0, 0.0);
    const int n = random.degree, pieces = static_cast<int>(random.durations.size());
    random.durations.assign(pieces, h);
    random.reference.topRows(2) *= 0.1;
    for (int axis = 0; axis < 3; ++axis) {
      double last = a_max_mps2 * (static_cast<int>(rng() % 3) - 1);
      for (int k = 0; k < pieces; ++k) {
        const double next = a_max_mps2 * (static_cast<int>(rng() % 3) - 1);
        auto acceleration = random.reference.col(axis).segment(2 + k * (n - 2), n - 1);
        acceleration.setConstant(next);
        acceleration(0) = last;
        if (n == 5) acceleration(1) = (last + 2.0 * next) / 3.0;
        last = next;
      }
    }
    random.surround(&rng, trial % 3 == 0 ? 0 : 10, 0.0);
    random.problem.a_max_mps2 = a_max_mps2;
    if (trial % 3 == 2) {  // and the tight boxes of all points
      const Curve points = AxisModel(n, random.durations).position * random.reference;
      for (int k = 0; k < pieces; ++k) {
        for (int axis = 0; axis < 3; ++axis) {
          const auto values = points.col(axis).segment(k * (n + 1), n + 1);
          add_face(&random.problem.corridors[k], Vector3d::Unit(axis), values.maxCoeff());
          add_face(&random.problem.corridors[k], -Vector3d::Unit(axis), -values.minCoeff());
        }
      }
    }
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + random.text());
    SplineQp qp(n, random.durations);
    SplineSolution solution;
    ASSERT_EQ(qp.solve(random.problem, &solution), SplineStatus::kSolved) << solution.iterations;
    expect_valid(random.problem, n, random.durations, solution);
    const double reference_jerk = jerk_integral(AxisModel(n, random.durations), random.reference);
    EXPECT_LE(solution.jerk_integral, reference_jerk * (1.0 + 1e-6));
  }
}

TEST(SplineQp, AllDegreesAndExtremeDurations) {
  std::mt19937 rng(8);
  for (int degree = 3; degree <= 9; ++degree) {
    for (int pieces : {1, 2, 3, 5, 12}) {
      if (pieces * (degree - 2) < 3) continue;
      RandomProblem random(&rng, degree, pieces, 5, 0.4);
      random.durations[0] = 0.01;
      random.surround(&rng, 5, 0.4);
      SCOPED_TRACE(random.text());
      SplineQp qp(degree, random.durations);
      SplineSolution solution;
      ASSERT_EQ(qp.solve(random.problem, &solution), SplineStatus::kSolved) << solution.iterations;
      expect_valid(random.problem, degree, random.durations, solution);
    }
  }
}

TEST(SplineQp, NoFreedomLeftStillChecksTheBounds) {
  SplineProblem problem;
  problem.end.position = {0.3, 0.0, 0.0};  // the second acceleration control point is 20 * 0.3: just on the bound
  problem.corridors.resize(1);
  SplineSolution solution;
  SplineQp qp(5, {1.0});
  ASSERT_EQ(qp.solve(problem, &solution), SplineStatus::kSolved);
  expect_valid(problem, 5, {1.0}, solution);
  EXPECT_NEAR(solution.jerk_integral, 720.0 * 0.09, 1e-9);  // rest to rest: 720 d^2 / T^5
  add_face(&problem.corridors[0], Vector3d::UnitX(), 0.2);
  EXPECT_EQ(qp.solve(problem, &solution), SplineStatus::kInfeasible);
}

TEST(SplineQp, RepeatedSolvesGiveIdenticalBits) {
  std::mt19937 rng(9);
  const RandomProblem a(&rng, 5, 8, 8, 0.1);
  RandomProblem b(&rng, 5, 8, 12, 0.0);
  SplineQp qp(5, a.durations), fresh(5, a.durations);
  SplineSolution first, other, again, from_fresh;
  const SplineStatus status = qp.solve(a.problem, &first);
  (void)qp.solve(b.problem, &other);
  SplineQp moved(std::move(qp));
  EXPECT_EQ(moved.solve(a.problem, &again), status);
  EXPECT_EQ(fresh.solve(a.problem, &from_fresh), status);
  EXPECT_GT(first.iterations, 0);
  for (const SplineSolution* solution : {&again, &from_fresh}) {
    EXPECT_EQ(first.control_points, solution->control_points);
    EXPECT_EQ(first.jerk_integral, solution->jerk_integral);
    EXPECT_EQ(first.max_violation, solution->max_violation);
    EXPECT_EQ(first.iterations, solution->iterations);
  }
}

TEST(SplineQp, RefusesBadArgumentsByName) {
  auto message = [](auto&& action) -> std::string {
    try {
      action();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(message([] { SplineQp(2, {1.0, 1.0, 1.0}); }).find("degree = 2"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(10, {1.0}); }).find("degree = 10"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(5, {}); }).find("pieces = 0"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(5, std::vector<double>(65, 0.1)); }).find("pieces = 65"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(5, {0.2, 0.0}); }).find("durations_s[1] = 0"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(5, {0.2, std::nan("")}); }).find("durations_s[1]"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(4, {0.2}); }).find("pieces = 1"), std::string::npos);  // over-determined
  EXPECT_NE(message([] { SplineQp(3, {0.2, 0.2}); }).find("pieces = 2"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(5, {0.2, 0.2}, {1.0}); }).find("jerk_weights.size() = 1"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(5, {0.2, 0.2}, {1.0, 0.0}); }).find("jerk_weights[1] = 0"), std::string::npos);
  EXPECT_NE(message([] { SplineQp(5, {0.2, 0.2}, {1.5, 1.0}); }).find("jerk_weights[0] = 1.5"), std::string::npos);
  SplineQp qp(5, {0.2, 0.2});
  SplineProblem problem;
  SplineSolution solution;
  auto solve = [&] { (void)qp.solve(problem, &solution); };
  EXPECT_NE(message(solve).find("corridors.size() = 0"), std::string::npos);
  problem.corridors.resize(2);
  problem.v_max_mps = 0.0;
  EXPECT_NE(message(solve).find("v_max_mps = 0"), std::string::npos);
  problem.v_max_mps = 1.0;
  problem.a_max_mps2 = std::nan("");
  EXPECT_NE(message(solve).find("a_max_mps2"), std::string::npos);
}

TEST(SplineQp, StoredCorridorProblems) {
  const std::filesystem::path path = SWARM_TEST_DATA "/qp/problems.jsonl";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is absent";
  int solved = 0, infeasible = 0;
  for (const auto& [json, name, degree, durations, problem] : read_qp_problems(path)) {
    SCOPED_TRACE(name);
    SplineQp qp(degree, durations);
    SplineSolution solution;
    const SplineStatus status = qp.solve(problem, &solution);
    const nlohmann::json& reference = json["osqp_1e-8"];
    if (reference["status"] != 1) {
      EXPECT_EQ(status, SplineStatus::kInfeasible);
      ++infeasible;
      continue;
    }
    ASSERT_EQ(status, SplineStatus::kSolved);
    expect_valid(problem, degree, durations, solution, 1e-6);
    const double optimum = reference["jerk_integral"];
    EXPECT_NEAR(solution.jerk_integral, optimum, 1e-4 * optimum);
    ++solved;
  }
  EXPECT_GT(solved, 0);
  EXPECT_GT(infeasible, 0);
}

}  // namespace
}  // namespace swarm
