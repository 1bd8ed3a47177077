// Maximise log det B subject to |B a_i| <= b_i - a_i . d: the ellipsoid { B u + d } in the polytope { a_i . x <= b_i }.
// Newton's method on the barrier  -t log det B - sum_i log((b_i - a_i . d)^2 - |B a_i|^2)  over the nine unknowns
// y = (B11, B21, B31, B22, B32, B33, d), t rising.
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "lcmtypes/bus/portable_math.h"
#include "planner_daemon/corridor/firi.h"

namespace swarm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector10d = Eigen::Matrix<double, 10, 1>;  // nine unknowns and a zero
using Matrix10d = Eigen::Matrix<double, 10, 10>;
using NormalsRef = Eigen::Ref<const Normals>;
using OffsetsRef = Eigen::Ref<const Eigen::VectorXd>;

constexpr int kMaxNewtonSteps = 60;
constexpr double kNearest =
    0.8;  // fraction of the way to the faces that a step may go: from too near one it returns slowly
constexpr double kShortestStep = 1e-6;
constexpr double kStart = 0.9;         // of the radius of the ball around the given point
constexpr double kFirstWeight = 30.0;  // t
constexpr double kGrowth = 10.0;       // of t
constexpr double kCentred = 5.0;       // squared Newton decrement at which t may rise
constexpr double kFinished = 1.0;      // and at which the last t is done with
constexpr int kRow[6] = {0, 1, 2, 1, 2, 2};
constexpr int kColumn[6] = {0, 0, 0, 1, 1, 2};

// A step in the unknowns as a change of shape and centre.
Ellipsoid unpack(const Vector10d& step) {
  Ellipsoid change;
  for (int k = 0; k < 6; ++k) {
    change.shape(kRow[k], kColumn[k]) = change.shape(kColumn[k], kRow[k]) = step(k);
  }
  change.center = step.segment<3>(6);
  return change;
}

// The length at which the first face is touched along `change`; infinite if none is.
double length_to_faces(const NormalsRef& normals, const OffsetsRef& offsets, const Ellipsoid& e,
                       const Ellipsoid& change) {
  double most = 0.0;  // of the lengths' inverses
  for (Eigen::Index i = 0; i < offsets.size(); ++i) {
    const Vector3d a = normals.row(i);
    const Vector3d w = e.shape * a, dw = change.shape * a;
    const double s = offsets(i) - a.dot(e.center), ds = -a.dot(change.center);
    // s^2 - |B a|^2 = q0 + 2 q1 length + q2 length^2
    const double q0 = s * s - w.squaredNorm(), q1 = s * ds - w.dot(dw), q2 = ds * ds - dw.squaredNorm();
    const double discriminant = q1 * q1 - q0 * q2;
    if (discriminant >= 0.0) most = std::max(most, (std::sqrt(discriminant) - q1) / q0);
  }
  return 1.0 / most;
}

// The two terms of the barrier, t apart; not a number outside its domain.
struct Barrier {
  double log_volume = NAN;  // log det B
  double log_slacks = NAN;  // sum of log(s^2 - |B a|^2), s = b - a . d
  double value(double t) const { return -t * log_volume - log_slacks; }
};

Barrier barrier(const NormalsRef& normals, const OffsetsRef& offsets, const Ellipsoid& e) {
  const Matrix3d& B = e.shape;
  const double determinant = B.determinant();
  if (!(B(0, 0) > 0.0 && B(0, 0) * B(1, 1) > B(1, 0) * B(1, 0) && determinant > 0.0)) return {};
  double sum = 0.0, product = 1.0;  // one logarithm for many faces
  for (Eigen::Index i = 0; i < offsets.size(); ++i) {
    const Vector3d a = normals.row(i);
    const double s = offsets(i) - a.dot(e.center);
    const double q = s * s - (B * a).squaredNorm();
    if (!(s > 0.0 && q > 0.0)) return {};
    product *= q;
    if (product < 1e-100 || product > 1e100) {
      sum += logarithm(product);
      product = 1.0;
    }
  }
  return {logarithm(determinant), sum + logarithm(product)};
}

// Lower triangle of `hessian` += the sum of g g' over the columns g of a block, which is cheapest one column of the
// Hessian at a time.
constexpr int kBlock = 16;
using Block = Eigen::Matrix<double, 10, kBlock>;  // an even number of rows, for the vector unit
template <int k = 0>
void add_squares(const Block& block, int count, Matrix10d* hessian) {
  if constexpr (k < 9) {
    constexpr int kRows = 10 - k / 2 * 2;
    Eigen::Matrix<double, kRows, 1> sum = Eigen::Matrix<double, kRows, 1>::Zero();
    for (int i = 0; i < count; ++i) sum += block(k, i) * block.col(i).tail<kRows>();
    hessian->col(k).tail<kRows>() += sum;
    add_squares<k + 1>(block, count, hessian);
  }
}

// Gradient and Hessian (lower triangle) of the barrier.
void derivatives(const NormalsRef& normals, const OffsetsRef& offsets, const Ellipsoid& e, double t,
                 Vector10d* gradient, Matrix10d* hessian) {
  gradient->setZero();
  hessian->setZero();
  Block block;
  int count = 0;
  Matrix3d P = Matrix3d::Zero();  // sum of (2 / q) a a', which carries the second derivatives of q = s^2 - |B a|^2
  for (Eigen::Index i = 0; i < offsets.size(); ++i) {
    const Vector3d a = normals.row(i);
    const Vector3d w = e.shape * a;
    const double s = offsets(i) - a.dot(e.center);
    const double c = 2.0 / (s * s - w.squaredNorm());
    auto g = block.col(count++);  // gradient of -log q
    g << w(0) * a(0), w(0) * a(1) + w(1) * a(0), w(0) * a(2) + w(2) * a(0), w(1) * a(1), w(1) * a(2) + w(2) * a(1),
        w(2) * a(2), s * a, 0.0;
    g *= c;
    *gradient += g;
    P.noalias() += (c * a) * a.transpose();
    if (count == kBlock || i + 1 == offsets.size()) add_squares(block, std::exchange(count, 0), hessian);
  }
  Matrix10d& H = *hessian;
  H(0, 0) += P(0, 0), H(1, 0) += P(1, 0), H(2, 0) += P(2, 0);
  H(1, 1) += P(0, 0) + P(1, 1), H(2, 1) += P(2, 1), H(3, 1) += P(1, 0), H(4, 1) += P(2, 0);
  H(2, 2) += P(0, 0) + P(2, 2), H(4, 2) += P(1, 0), H(5, 2) += P(2, 0);
  H(3, 3) += P(1, 1), H(4, 3) += P(2, 1);
  H(4, 4) += P(1, 1) + P(2, 2), H(5, 4) += P(2, 1);
  H(5, 5) += P(2, 2);
  H.block<3, 3>(6, 6) -= P;

  const Matrix3d M = e.shape.inverse();  // -log det B: gradient -<M, E_k>, Hessian tr(M E_j M E_k)
  for (int k = 0; k < 6; ++k) {
    const double twice_k = kRow[k] == kColumn[k] ? 1.0 : 2.0;
    (*gradient)(k) -= t * twice_k * M(kRow[k], kColumn[k]);
    for (int j = k; j < 6; ++j) {
      const double weight = 0.5 * twice_k * (kRow[j] == kColumn[j] ? 1.0 : 2.0);
      H(j, k) += t * weight *
                 (M(kRow[j], kRow[k]) * M(kColumn[j], kColumn[k]) + M(kRow[j], kColumn[k]) * M(kColumn[j], kRow[k]));
    }
  }
}

// x := H^-1 x for the first nine unknowns, by L D L' in the place of H (lower triangle). False if H is not positive
// definite.
bool solve(Matrix10d* hessian, Vector10d* x) {
  Matrix10d& H = *hessian;
  double inverse[9];
  for (int k = 0; k < 9; ++k) {
    if (!(H(k, k) > 0.0)) return false;
    inverse[k] = 1.0 / H(k, k);
    for (int j = k + 1; j < 9; ++j) {
      const double factor = H(j, k) * inverse[k];
      for (int i = j; i < 9; ++i) H(i, j) -= factor * H(i, k);
      (*x)(j) -= factor * (*x)(k);
    }
  }
  for (int k = 8; k >= 0; --k) {
    (*x)(k) *= inverse[k];
    for (int j = 0; j < k; ++j) (*x)(j) -= H(k, j) * (*x)(k);
  }
  return true;
}

}  // namespace

bool inscribed_ellipsoid(const NormalsRef& normals, const OffsetsRef& offsets, const Vector3d& inside,
                         double log_volume_gap, Ellipsoid* ellipsoid) {
  double radius = INFINITY;
  for (Eigen::Index i = 0; i < offsets.size(); ++i) {
    radius = std::min(radius, offsets(i) - normals.row(i).dot(inside.transpose()));
  }
  if (!(radius > 0.0) || !std::isfinite(radius)) return false;

  Ellipsoid best{kStart * radius * Matrix3d::Identity(), inside};
  Barrier value = barrier(normals, offsets, best);
  const double t_end = 2.0 * static_cast<double>(offsets.size()) / log_volume_gap;
  double t = std::min(kFirstWeight, t_end);
  Vector10d gradient;
  Matrix10d hessian;
  for (int newton = 0; newton < kMaxNewtonSteps; ++newton) {
    derivatives(normals, offsets, best, t, &gradient, &hessian);
    Vector10d step = -gradient;
    if (!solve(&hessian, &step)) break;  // too flat for the arithmetic: keep what is inside
    const double decrement = -gradient.dot(step);
    const Ellipsoid change = unpack(step);
    double length = std::min(1.0, kNearest * length_to_faces(normals, offsets, best, change));
    Ellipsoid trial{best.shape + length * change.shape, best.center + length * change.center};
    Barrier trial_value = barrier(normals, offsets, trial);
    while (!(trial_value.value(t) <= value.value(t) - 0.1 * length * decrement) && length > kShortestStep) {
      length *= 0.5;
      trial = {best.shape + length * change.shape, best.center + length * change.center};
      trial_value = barrier(normals, offsets, trial);
    }
    if (length <= kShortestStep) break;
    best = trial;
    value = trial_value;
    if (t >= t_end && decrement < kFinished) break;
    if (decrement < kCentred) t = std::min(t_end, kGrowth * t);
  }

  double growth = INFINITY;  // until the first face is touched, a trifle less
  for (Eigen::Index i = 0; i < offsets.size(); ++i) {
    const Vector3d a = normals.row(i);
    growth = std::min(growth, (offsets(i) - a.dot(best.center)) / (best.shape * a).norm());
  }
  best.shape *= growth * (1.0 - 1e-10);
  *ellipsoid = best;
  return true;
}

bool inscribed_ellipsoid(const Polytope& polytope, const Vector3d& inside, double log_volume_gap,
                         Ellipsoid* ellipsoid) {
  return inscribed_ellipsoid(polytope.normals, polytope.offsets, inside, log_volume_gap, ellipsoid);
}

}  // namespace swarm
