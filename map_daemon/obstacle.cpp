#include "map_daemon/obstacle.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "lcmtypes/bus/portable_math.h"

namespace swarm {
namespace {

double distance_to_box(const Eigen::Vector3d& point, const Eigen::Vector3d& half) {
  return (point.cwiseAbs() - half).cwiseMax(0.0).norm();
}

}  // namespace

double distance(const Shape& shape, const Eigen::Vector3d& offset) {
  const auto [sin_yaw, cos_yaw] = sin_cos(shape.yaw_rad);
  const Eigen::Vector3d local(cos_yaw * offset.x() + sin_yaw * offset.y(), -sin_yaw * offset.x() + cos_yaw * offset.y(),
                              offset.z());
  switch (shape.kind) {
    case Shape::Kind::kColumn:
      return (Eigen::Vector2d(offset.head<2>().norm(), std::abs(offset.z())) - shape.size.head<2>() / 2)
          .cwiseMax(0.0)
          .norm();
    case Shape::Kind::kRing:
      return std::max(Eigen::Vector2d(local.tail<2>().norm() - shape.size.x(), local.x()).norm() - shape.size.y() / 2,
                      0.0);
    case Shape::Kind::kBox:
      return distance_to_box(local, shape.size / 2);
    case Shape::Kind::kSphere:
      return std::max(offset.norm() - shape.size.x() / 2, 0.0);
    case Shape::Kind::kVoxels:
      break;
  }
  double nearest = std::numeric_limits<double>::infinity();
  const double edge = shape.size.x();
  for (const Eigen::Vector3i& voxel : shape.voxels) {
    nearest =
        std::min(nearest, distance_to_box(offset - edge * voxel.cast<double>(), Eigen::Vector3d::Constant(edge / 2)));
  }
  return nearest;
}

}  // namespace swarm
