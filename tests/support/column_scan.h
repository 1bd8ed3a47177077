// Scans of upright columns by a LiDAR without noise, for the tests of perception.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <vector>

#include "sogm_swarm/lidar_scan_t.hpp"

namespace swarm::test {

struct Column {
  Eigen::Vector2d center;  // W [m]
  double radius_m = 0.3;
  double bottom_m = 0.0, top_m = 1.8;
};

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
        const Eigen::Vector2d to = column.center - origin.head<2>();
        const double along = way.dot(to), under = along * along - to.squaredNorm() + column.radius_m * column.radius_m;
        if (under < 0.0 || along < 0.0) continue;
        const double length = along - std::sqrt(under), z = origin.z() + length * std::tan(up);
        if (length < ground_m && z >= column.bottom_m && z <= column.top_m) ground_m = length;
      }
      for (const double value : {ground_m * way.x(), ground_m * way.y(), ground_m * std::tan(up)})
        scan.coordinates.push_back(static_cast<std::int16_t>(std::lround(value / 0.005)));
    }
  }
  scan.num_coordinates = static_cast<std::int32_t>(scan.coordinates.size());
  return scan;
}

}  // namespace swarm::test
