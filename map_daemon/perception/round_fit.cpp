#include "map_daemon/perception/round_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory_resource>
#include <vector>

namespace swarm {
namespace {

constexpr int kIterations = 10;
constexpr double kStep_m = 0.3;  // at most, in an iteration
constexpr double kConverged_m = 1e-3;
constexpr double kUnknownWeight = 3.0;  // of half the width that is seen, where nothing is known of the radius
constexpr std::size_t kEndsOf = 8;      // one of so many points at either end
constexpr double kGuess = 0.08;         // by this share of it a radius errs that the width alone tells
constexpr double kMostHalf = 0.9;       // sine of half of the angle that a circle covers, at most
constexpr double kLeastRadius_m = 0.02;
constexpr double kMaxWeight = 400.0;  // a radius stays correctable
constexpr double kTrust = 2.0;        // times the noise: points twice as far off count a fifth
constexpr double kInCommon = 4.0;     // so many neighbouring points err as one

// Numbers of points, or points themselves, of which there mostly are few: they take no memory from the heap.
template <class T>
class Few {
 public:
  explicit Few(std::size_t size) { values_.reserve(size); }
  std::pmr::vector<T>& values() { return values_; }

 private:
  std::array<std::byte, 4096> room_;
  std::pmr::monotonic_buffer_resource memory_{room_.data(), room_.size()};
  std::pmr::vector<T> values_{&memory_};
};

// The value that so many of the values are below.
double above(std::size_t number, std::pmr::vector<double>* values) {
  const auto place = values->begin() + static_cast<std::ptrdiff_t>(number);
  std::nth_element(values->begin(), place, values->end());
  return *place;
}

}  // namespace

RoundFit fit_round(std::span<const Eigen::Vector2d> points, const Eigen::Vector2d& sensor, const RadiusPrior& prior,
                   double noise_m) {
  RoundFit fit;
  const auto count = static_cast<double>(points.size());
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& point : points) middle += point / count;
  const Eigen::Vector2d way = middle - sensor;
  const Eigen::Vector2d ahead = way.norm() > 1e-6 ? Eigen::Vector2d(way.normalized()) : Eigen::Vector2d(1.0, 0.0);
  const Eigen::Vector2d aside(-ahead.y(), ahead.x());
  // Sines of angles from the middle, as the sensor sees them, and distances; strangers at the ends do not count.
  Few<double> few_sines(points.size()), few_distances(points.size());
  std::pmr::vector<double>&sines = few_sines.values(), &distances = few_distances.values();
  for (const Eigen::Vector2d& point : points) {
    distances.push_back(std::max((point - sensor).norm(), 1e-6));
    sines.push_back(aside.dot(point - sensor) / distances.back());
  }
  const std::size_t last = points.size() - 1, ends = (last + kEndsOf / 2) / kEndsOf;
  const double low = above(ends, &sines), high = above(last - ends, &sines), near_m = above(2 * ends, &distances);
  // A circle whose near side is at `near_m` covers as much.
  const double counted = last > 0 ? 1.0 - 2.0 * static_cast<double>(ends) / static_cast<double>(last) : 1.0;
  const double half = std::min(0.5 * (high - low) / counted, kMostHalf);
  const double half_width = std::max(near_m * half / (1.0 - half), kLeastRadius_m);
  const double expected_m = prior.weight > 0.0 ? prior.radius_m : half_width;
  const double weight = std::max(prior.weight, kUnknownWeight);
  double radius = expected_m;
  Eigen::Vector2d center =
      sensor + (near_m + radius) * Eigen::Vector2d(ahead + 0.5 * (low + high) * aside).normalized();

  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  for (int iteration = 0; iteration < kIterations && !fit.converged; ++iteration) {
    normal.setZero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    double squares = 0.0;
    fit.on_circle = 0;
    for (const Eigen::Vector2d& point : points) {
      const Eigen::Vector2d out = point - center;
      const double distance = std::max(out.norm(), 1e-9), error = distance - radius;
      const Eigen::Vector3d row(-out.x() / distance, -out.y() / distance, -1.0);
      const double trust = 1.0 / (1.0 + error * error / (kTrust * kTrust * noise_m * noise_m));
      normal += trust * row * row.transpose();
      right -= trust * error * row;
      if (std::abs(error) > kOnCircle * noise_m) continue;
      squares += error * error;
      ++fit.on_circle;
    }
    fit.rms_m = std::sqrt(squares / std::max(fit.on_circle, 1));
    normal(2, 2) += weight * kInCommon;
    right(2) += weight * kInCommon * (expected_m - radius);
    normal.diagonal().head<2>().array() += 1e-3 * count;  // sideways of a few points nothing is known
    Eigen::Vector3d step = normal.ldlt().solve(right);
    if (const double most = step.cwiseAbs().maxCoeff(); most > kStep_m) step *= kStep_m / most;
    center += step.head<2>();
    radius = std::max(radius + step(2), kLeastRadius_m);
    fit.converged = step.cwiseAbs().maxCoeff() < kConverged_m;
  }
  const Eigen::Matrix3d covariance = noise_m * noise_m * kInCommon * normal.inverse();
  fit.center = center;
  const double guess_m = prior.weight > 0.0 ? 0.0 : kGuess * radius;
  fit.sigma_m = std::sqrt(std::max(covariance(0, 0), covariance(1, 1)) + guess_m * guess_m);
  // What the points say of the radius, whatever the center is.
  const double of_radius = 1.0 / (normal.inverse()(2, 2) * kInCommon);
  fit.radius = {radius, std::min(of_radius, kMaxWeight)};
  return fit;
}

double curvature(std::span<const Eigen::Vector2d> points, const RoundFit& fit) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& point : points) mean += point / static_cast<double>(points.size());
  Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();
  double around_circle2 = 0.0;
  for (const Eigen::Vector2d& point : points) {
    squares += (point - mean) * (point - mean).transpose();
    const double error = (point - fit.center).norm() - fit.radius.radius_m;
    around_circle2 += error * error;
  }
  const double half = 0.5 * squares.trace();
  const double around_line2 = half - std::sqrt(std::max(half * half - squares.determinant(), 0.0));
  return around_line2 / std::max(around_circle2, 1e-12);
}

namespace {

constexpr int kTries = 80;
constexpr double kSmallest_m = 0.08, kLargest_m = 0.8;  // radii that are looked for
constexpr double kLeastSpan_m = 0.08;                   // of the three points that make a circle
constexpr std::size_t kLeastOnCircle = 12;
constexpr double kWidest = 0.6;  // cosine of the angle to the sensor that its side must be seen up to
constexpr double kBulge = 5.0;   // times the noise: what bulges less may be flat
constexpr double kInside = 0.1;  // share of points that may be inside

// Through three points; none where they are in a line, nearly.
struct Circle {
  Eigen::Vector2d center;
  double radius;
};
std::optional<Circle> circle_through(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  const Eigen::Vector2d u = b - a, v = c - a;
  const double twice = 2.0 * (u.x() * v.y() - u.y() * v.x());
  if (std::abs(twice) < 1e-6) return {};
  const double uu = u.squaredNorm(), vv = v.squaredNorm();
  const Eigen::Vector2d from_a((v.y() * uu - u.y() * vv) / twice, (u.x() * vv - v.x() * uu) / twice);
  return Circle{a + from_a, from_a.norm()};
}

struct Support {
  std::size_t on = 0, inside = 0;
  double least_cosine = 1.0;  // of the angles of the points on it to the sensor, seen from the centre
};
Support support_of(const Circle& circle, std::span<const Eigen::Vector2d> points, const Eigen::Vector2d& sensor,
                   double noise_m) {
  Support support;
  const Eigen::Vector2d to_sensor = (sensor - circle.center).normalized();
  for (const Eigen::Vector2d& point : points) {
    const Eigen::Vector2d out = point - circle.center;
    const double distance = out.norm(), error = distance - circle.radius;
    if (error < -kOnCircle * noise_m) ++support.inside;
    if (std::abs(error) > 2.5 * noise_m) continue;
    ++support.on;
    support.least_cosine = std::min(support.least_cosine, out.dot(to_sensor) / std::max(distance, 1e-9));
  }
  return support;
}

}  // namespace

// By trying three points again and again, the same ones each time.
std::optional<RoundFit> find_round(std::span<const Eigen::Vector2d> points, const Eigen::Vector2d& sensor,
                                   double noise_m) {
  if (points.size() < kLeastOnCircle) return {};
  std::uint32_t state = 1;
  const auto draw = [&](std::size_t below) {
    state = state * 1664525u + 1013904223u;
    return static_cast<std::size_t>((std::uint64_t{state} * below) >> 32);
  };
  std::optional<Circle> best;
  std::size_t most = kLeastOnCircle - 1;
  for (int i = 0; i < kTries; ++i) {
    const Eigen::Vector2d &a = points[draw(points.size())], &b = points[draw(points.size())],
                          &c = points[draw(points.size())];
    const double span = std::max({(a - b).norm(), (b - c).norm(), (c - a).norm()});
    if (span < kLeastSpan_m || span > 2.0 * kLargest_m) continue;
    const std::optional<Circle> circle = circle_through(a, b, c);
    if (!circle || circle->radius < kSmallest_m || circle->radius > kLargest_m) continue;
    if ((circle->center - sensor).norm() < ((a + b + c) / 3.0 - sensor).norm()) continue;  // hollow
    const Support support = support_of(*circle, points, sensor, noise_m);
    const double bulge_m = circle->radius * (1.0 - support.least_cosine);
    if (support.on <= most || support.least_cosine > kWidest || bulge_m < kBulge * noise_m) continue;
    if (static_cast<double>(support.inside) > kInside * static_cast<double>(support.on)) continue;
    most = support.on;
    best = circle;
  }
  if (!best) return {};
  Few<Eigen::Vector2d> few(points.size());
  std::pmr::vector<Eigen::Vector2d>& on = few.values();
  for (const Eigen::Vector2d& point : points)
    if (std::abs((point - best->center).norm() - best->radius) < kOnCircle * noise_m) on.push_back(point);
  const RoundFit fit = fit_round(on, sensor, {best->radius, 4.0}, noise_m);
  const bool good =
      fit.converged && fit.radius.radius_m < kLargest_m && 4 * static_cast<std::size_t>(fit.on_circle) >= 3 * on.size();
  return good ? std::optional(fit) : std::nullopt;
}

}  // namespace swarm
