#include "planner_daemon/coordination/deconfliction.h"

#include <algorithm>

namespace swarm {
namespace {

constexpr double kFinestSpan_s = 800e-6;
// Of two motions: far more than in flight, but a peer may choose its motion so that it takes a million.
constexpr int kMostSplits = 1000;

// `difference`: control points of one motion minus those of the other. False also when it would take more than
// `splits_left`.
bool separated(const ControlPoints& difference, double duration_s, double distance, int* splits_left) {
  if (difference.col(0).norm() < distance || difference.col(5).norm() < distance) return false;
  if (linearly_separable(difference, distance)) return true;
  if (duration_s <= kFinestSpan_s || --*splits_left < 0) return false;
  return separated(part_of(difference, 0.0, 0.5), duration_s / 2, distance, splits_left) &&
         separated(part_of(difference, 0.5, 1.0), duration_s / 2, distance, splits_left);
}

// Bound on the motion's speed during [begin, end] [m/s].
double fastest(const Motion& motion, Utime begin, Utime end) {
  double bound = 0.0;
  for (Utime from = std::max(begin, motion.committed.start_utime()); from < end;) {
    const Utime to = std::min(motion.next_knot_after(from), end);
    const ControlPoints points = control_points_between(motion, from, to);
    const double step = (points.rightCols<5>() - points.leftCols<5>()).colwise().norm().maxCoeff();
    bound = std::max(bound, 5 * step / to_seconds(to - from));
    from = to;
  }
  return bound;
}

}  // namespace

bool linearly_separable(const ControlPoints& points, double radius_m) {
  // Gilbert's iteration towards the hull's point nearest to the origin; any iterate's direction is a valid plane to
  // try.
  Eigen::Vector3d nearest = points.rowwise().mean();
  for (int i = 0; i < 16; ++i) {
    const double norm = nearest.norm();
    if (norm < radius_m) return false;
    Eigen::Index lowest;
    const double support = (nearest.transpose() * points).minCoeff(&lowest) / norm;
    if (support >= radius_m) return true;
    const Eigen::Vector3d step = points.col(lowest) - nearest;
    const double length2 = step.squaredNorm();
    if (length2 < 1e-18) return false;
    nearest += std::clamp(-nearest.dot(step) / length2, 0.0, 1.0) * step;
  }
  return false;
}

bool motions_separated(const Motion& a, const Motion& b, Utime start, double distance_m, double clock_error_s) {
  const Utime end = std::max(a.end_utime(), b.end_utime());
  const Duration clock_error = to_duration(clock_error_s);
  const auto kept_off = [&](Utime from, Utime to) {
    return clock_error == 0us ? distance_m
                              : distance_m + clock_error_s * fastest(b, from - clock_error, to + clock_error);
  };
  int splits_left = kMostSplits;
  for (Utime from = start; from < end;) {
    const Utime to = std::min({a.next_knot_after(from), b.next_knot_after(from), end});
    const ControlPoints difference = control_points_between(a, from, to) - control_points_between(b, from, to);
    if (!separated(difference, to_seconds(to - from), kept_off(from, to), &splits_left)) return false;
    from = to;
  }
  const Utime rest = std::max(end, start);
  return (a.at(rest).position - b.at(rest).position).norm() >= kept_off(rest, rest);
}

}  // namespace swarm
