// Each axis is described by its acceleration control points alone: with position and velocity of the start they
// integrate to the whole C2 curve, so that all continuity holds by construction and only two equalities per axis
// (velocity and position of the end) remain to be eliminated. The remaining freedom is scaled to make the weighted jerk
// integral |y|^2 + constant, and the bounds are met by the dual active set method of Goldfarb and Idnani (Math.
// Programming 27, 1983), here with an orthogonal factorisation of the active normals in range space.
// Long because elimination, bounds and active set all work on that one representation.
// No product of two matrices here goes to Eigen's blocked kernels, whose order of sums depends on the processor.
#include "planner_daemon/optimize/spline_qp.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>

#include "lcmtypes/bus/wide.h"
#include "planner_daemon/optimize/active_set.h"
#include "planner_daemon/optimize/four_rows.h"

namespace swarm {
namespace {

constexpr double kSlack = 5e-8;  // every bound is relaxed by this: curves that ride on their bounds survive rounding
constexpr double kTolerance = 1e-8;       // a row is violated when it exceeds its relaxed bound by this
constexpr double kFixedTolerance = 1e-6;  // the same for control points that the end states alone decide
constexpr double kConstantRow = 1e-10;    // an output that responds less than this (relative to its kind) is constant
constexpr double kDrift = 1e-9;           // active rows further than this from their bounds are solved for again
constexpr double kMinPivot = 1e-12;       // of the Hessian's square root, relative
constexpr int kMaxPieces = 64, kMaxDegree = 9;
static_assert(kMaxPieces * (kMaxDegree + 1) <= SplineSolution::kMaxPoints);
constexpr double kInfinity = std::numeric_limits<double>::infinity();

using MatrixX3 = Eigen::Matrix<double, Eigen::Dynamic, 3>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

[[noreturn]] void reject(const std::string& name, const std::string& value, const std::string& rule) {
  throw std::invalid_argument("SplineQp: " + name + " = " + value + ": must be " + rule);
}

// (degree - 2) x (degree - 1): the integral of jerk^2 over a piece is |root * accelerations|^2 / duration.
Eigen::MatrixXd jerk_root(int degree) {
  const int d = degree - 3;
  auto choose = [](int n, int k) {
    double value = 1.0;
    for (int i = 1; i <= k; ++i) value = value * (n - k + i) / i;
    return value;
  };
  Eigen::MatrixXd gram(d + 1, d + 1);  // of the Bernstein polynomials of the jerk
  for (int i = 0; i <= d; ++i) {
    for (int j = 0; j <= d; ++j) gram(i, j) = choose(d, i) * choose(d, j) / (choose(2 * d, i + j) * (2 * d + 1));
  }
  Eigen::MatrixXd difference = Eigen::MatrixXd::Zero(d + 1, d + 2);
  difference.diagonal().setConstant(-(d + 1));
  difference.diagonal(1).setConstant(d + 1);
  return Eigen::MatrixXd(gram.llt().matrixU()).lazyProduct(difference);
}

struct Face {
  double x, y, z, offset;
};

// All of these four rows at a time, the last four overlapping their neighbours.

// The accelerations of each axis at y: those at `optimum` and the responses, `freedom` columns of `rows` each.
SWARM_WIDE void add_responses(const double* response, int rows, int freedom, const double* y, const double* optimum,
                              double* out, int out_rows) {
  for (int i = 0; i < rows; i += 4) {
    const int first = std::min(i, rows - 4);
    const double *from = optimum + first, *of_y = response + first;
    FourRows acc_x, acc_y, acc_z;
    load(from, &acc_x), load(from + rows, &acc_y), load(from + 2 * rows, &acc_z);
    for (int j = 0; j < freedom; ++j, of_y += rows) {
      FourRows r;
      load(of_y, &r);
      acc_x += r * y[j];
      acc_y += r * y[freedom + j];
      acc_z += r * y[2 * freedom + j];
    }
    store(acc_x, out + first), store(acc_y, out + first + out_rows), store(acc_z, out + first + 2 * out_rows);
  }
}

// How far `count` positions, whose axes lie `rows` apart, are past the faces, if farther than `excess` says.
SWARM_WIDE void raise_to_faces(std::span<const Face> faces, const double* position, int rows, int count,
                               double* excess) {
  for (int i = 0; i < count; i += 4) {
    const int first = std::min(i, count - 4);
    const double* at = position + first;
    FourRows x, y, z, most;
    load(at, &x), load(at + rows, &y), load(at + 2 * rows, &z), load(excess + first, &most);
    for (const Face& face : faces) {
      const FourRows past = x * face.x + y * face.y + (z * face.z - face.offset);
      most = most < past ? past : most;
    }
    store(most, excess + first);
  }
}

double square(double value) {
  return value * value;
}

}  // namespace

const char* to_string(SplineStatus status) {
  switch (status) {
    case SplineStatus::kSolved:
      return "solved";
    case SplineStatus::kInfeasible:
      return "infeasible";
    case SplineStatus::kIterationLimit:
      return "iteration limit";
  }
  return "unknown";
}

// "Outputs" are the distinct control points in the order acceleration, velocity, position, jerk, each kind along the
// curve; those at a joint are shared by both pieces, but for jerks. Positions are relative to the start, which spares
// digits.
struct SplineQp::Impl {
  struct Row {  // normal . outputs.row(output) <= bound
    int output;
    Eigen::Vector3d normal;
    double bound;
  };

  Impl(int curve_degree, const std::vector<double>& durations, const std::vector<double>& jerk_weights);

  template <typename Matrix>
  void integrate(Matrix* outputs) const;
  template <typename Matrix>
  void differentiate(Matrix* outputs) const;
  bool load(const SplineProblem& problem);
  void evaluate();
  bool fixed_outputs_hold() const;
  bool worst_row(Row* row) const;
  static void raise_row(std::span<const Face> faces, const Eigen::Vector3d& value, double most, Row* row);
  double enter(const Row& row, double* bound);
  SplineStatus optimise(int* iterations);
  void report(const SplineProblem& problem, SplineSolution* solution) const;

  // Constant after construction.
  const int degree, pieces;
  const int num_acc, num_vel, num_pos, num_jerk, first_jerk, num_outputs;
  const int freedom;  // per axis
  double duration_s(int piece) const { return durations_s[static_cast<std::size_t>(piece)]; }
  std::span<const Face> faces_of(int first_piece, int last_piece) const {
    const std::size_t begin = first_face[static_cast<std::size_t>(first_piece)];
    return std::span(faces).subspan(begin, first_face[static_cast<std::size_t>(last_piece) + 1] - begin);
  }

  const std::vector<double> durations_s;
  double horizon_s = 0.0;
  double jerk_cap = 0.0;    // times a_max_mps2^2: no feasible curve costs more
  Eigen::MatrixXd root;     // jerk_root
  Eigen::MatrixXd optimum;  // num_acc x 4: unconstrained optimum per (start acc, end acc, velocity gain, position gain)
  Eigen::MatrixXd response_acc;  // num_acc x freedom: accelerations per y
  RowMajor response;             // num_outputs x freedom
  Eigen::ArrayXd inverse_norm;   // of the response's rows; 0: constant output
  double max_norm = 0.0;

  // Of the problem being solved; y and the normals hold axis after axis.
  double acc_limit = 0.0, vel_limit = 0.0, jerk_limit = 0.0;
  int num_bounded = 0;                            // outputs that have bounds: all, or all but the jerks
  double end_acc_room = 0.0, end_vel_room = 0.0;  // beyond them, for what the end states alone decide
  std::vector<Face> acc_faces;                    // of all accelerations, with relaxed offsets
  std::vector<Face> faces;                        // the same relative to the start, piece after piece
  std::vector<std::size_t> first_face;
  MatrixX3 unconstrained_acc;
  MatrixX3 outputs;
  Eigen::ArrayXd excess;  // of each output over its most violated relaxed bound
  Eigen::VectorXd y, normal;
  ActiveSet active;
};

SplineQp::Impl::Impl(int curve_degree, const std::vector<double>& durations, const std::vector<double>& jerk_weights)
    : degree(curve_degree),
      pieces(static_cast<int>(durations.size())),
      num_acc(pieces * (degree - 2) + 1),
      num_vel(pieces * (degree - 1) + 1),
      num_pos(pieces * degree + 1),
      num_jerk(pieces * (degree - 2)),
      first_jerk(num_acc + num_vel + num_pos),
      num_outputs(first_jerk + num_jerk),
      freedom(num_acc - 4),
      durations_s(durations),
      root(jerk_root(degree)),
      first_face(durations.size() + 1),
      outputs(num_outputs, 3),
      excess(num_outputs),
      y(3 * freedom),
      normal(3 * freedom),
      active(3 * freedom) {
  const int interior = num_acc - 2;
  Eigen::MatrixXd jerk = Eigen::MatrixXd::Zero(pieces * (degree - 2), num_acc);  // cost = |jerk * acc|^2
  for (int k = 0; k < pieces; ++k) {
    const double h = duration_s(k), weight = jerk_weights.empty() ? 1.0 : jerk_weights[static_cast<std::size_t>(k)];
    jerk.block(k * (degree - 2), k * (degree - 2), degree - 2, degree - 1) = root * std::sqrt(weight / h);
    horizon_s += h;
    jerk_cap += weight * 3.0 * square(2.0 * (degree - 2)) / h;
  }

  // The end's velocity and position as functions of the accelerations, and the null space of their interior part.
  Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(num_outputs, num_acc);
  unit.topRows(num_acc).setIdentity();
  integrate(&unit);
  Eigen::MatrixXd gains(2, num_acc);
  gains << unit.row(num_acc + num_vel - 1), unit.row(first_jerk - 1);
  const Eigen::MatrixXd interior_gains = gains.middleCols(1, interior).transpose();
  const Eigen::HouseholderQR<Eigen::MatrixXd> gain_qr(interior_gains);
  const Eigen::MatrixXd basis = gain_qr.householderQ();
  Eigen::MatrixXd null_space = Eigen::MatrixXd::Zero(num_acc, freedom);
  null_space.middleRows(1, interior) = basis.rightCols(freedom);

  // A particular solution for each unit of (start acc, end acc, velocity gain, position gain).
  Eigen::Matrix<double, 2, 4> rhs;
  rhs << -gains.col(0), -gains.col(num_acc - 1), Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d triangle = gain_qr.matrixQR().topRows<2>().triangularView<Eigen::Upper>();
  optimum = Eigen::MatrixXd::Zero(num_acc, 4);
  optimum(0, 0) = 1.0;
  optimum(num_acc - 1, 1) = 1.0;
  triangle.transpose().triangularView<Eigen::Lower>().solveInPlace(rhs);
  optimum.middleRows(1, interior) = basis.leftCols<2>().lazyProduct(rhs);

  response = RowMajor::Zero(num_outputs, freedom);
  if (freedom > 0) {
    // The null space in coordinates that make the Hessian the identity (Gram and Schmidt; twice is enough).
    Eigen::MatrixXd image(jerk.rows(), freedom);  // jerk * null_space, orthonormal in the end
    Eigen::VectorXd pivots(freedom);
    for (int k = 0; k < freedom; ++k) {
      auto direction = null_space.col(k);
      auto column = image.col(k);
      column.noalias() = jerk * direction;
      for (int pass = 0; pass < 2; ++pass) {
        const Eigen::VectorXd along = image.leftCols(k).transpose() * column;
        column.noalias() -= image.leftCols(k) * along;
        direction.noalias() -= null_space.leftCols(k) * along;
      }
      pivots(k) = column.norm();
      column /= pivots(k);
      direction /= pivots(k);
    }
    if (!(pivots.minCoeff() > kMinPivot * pivots.maxCoeff())) reject("durations_s", "too unequal", "comparable");
    const Eigen::MatrixXd jerks = jerk.lazyProduct(optimum), along = image.transpose().lazyProduct(jerks);
    optimum -= null_space.lazyProduct(along);
    response.topRows(num_acc) = null_space;
    integrate(&response);
    differentiate(&response);
  }
  response_acc = response.topRows(num_acc);

  inverse_norm = Eigen::ArrayXd::Zero(num_outputs);
  if (freedom == 0) return;
  const Eigen::VectorXd norms = response.rowwise().norm();
  max_norm = norms.head(first_jerk).maxCoeff();
  for (int begin = 0, derivative = 2; derivative >= 0; --derivative) {
    const int count = pieces * (degree - derivative) + 1;
    const double least = kConstantRow * norms.segment(begin, count).maxCoeff();
    const int fixed = 3 - derivative;  // at each end, by the end states
    for (int i = fixed; i < count - fixed; ++i) {
      if (norms(begin + i) > least) inverse_norm(begin + i) = 1.0 / norms(begin + i);
    }
    begin += count;
  }
  for (int i = first_jerk; i < num_outputs; ++i) {
    if (norms(i) > kConstantRow * norms.tail(num_jerk).maxCoeff()) inverse_norm(i) = 1.0 / norms(i);
  }
}

// Completes velocities and positions from the accelerations and the first velocity and position, column by column.
template <typename Matrix>
void SplineQp::Impl::integrate(Matrix* curve) const {
  int acc = 0, vel = num_acc, pos = num_acc + num_vel;
  for (int k = 0; k < pieces; ++k, --acc) {
    const double vel_step = duration_s(k) / (degree - 1), pos_step = duration_s(k) / degree;
    for (int j = 0; j < degree; ++j, ++pos) {
      curve->row(pos + 1) = curve->row(pos) + pos_step * curve->row(vel);
      if (j == degree - 1) continue;
      curve->row(vel + 1) = curve->row(vel) + vel_step * curve->row(acc);
      ++vel, ++acc;
    }
  }
}

// Completes the jerks.
template <typename Matrix>
void SplineQp::Impl::differentiate(Matrix* curve) const {
  for (int k = 0, jerk = first_jerk; k < pieces; ++k) {
    for (int acc = k * (degree - 2); acc < (k + 1) * (degree - 2); ++acc, ++jerk)
      curve->row(jerk) = (degree - 2) / duration_s(k) * (curve->row(acc + 1) - curve->row(acc));
  }
}

// False: some input is not a number, which meets no bound.
bool SplineQp::Impl::load(const SplineProblem& problem) {
  bool valid = true;
  acc_limit = problem.a_max_mps2 + kSlack;
  vel_limit = problem.v_max_mps + kSlack;
  jerk_limit = problem.j_max_mps3 + kSlack;
  num_bounded = problem.j_max_mps3 > 0.0 ? num_outputs : first_jerk;
  end_acc_room = std::max(0.0, problem.end_a_max_mps2 - problem.a_max_mps2);
  end_vel_room = std::max(0.0, problem.end_v_max_mps - problem.v_max_mps);
  const Eigen::Vector3d& origin = problem.start.position;
  faces.clear();
  acc_faces.clear();
  for (int i = 0; i < problem.accelerations.num_faces(); ++i) {
    const Eigen::Vector3d n = problem.accelerations.normals.row(i);
    acc_faces.push_back({n.x(), n.y(), n.z(), problem.accelerations.offsets(i) + kSlack});
    valid = valid && !std::isnan(n.sum() + acc_faces.back().offset);
  }
  for (std::size_t k = 0; k < problem.corridors.size(); ++k) {
    const Polytope& corridor = problem.corridors[k];
    for (int i = 0; i < corridor.num_faces(); ++i) {
      const Eigen::Vector3d n = corridor.normals.row(i);
      faces.push_back({n.x(), n.y(), n.z(), corridor.offsets(i) - n.dot(origin) + kSlack});
      valid = valid && !std::isnan(n.sum() + faces.back().offset);
    }
    first_face[k + 1] = faces.size();
  }

  Eigen::Matrix<double, 4, 3> ends;
  ends.row(0) = problem.start.acceleration;
  ends.row(1) = problem.end.acceleration;
  ends.row(2) = problem.end.velocity - problem.start.velocity;
  ends.row(3) = problem.end.position - origin - horizon_s * problem.start.velocity;
  unconstrained_acc.noalias() = optimum * ends;
  outputs.row(num_acc) = problem.start.velocity;
  outputs.row(num_acc + num_vel).setZero();
  y.setZero();
  active.clear();
  return valid && unconstrained_acc.allFinite();
}

// The curve at y, and how far each control point exceeds its bounds.
void SplineQp::Impl::evaluate() {
  add_responses(response_acc.data(), num_acc, freedom, y.data(), unconstrained_acc.data(), outputs.data(), num_outputs);
  integrate(&outputs);

  const auto largest = outputs.topRows(num_acc + num_vel).array().abs();
  excess.head(num_acc + num_vel) = largest.col(0).max(largest.col(1)).max(largest.col(2));
  excess.head(num_acc) -= acc_limit;
  excess.segment(num_acc, num_vel) -= vel_limit;
  for (const int i : {0, num_acc - 1}) excess(i) -= end_acc_room;
  for (const int i : {num_acc, num_acc + 1, num_acc + num_vel - 2, num_acc + num_vel - 1}) excess(i) -= end_vel_room;
  if (!acc_faces.empty()) {  // but for what the end states decide
    const double first = excess(0), last = excess(num_acc - 1);
    raise_to_faces(acc_faces, outputs.data(), num_outputs, num_acc, excess.data());
    excess(0) = first, excess(num_acc - 1) = last;
  }
  if (num_bounded > first_jerk) {
    differentiate(&outputs);
    excess.tail(num_jerk) = outputs.bottomRows(num_jerk).cwiseAbs().rowwise().maxCoeff().array() - jerk_limit;
  }
  excess.segment(num_acc + num_vel, num_pos).setConstant(-1e30);
  for (int k = 0; k < pieces; ++k) {
    const int first = num_acc + num_vel + k * degree;
    raise_to_faces(faces_of(k, k), outputs.data() + first, num_outputs, degree + 1, excess.data() + first);
  }
}

bool SplineQp::Impl::fixed_outputs_hold() const {
  for (int i = 0; i < num_bounded; ++i) {
    if (inverse_norm(i) == 0.0 && excess(i) > kFixedTolerance - kSlack) return false;
  }
  return true;
}

// Makes it that of the most violated face, if one is more than `most`.
void SplineQp::Impl::raise_row(std::span<const Face> faces, const Eigen::Vector3d& value, double most, Row* row) {
  for (const Face& face : faces) {
    const Eigen::Vector3d n(face.x, face.y, face.z);
    const double violation = n.dot(value) - face.offset;
    if (violation > most) most = violation, row->normal = n, row->bound = face.offset;
  }
}

// The violated row farthest from the curve in the metric of the cost (the first of equals); false: none is violated.
bool SplineQp::Impl::worst_row(Row* row) const {
  const auto score = (excess.head(num_bounded) - kTolerance) * inverse_norm.head(num_bounded);
  const double largest = score.maxCoeff();
  if (!(largest > 0.0)) return false;
  row->output = 0;
  while (score(row->output) < largest) ++row->output;

  const Eigen::Vector3d value = outputs.row(row->output);
  const int point = row->output - num_acc - num_vel;
  if (point < 0 || row->output >= first_jerk) {
    int axis;
    value.cwiseAbs().maxCoeff(&axis);
    row->normal = std::copysign(1.0, value(axis)) * Eigen::Vector3d::Unit(axis);
    row->bound = row->output >= first_jerk ? jerk_limit : row->output < num_acc ? acc_limit : vel_limit;
    if (row->output < num_acc) raise_row(acc_faces, value, row->normal.dot(value) - row->bound, row);
    return true;
  }
  const int first_piece = (point - 1) / degree, last_piece = std::min(point / degree, pieces - 1);
  raise_row(faces_of(first_piece, last_piece), value, -kInfinity, row);
  return true;
}

// Writes the row as a unit normal over y; returns its violation and bound there. Infinite: no y can mend it.
double SplineQp::Impl::enter(const Row& row, double* bound) {
  const double length = row.normal.norm();
  if (!(length > 0.0)) return kInfinity;
  const double scale = inverse_norm(row.output) / length;
  for (int axis = 0; axis < 3; ++axis) {
    normal.segment(axis * freedom, freedom) = (scale * row.normal(axis)) * response.row(row.output).transpose();
  }
  const double violation = scale * (outputs.row(row.output).dot(row.normal) - row.bound);
  *bound = normal.dot(y) - violation;
  return violation;
}

SplineStatus SplineQp::Impl::optimise(int* iterations) {
  const int limit = 200 + 20 * 3 * freedom;
  const double cap = jerk_cap * square(acc_limit + kFixedTolerance);
  for (bool exact = true;;) {
    Row row;
    if (!worst_row(&row)) {
      if (exact || active.refine(&y) * max_norm <= kDrift) return SplineStatus::kSolved;
      exact = true;
      evaluate();
      continue;
    }
    exact = false;
    double bound = 0.0, multiplier = 0.0;
    double violation = enter(row, &bound);
    if (violation == kInfinity) return SplineStatus::kInfeasible;
    for (;;) {
      if (++*iterations > limit) return SplineStatus::kIterationLimit;
      const double remainder = active.split(normal);
      double until_blocked;
      const int blocker = active.blocker(&until_blocked);
      const double until_met = remainder > 0.0 ? std::max(violation, 0.0) / (remainder * remainder) : kInfinity;
      // A non-negative combination of rows that no y can satisfy (Farkas).
      if (blocker < 0 && until_met == kInfinity) return SplineStatus::kInfeasible;
      const double growth = std::min(until_met, until_blocked);
      active.grow(growth);
      multiplier += growth;
      if (remainder > 0.0) {
        y.noalias() -= growth * active.remainder();
        violation = normal.dot(y) - bound;
      }
      if (until_met <= until_blocked) {
        active.add(remainder, bound, multiplier);
        break;
      }
      active.drop(blocker);
    }
    // y is optimal for a part of the rows, so its cost bounds the problem's from below (weak duality).
    if (y.squaredNorm() > cap) return SplineStatus::kInfeasible;
    evaluate();
  }
}

void SplineQp::Impl::report(const SplineProblem& problem, SplineSolution* solution) const {
  solution->control_points.resize(3, pieces * (degree + 1));
  solution->jerk_integral = 0.0;
  for (int k = 0; k < pieces; ++k) {
    for (int j = 0; j <= degree; ++j) {
      solution->control_points.col(k * (degree + 1) + j) =
          problem.start.position + outputs.row(num_acc + num_vel + k * degree + j).transpose();
    }
    const auto acc = outputs.middleRows(k * (degree - 2), degree - 1);
    solution->jerk_integral += root.lazyProduct(acc).squaredNorm() / duration_s(k);
  }
  solution->max_violation = std::max(0.0, excess.head(num_bounded).maxCoeff() + kSlack);
}

SplineQp::SplineQp(int degree, const std::vector<double>& durations_s, const std::vector<double>& jerk_weights) {
  const int pieces = static_cast<int>(durations_s.size());
  if (degree < 3 || degree > kMaxDegree) reject("degree", std::to_string(degree), "in [3, 9]");
  if (pieces < 1 || pieces > kMaxPieces) reject("pieces", std::to_string(pieces), "in [1, 64]");
  for (std::size_t i = 0; i < durations_s.size(); ++i) {
    if (std::isfinite(durations_s[i]) && durations_s[i] > 0.0) continue;
    reject("durations_s[" + std::to_string(i) + "]", std::to_string(durations_s[i]), "positive and finite");
  }
  if (pieces * (degree - 2) < 3) {
    reject("pieces", std::to_string(pieces),
           "enough for the end states, pieces * (degree - 2) >= 3, at degree " + std::to_string(degree));
  }
  if (!jerk_weights.empty() && std::ssize(jerk_weights) != pieces) {
    reject("jerk_weights.size()", std::to_string(jerk_weights.size()),
           "the number of pieces, " + std::to_string(pieces));
  }
  for (std::size_t i = 0; i < jerk_weights.size(); ++i) {
    if (jerk_weights[i] > 0.0 && jerk_weights[i] <= 1.0) continue;
    reject("jerk_weights[" + std::to_string(i) + "]", std::to_string(jerk_weights[i]), "in (0, 1]");
  }
  impl_ = std::make_unique<Impl>(degree, durations_s, jerk_weights);
}

SplineQp::~SplineQp() = default;
SplineQp::SplineQp(SplineQp&&) noexcept = default;

SplineStatus SplineQp::solve(const SplineProblem& problem, SplineSolution* solution) {
  const int corridors = static_cast<int>(problem.corridors.size());
  if (corridors != impl_->pieces) {
    reject("corridors.size()", std::to_string(corridors), "the number of pieces, " + std::to_string(impl_->pieces));
  }
  if (!(problem.v_max_mps > 0.0)) reject("v_max_mps", std::to_string(problem.v_max_mps), "> 0 m/s");
  if (!(problem.a_max_mps2 > 0.0)) reject("a_max_mps2", std::to_string(problem.a_max_mps2), "> 0 m/s^2");
  if (!(problem.j_max_mps3 >= 0.0)) reject("j_max_mps3", std::to_string(problem.j_max_mps3), ">= 0 m/s^3");
  const bool valid = impl_->load(problem);
  impl_->evaluate();
  solution->iterations = 0;
  const SplineStatus status =
      valid && impl_->fixed_outputs_hold() ? impl_->optimise(&solution->iterations) : SplineStatus::kInfeasible;
  impl_->report(problem, solution);
  return status;
}

}  // namespace swarm
