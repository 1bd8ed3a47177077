#include "swarm_sim/environment/ray_caster.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "lcmtypes/bus/portable_math.h"

namespace swarm {
namespace {

constexpr double kExact_m = 1e-4;  // so near to a torus is on it
constexpr int kMarch = 200;        // steps towards one, at most

// Part of a ray: from begin to end; none where it begins after its end.
struct Interval {
  double begin, end;

  Interval with(const Interval& other) const { return {std::max(begin, other.begin), std::min(end, other.end)}; }
};
constexpr Interval kNone{1.0, 0.0}, kWhole{-1e9, 1e9};

// Where |origin + t way| <= half along an axis.
Interval within_slab(double origin, double way, double half) {
  if (way == 0.0) return std::abs(origin) <= half ? kWhole : kNone;
  const double a = (-half - origin) / way, b = (half - origin) / way;
  return {std::min(a, b), std::max(a, b)};
}

// Where |origin + t way| <= radius, of vectors of any dimension.
template <class Vector>
Interval within_ball(const Vector& origin, const Vector& way, double radius) {
  const double a = way.squaredNorm(), b = origin.dot(way), c = origin.squaredNorm() - radius * radius;
  if (a == 0.0) return c <= 0.0 ? kWhole : kNone;
  const double under = b * b - a * c;
  if (under < 0.0) return kNone;
  const double root = std::sqrt(under);
  return {(-b - root) / a, (-b + root) / a};
}

double length_to(const Interval& inside, double range_m) {
  if (inside.begin > inside.end || inside.end < 0.0) return range_m;
  return std::clamp(inside.begin, 0.0, range_m);
}

double reach_of(const Shape& shape) {
  switch (shape.kind) {
    case Shape::Kind::kColumn:
      return 0.5 * shape.size.head<2>().norm();
    case Shape::Kind::kRing:
      return shape.size.x() + 0.5 * shape.size.y();
    case Shape::Kind::kBox:
      return 0.5 * shape.size.norm();
    default:
      return 0.5 * shape.size.x();
  }
}

}  // namespace

double ray_length(const Shape& shape, const Eigen::Vector3d& center, const Eigen::Vector3d& direction, double range_m) {
  const Eigen::Vector3d origin = -center;  // from the shape's centre
  const Interval near = within_ball(origin, direction, reach_of(shape));
  if (near.begin > near.end || near.end < 0.0 || near.begin > range_m) return range_m;
  switch (shape.kind) {
    case Shape::Kind::kColumn: {
      const Interval around = within_ball<Eigen::Vector2d>(origin.head<2>(), direction.head<2>(), shape.size.x() / 2);
      return length_to(around.with(within_slab(origin.z(), direction.z(), shape.size.y() / 2)), range_m);
    }
    case Shape::Kind::kBox: {
      const auto [sin, cos] = sin_cos(shape.yaw_rad);
      const auto turned = [s = sin, c = cos](const Eigen::Vector3d& v) {
        return Eigen::Vector3d(c * v.x() + s * v.y(), -s * v.x() + c * v.y(), v.z());
      };
      const Eigen::Vector3d o = turned(origin), d = turned(direction);
      Interval inside = kWhole;
      for (int axis = 0; axis < 3; ++axis) inside = inside.with(within_slab(o[axis], d[axis], shape.size[axis] / 2));
      return length_to(inside, range_m);
    }
    case Shape::Kind::kSphere:
      return length_to(near, range_m);
    default:
      break;
  }
  // A torus: on by as much as is free around, which never passes it.
  double length = std::max(near.begin, 0.0);
  const double last = std::min(near.end, range_m);
  for (int i = 0; i < kMarch && length < last; ++i) {
    const double free_m = distance(shape, origin + length * direction);
    if (free_m < kExact_m) return length;
    length += free_m;
  }
  return range_m;
}

void RayCaster::look(double t_s, const Eigen::Vector3d& from, double range_m, const std::vector<Ball>& balls) {
  from_ = from;
  range_m_ = range_m;
  solids_.clear();
  const auto add = [&](const Shape& shape, const Eigen::Vector3d& center) {
    const double reach_m = reach_of(shape);
    if (center.norm() - reach_m < range_m) solids_.push_back({shape, center, reach_m});
  };
  for (const WorldObstacle& obstacle : world_.obstacles)
    if (const auto state = state_at(obstacle, world_, std::max(t_s, 0.0))) add(obstacle.shape, state->position - from);
  for (const Ball& ball : balls)
    add({.kind = Shape::Kind::kSphere, .size = {2.0 * ball.radius_m, 0.0, 0.0}}, ball.center - from);
}

double RayCaster::cast(const Eigen::Vector3d& direction) const {
  double length = range_m_;
  for (const Solid& solid : solids_) {
    // Whether the ray comes near at all.
    const double along = direction.dot(solid.center);
    if (along < -solid.reach_m || along - solid.reach_m > length) continue;
    if (solid.center.squaredNorm() - along * along > solid.reach_m * solid.reach_m) continue;
    length = ray_length(solid.shape, solid.center, direction, length);
  }
  return static_map_ ? static_map_->ray_length(from_, direction, length) : length;
}

}  // namespace swarm
