// The working set of a dual active set method (Goldfarb and Idnani, Math. Programming 27, 1983) for: minimise |y|^2 / 2
// subject to rows normal . y <= bound with unit normals. Holds the active rows' normals as N = Q R, Q orthonormal, so
// that nearly dependent rows do no harm, with their bounds and multipliers. Allocates only in the constructor.
#pragma once

#include <Eigen/Dense>
#include <Eigen/Jacobi>
#include <algorithm>
#include <limits>

#include "planner_daemon/optimize/long_columns.h"

namespace swarm {

class ActiveSet {
 public:
  explicit ActiveSet(int dimension)
      : dimension_(dimension),
        q_(Eigen::MatrixXd::Zero((dimension + 3) / 4 * 4, dimension)),
        r_(dimension, dimension),
        bounds_(dimension),
        multipliers_(dimension),
        coordinates_(dimension),
        correction_(dimension),
        coefficients_(dimension),
        remainder_(Eigen::VectorXd::Zero(q_.rows())) {}

  void clear() { size_ = 0; }

  // normal = N coefficients + remainder, the remainder orthogonal to N. Returns the remainder's length.
  double split(const Eigen::VectorXd& normal) {
    const LongColumns q{q_.data(), static_cast<std::size_t>(q_.rows()), static_cast<std::size_t>(size_)};
    remainder_.head(dimension_) = normal;
    inner_products(q, remainder_.data(), coordinates_.data());
    take_away(q, coordinates_.data(), remainder_.data());
    double length = remainder_.norm();
    // Twice is enough: orthogonality would suffer from cancellation in one pass.
    if (size_ > 0 && length < 0.7) {
      inner_products(q, remainder_.data(), correction_.data());
      take_away(q, correction_.data(), remainder_.data());
      coordinates_.head(size_) += correction_.head(size_);
      length = remainder_.norm();
    }
    auto coefficients = coefficients_.head(size_);
    coefficients = coordinates_.head(size_);
    r_.topLeftCorner(size_, size_).triangularView<Eigen::Upper>().solveInPlace(coefficients);
    return size_ < dimension_ && length > kDependent ? length : 0.0;
  }
  auto remainder() const { return remainder_.head(dimension_); }

  // The row whose multiplier vanishes first while the split normal's grows, and the growth until then; -1: none does.
  int blocker(double* growth) const {
    int first = -1;
    *growth = kInfinity;
    if (size_ == 0) return first;
    const double threshold = kBlocking * std::max(1.0, coefficients_.head(size_).cwiseAbs().maxCoeff());
    for (int i = 0; i < size_; ++i) {
      const double ratio = coefficients_(i) > threshold ? multipliers_(i) / coefficients_(i) : kInfinity;
      if (ratio < *growth) *growth = ratio, first = i;
    }
    return first;
  }
  void grow(double growth) {
    multipliers_.head(size_) = (multipliers_.head(size_) - growth * coefficients_.head(size_)).cwiseMax(0.0);
  }

  // Adds the row that was split last.
  void add(double remainder_length, double bound, double multiplier) {
    q_.col(size_) = remainder_ / remainder_length;
    r_.col(size_).head(size_) = coordinates_.head(size_);
    r_(size_, size_) = remainder_length;
    bounds_(size_) = bound;
    multipliers_(size_) = multiplier;
    ++size_;
  }

  void drop(int index) {
    --size_;
    for (int i = index; i < size_; ++i) {
      r_.col(i).head(i + 2) = r_.col(i + 1).head(i + 2);
      bounds_(i) = bounds_(i + 1);
      multipliers_(i) = multipliers_(i + 1);
    }
    for (int i = index; i < size_; ++i) {
      Eigen::JacobiRotation<double> rotation;
      rotation.makeGivens(r_(i, i), r_(i + 1, i));
      r_.middleCols(i, size_ - i).applyOnTheLeft(i, i + 1, rotation.adjoint());
      q_.applyOnTheRight(i, i + 1, rotation);
    }
  }

  // Moves y so that every active row lies exactly on its bound; returns the length of the move.
  double refine(Eigen::VectorXd* y) {
    const auto q = q_.topLeftCorner(dimension_, size_);
    auto target = coordinates_.head(size_);
    target = bounds_.head(size_);
    r_.topLeftCorner(size_, size_).triangularView<Eigen::Upper>().transpose().solveInPlace(target);
    auto correction = correction_.head(size_);
    correction.noalias() = q.transpose() * *y;
    correction = target - correction;
    y->noalias() += q * correction;
    return correction.norm();
  }

 private:
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  static constexpr double kDependent = 1e-12;  // a unit normal this close to the active ones' span depends on them
  static constexpr double kBlocking = 1e-10;   // smaller coefficients of a normal in the active ones are rounding

  int dimension_;
  Eigen::MatrixXd q_;  // rows padded with zeros
  Eigen::MatrixXd r_;
  Eigen::VectorXd bounds_, multipliers_;
  Eigen::VectorXd coordinates_, correction_, coefficients_;
  Eigen::VectorXd remainder_;  // padded likewise
  int size_ = 0;
};

}  // namespace swarm
