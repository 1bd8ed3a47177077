#include "planner_daemon/corridor/firi.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace swarm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kBoxFaces = 6;           // without more of them there is nothing to gain
constexpr double kTouching_m = 5e-10;  // distances below are taken for contact

struct Constraint {
  Vector3d normal;
  double bound;
};

// The shortest x with normal . x >= bound for all constraints, of which worst(x) yields the one most violated at x: the
// dual active set method of Goldfarb and Idnani with unit Hessian. False if there is none (or not within the
// arithmetic).
template <typename Worst>
bool shortest_vector(const Worst& worst, Vector3d* x) {
  constexpr int kMaxSteps = 60;
  Vector3d active[3];
  double multiplier[3];
  int count = 0;
  x->setZero();
  for (int step = 0; step < kMaxSteps; ++step) {
    const auto [normal, bound] = worst(std::as_const(*x));
    double violation = bound - normal.dot(*x);
    if (violation <= 1e-11 + 1e-14 * normal.norm() * x->norm()) return true;
    double own_multiplier = 0.0;
    for (bool added = false; !added;) {
      // Orthonormal basis e of the active normals, active = e R; the normal's part z outside their span.
      Vector3d e[3], y = Vector3d::Zero(), z = normal;
      Matrix3d R = Matrix3d::Zero();
      for (int j = 0; j < count; ++j) {
        Vector3d rest = active[j];
        if (j == 2) {
          rest = e[0].cross(e[1]);  // exact where differences cancel
          R(0, 2) = e[0].dot(active[2]), R(1, 2) = e[1].dot(active[2]), R(2, 2) = rest.dot(active[2]);
        } else {
          for (int i = 0; i < 2 * j; ++i) {  // twice, for orthogonality to the last bit
            const double part = e[0].dot(rest);
            R(0, j) += part;
            rest -= part * e[0];
          }
          R(j, j) = rest.norm();
          rest /= R(j, j);
        }
        e[j] = rest;
        y(j) = e[j].dot(normal);
      }
      if (count == 1) {
        z -= y(0) * e[0];
        z -= e[0].dot(z) * e[0];
      } else if (count == 2) {
        const Vector3d third = e[0].cross(e[1]);
        z = third.dot(normal) * third;
      } else if (count == 3) {
        z.setZero();
      }
      for (int j = count - 1; j >= 0; --j) {  // y := R^-1 y, how fast the multipliers shrink
        for (int i = j + 1; i < count; ++i) y(j) -= R(j, i) * y(i);
        y(j) /= R(j, j);
      }

      int blocking = -1;
      double length = INFINITY;
      for (int j = 0; j < count; ++j) {
        if (y(j) > 0.0 && multiplier[j] < length * y(j)) length = multiplier[j] / y(j), blocking = j;
      }
      const double slope = z.squaredNorm();
      const bool free = slope > 1e-22 * normal.squaredNorm();
      if (free && violation <= length * slope) length = violation / slope, blocking = -1;
      if (!std::isfinite(length)) return false;

      if (free) *x += length * z, violation -= length * slope;
      for (int j = 0; j < count; ++j) multiplier[j] -= length * y(j);
      own_multiplier += length;
      added = blocking < 0;
      if (added) {
        active[count] = normal;
        multiplier[count++] = own_multiplier;
      } else {
        --count;
        for (int j = blocking; j < count; ++j) active[j] = active[j + 1], multiplier[j] = multiplier[j + 1];
      }
    }
  }
  return false;
}

}  // namespace

const char* to_string(FiriStatus status) {
  switch (status) {
    case FiriStatus::kGrown:
      return "grown";
    case FiriStatus::kSeedBlocked:
      return "seed blocked";
    case FiriStatus::kTooManyFaces:
      return "too many faces";
  }
  return "unknown";
}

FiriStatus Firi::grow(const Eigen::Ref<const Eigen::Matrix3Xd>& seed, std::span<const PointRun> obstacles,
                      const Vector3d& lower, const Vector3d& upper, const FiriOptions& options, Polytope* polytope) {
  if (seed.cols() < 1) throw std::invalid_argument("Firi: seed has 0 points, must have at least 1");
  if (options.iterations < 1) {
    throw std::invalid_argument("FiriOptions: iterations = " + std::to_string(options.iterations) + ", must be >= 1");
  }
  if (!(options.half_extent_m >= 0.0 && std::isfinite(options.half_extent_m))) {
    throw std::invalid_argument("FiriOptions: half_extent_m = " + std::to_string(options.half_extent_m) +
                                ", must be finite and >= 0");
  }
  if (!(options.spacing_m >= 0.0 && std::isfinite(options.spacing_m))) {
    throw std::invalid_argument("FiriOptions: spacing_m = " + std::to_string(options.spacing_m) +
                                ", must be finite and >= 0");
  }
  if (!(options.log_volume_gap > 0.0)) {
    throw std::invalid_argument("FiriOptions: log_volume_gap = " + std::to_string(options.log_volume_gap) +
                                ", must be > 0");
  }
  seed_.clear();
  for (Eigen::Index i = 0; i < seed.cols(); ++i) seed_.push_back(seed.col(i));

  Ellipsoid ellipsoid;
  ellipsoid.center = seed.rowwise().mean();
  FiriStatus status = cut(ellipsoid, obstacles, lower, upper, options);
  for (int i = 1; i < options.iterations && num_faces_ > kBoxFaces && inflate(options.log_volume_gap, &ellipsoid);
       ++i) {
    status = cut(ellipsoid, obstacles, lower, upper, options);
  }
  if (num_faces_ > Polytope::kMaxFaces) {
    polytope->normals.resize(0, 3);
    polytope->offsets.resize(0);
    return FiriStatus::kTooManyFaces;
  }
  polytope->normals = normals_.topRows(num_faces_);
  polytope->offsets = offsets_.head(num_faces_);
  return status;
}

// The box cut by one plane after the other, nearest obstacle first.
FiriStatus Firi::cut(const Ellipsoid& ellipsoid, std::span<const PointRun> obstacles, const Vector3d& lower,
                     const Vector3d& upper, const FiriOptions& options) {
  num_faces_ = 0;
  for (int axis = 0; axis < 3; ++axis) {
    add_face(Vector3d::Unit(axis), upper(axis));
    add_face(-Vector3d::Unit(axis), -lower(axis));
  }
  const Matrix3d to_ball = ellipsoid.shape.inverse();
  seed_in_ball_.resize(seed_.size());
  for (size_t i = 0; i < seed_.size(); ++i) seed_in_ball_[i] = to_ball * (seed_[i] - ellipsoid.center);
  spacing_m_ = options.spacing_m;
  spacing_in_ball_ = spacing_m_ * to_ball.col(2);

  const Vector3d outer_lower = lower.array() - options.half_extent_m,
                 outer_upper = upper.array() + options.half_extent_m;
  candidates_.clear();
  for (const PointRun& run : obstacles) {
    const auto outside = [&](int axis, double at) { return at <= outer_lower(axis) || at >= outer_upper(axis); };
    if (outside(0, run.first.x()) || outside(1, run.first.y())) continue;  // the box excludes it
    Candidate candidate{run.first, to_ball * (run.first - ellipsoid.center), 0, run.count - 1, 0, 0.0};
    while (candidate.first <= candidate.last && outside(2, run.first.z() + candidate.first * spacing_m_))
      ++candidate.first;
    while (candidate.first <= candidate.last && outside(2, run.first.z() + candidate.last * spacing_m_))
      --candidate.last;
    if (candidate.first > candidate.last) continue;
    find_nearest(&candidate);
    candidates_.push_back(candidate);
  }

  FiriStatus status = FiriStatus::kGrown;
  for (std::size_t next = nearest_candidate(); next < candidates_.size();) {
    const Vector3d obstacle = candidates_[next].base + candidates_[next].nearest * spacing_m_ * Vector3d::UnitZ();
    take_out_nearest(next);
    const int num_faces_before = num_faces_;
    if (!separate(obstacle, to_ball, ellipsoid.center, options.half_extent_m)) status = FiriStatus::kSeedBlocked;
    if (num_faces_ == num_faces_before) {
      next = nearest_candidate();
      continue;
    }
    // Drop what the new face excludes, cube and all.
    const Vector3d normal = normals_.row(num_faces_ - 1);
    const double limit = offsets_(num_faces_ - 1) + options.half_extent_m * normal.lpNorm<1>() - kTouching_m;
    std::size_t left = 0;
    double least = INFINITY;
    for (Candidate& candidate : candidates_) {
      if (!trim(normal, limit, &candidate)) continue;
      if (candidate.squared_distance < least) least = candidate.squared_distance, next = left;
      if (&candidate != &candidates_[left]) candidates_[left] = candidate;
      ++left;
    }
    candidates_.resize(left);
    if (left == 0) break;
  }
  return status;
}

// The first of equals; the number of candidates where there is none.
std::size_t Firi::nearest_candidate() const {
  const auto nearer = [](const Candidate& a, const Candidate& b) { return a.squared_distance < b.squared_distance; };
  return static_cast<std::size_t>(std::min_element(candidates_.begin(), candidates_.end(), nearer) -
                                  candidates_.begin());
}

// Distances are convex along a run.
void Firi::find_nearest(Candidate* candidate) const {
  const double length2 = spacing_in_ball_.squaredNorm();
  const double wanted = length2 > 0.0 ? -candidate->in_ball.dot(spacing_in_ball_) / length2 : 0.0;
  candidate->nearest = static_cast<int>(std::clamp<double>(wanted, candidate->first, candidate->last) + 0.5);
  candidate->squared_distance = (candidate->in_ball + candidate->nearest * spacing_in_ball_).squaredNorm();
}

void Firi::take_out_nearest(std::size_t index) {
  Candidate& below = candidates_[index];
  Candidate above = below;
  above.first = below.nearest + 1;
  below.last = below.nearest - 1;
  const bool any_below = below.first <= below.last, any_above = above.first <= above.last;
  if (any_below) find_nearest(&below);
  if (any_above) find_nearest(&above);
  if (any_below && any_above) {
    candidates_.push_back(above);
  } else if (any_above) {
    below = above;
  } else if (!any_below) {
    below = candidates_.back();
    candidates_.pop_back();
  }
}

// Takes away the points with normal . point >= limit; false: all of them.
bool Firi::trim(const Vector3d& normal, double limit, Candidate* candidate) const {
  const double step = spacing_m_ * normal.z(), base = normal.dot(candidate->base);
  const bool first_in = base + candidate->first * step < limit, last_in = base + candidate->last * step < limit;
  if (!first_in && !last_in) return false;
  if (first_in && last_in) return true;
  const double crossing = (limit - base) / step;  // between the first and the last
  if (first_in) {
    candidate->last = std::clamp(static_cast<int>(std::ceil(crossing)) - 1, candidate->first, candidate->last);
  } else {
    candidate->first = std::clamp(static_cast<int>(std::floor(crossing)) + 1, candidate->first, candidate->last);
  }
  if (candidate->nearest < candidate->first || candidate->nearest > candidate->last) find_nearest(candidate);
  return true;
}

// Adds the face farthest from the ellipsoid's centre, in its metric, between the seed and the obstacle's cube: with
// u = to_ball (x - center) and the face a . u = 1, the shortest a with a . u <= 1 on the seed and >= 1 on the cube (the
// restrictive half-space of FIRI). False if not even the obstacle's centre can be excluded.
bool Firi::separate(const Vector3d& obstacle, const Matrix3d& to_ball, const Vector3d& center, double half_extent_m) {
  const Vector3d in_ball = to_ball * (obstacle - center);
  const auto worst = [&](const Vector3d& a) -> Constraint {
    const Vector3d direction = to_ball * (a.isZero(0.0) ? in_ball : a);
    Vector3d corner = in_ball;
    for (int axis = 0; axis < 3; ++axis) corner -= std::copysign(half_extent_m, direction(axis)) * to_ball.col(axis);
    double violation = 1.0 - a.dot(corner);
    Constraint result{corner, 1.0};
    for (const Vector3d& point : seed_in_ball_) {
      if (a.dot(point) - 1.0 > violation) {
        violation = a.dot(point) - 1.0;
        result = {-point, -1.0};
      }
    }
    return result;
  };
  Vector3d a;
  if (shortest_vector(worst, &a)) {
    const Vector3d normal = (to_ball * a).normalized();
    const double wanted = normal.dot(obstacle) - half_extent_m * normal.lpNorm<1>(), seed_support = support(normal);
    if (seed_support <= wanted + kTouching_m) {
      add_face(normal, std::max(wanted, seed_support));
      return true;
    }
  }
  return separate_closest(obstacle);
}

// For an obstacle whose cube overlaps the hull of the seed: the face touches the hull at its point closest to the
// obstacle's centre.
bool Firi::separate_closest(const Vector3d& obstacle) {
  const auto worst = [&](const Vector3d& a) -> Constraint {
    Vector3d nearest = obstacle - seed_[0];
    for (const Vector3d& point : seed_) {
      const Vector3d difference = obstacle - point;
      if (a.isZero(0.0) ? difference.squaredNorm() < nearest.squaredNorm() : a.dot(difference) < a.dot(nearest)) {
        nearest = difference;
      }
    }
    return {nearest, 1.0};
  };
  Vector3d a;
  if (!shortest_vector(worst, &a)) return false;
  const Vector3d normal = a.normalized();
  const double offset = support(normal), margin = normal.dot(obstacle) - offset;
  if (!(margin >= 2.0 * kTouching_m)) return false;
  // Another face may keep as much of the cube out already.
  for (int i = 0; i < num_faces_; ++i) {
    const double other = normals_.row(i).dot(obstacle.transpose()) - offsets_(i);
    if (other * normal.lpNorm<1>() >= (margin - kTouching_m) * normals_.row(i).lpNorm<1>()) return true;
  }
  add_face(normal, offset);
  return true;
}

// Finds the largest ellipsoid in the faces; false if they enclose nothing worth it.
bool Firi::inflate(double log_volume_gap, Ellipsoid* ellipsoid) const {
  // An interior point: the closest to the present centre with a ball of some radius around it.
  const auto normals = normals_.topRows(num_faces_);
  const auto offsets = offsets_.head(num_faces_);
  for (double radius_m = 0.2; radius_m > 1e-5; radius_m *= 0.5) {
    const auto worst = [&](const Vector3d& shift) -> Constraint {
      const Vector3d moved = ellipsoid->center + shift;
      int face = 0;
      double most = -INFINITY;
      for (int i = 0; i < num_faces_; ++i) {
        const double violation = normals_.row(i).dot(moved.transpose()) - offsets_(i);
        if (violation > most) most = violation, face = i;
      }
      const Vector3d normal = normals_.row(face);
      return {-normal, radius_m - offsets_(face) + normal.dot(ellipsoid->center)};
    };
    Vector3d shift;
    if (shortest_vector(worst, &shift)) {
      return inscribed_ellipsoid(normals, offsets, ellipsoid->center + shift, log_volume_gap, ellipsoid);
    }
  }
  return false;
}

double Firi::support(const Vector3d& normal) const {
  double most = -INFINITY;
  for (const Vector3d& point : seed_) most = std::max(most, normal.dot(point));
  return most;
}

void Firi::add_face(const Vector3d& normal, double offset) {
  if (num_faces_ == offsets_.size()) {
    const Eigen::Index capacity = std::max<Eigen::Index>(64, 2 * num_faces_);
    normals_.conservativeResize(capacity, 3);
    offsets_.conservativeResize(capacity);
  }
  normals_.row(num_faces_) = normal;
  offsets_(num_faces_++) = offset;
}

}  // namespace swarm
