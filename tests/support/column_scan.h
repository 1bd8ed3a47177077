// Scans and images of upright columns by a LiDAR and a camera without noise, for the tests of perception.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <vector>

#include "sogm_swarm/depth_image_t.hpp"
#include "sogm_swarm/lidar_scan_t.hpp"

namespace swarm::test {

struct Column {
  Eigen::Vector2d center;  // W [m]
  double radius_m = 0.3;
  double bottom_m = 0.0, top_m = 1.8;
};

// How far along `way` (along the ground) from `origin` a column begins; where the way passes it, or it lies behind:
// far.
inline double distance_to(const Column& column, const Eigen::Vector2d& origin, const Eigen::Vector2d& way) {
  const Eigen::Vector2d to = column.center - origin;
  const double along = way.dot(to), under = along * along - to.squaredNorm() + column.radius_m * column.radius_m;
  return under < 0.0 || along < 0.0 ? 1e9 : along - std::sqrt(under);
}

// One part, from a sensor at `origin` that is not turned: 18 beams within 29 degrees of the horizontal, 540 around.
// What meets nothing is told as 20 m away. Without header.
inline sogm_swarm::lidar_scan_t column_scan(const Eigen::Vector3d& origin, const std::vector<Column>& columns) {
  sogm_swarm::lidar_scan_t scan{};
  Eigen::Map<Eigen::Vector3d>(scan.position) = origin;
  scan.orientation[0] = 1.0;
  scan.num_parts = 1;
  for (int beam = 0; beam < 18; ++beam) {
    const double up = -0.5 + beam * 0.056;
    for (int i = 0; i < 540; ++i) {
      const double around = 2.0 * std::numbers::pi * i / 540;
      const Eigen::Vector2d way(std::cos(around), std::sin(around));  // along the ground
      double ground_m = 20.0 * std::cos(up);
      for (const Column& column : columns) {
        const double length = distance_to(column, origin.head<2>(), way), z = origin.z() + length * std::tan(up);
        if (length < ground_m && z >= column.bottom_m && z <= column.top_m) ground_m = length;
      }
      for (const double value : {ground_m * way.x(), ground_m * way.y(), ground_m * std::tan(up)})
        scan.coordinates.push_back(static_cast<std::int16_t>(std::lround(value / 0.005)));
    }
  }
  scan.num_coordinates = static_cast<std::int32_t>(scan.coordinates.size());
  return scan;
}

// 160 x 120 pixels that see 90 degrees along x, from a camera that is not turned otherwise. What meets nothing is told
// as 20 m deep. Without header.
inline sogm_swarm::depth_image_t column_image(const Eigen::Vector3d& origin, const std::vector<Column>& columns) {
  constexpr int kWidth = 160, kHeight = 120;
  constexpr double kFocal_px = 80.0;
  sogm_swarm::depth_image_t image{};
  Eigen::Map<Eigen::Vector3d>(image.position) = origin;
  image.orientation[0] = image.orientation[2] = 0.5, image.orientation[1] = image.orientation[3] = -0.5;
  image.focal_px[0] = image.focal_px[1] = kFocal_px;
  image.width = kWidth;
  image.num_pixels = kWidth * kHeight;
  image.center_px[0] = 0.5f * (kWidth - 1), image.center_px[1] = 0.5f * (kHeight - 1);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const Eigen::Vector2d ahead(1.0, (double{image.center_px[0]} - u) / kFocal_px);
      const double up = (double{image.center_px[1]} - v) / kFocal_px, length = ahead.norm();
      double depth_m = 20.0;
      for (const Column& column : columns) {
        const double deep_m = distance_to(column, origin.head<2>(), ahead / length) / length;
        const double z = origin.z() + deep_m * up;
        if (deep_m < depth_m && z >= column.bottom_m && z <= column.top_m) depth_m = deep_m;
      }
      image.depth_mm.push_back(static_cast<std::int16_t>(std::lround(1e3 * depth_m)));
    }
  }
  return image;
}

}  // namespace swarm::test
