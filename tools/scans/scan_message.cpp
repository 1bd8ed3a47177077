#include "tools/scans/scan_message.h"

#include <algorithm>
#include <cmath>

#include "lcmtypes/bus/channels.h"
#include "sogm_swarm/lidar_scan_t.hpp"

namespace swarm {
namespace {

using sogm_swarm::lidar_scan_t;

constexpr double kPointUnit_m = 0.005;
constexpr double kReach_m = 32'000 * kPointUnit_m;  // what is further away is free up to there
constexpr std::size_t kPointsPerPart = lidar_scan_t::kMaxCoordinates / 3;
constexpr std::size_t kMostPoints = kPointsPerPart * lidar_scan_t::kMaxParts;

}  // namespace

bool thin_to_fit(std::vector<Eigen::Vector3d>* points) {
  const std::size_t every = (points->size() + kMostPoints - 1) / kMostPoints;
  if (every <= 1) return false;
  for (std::size_t i = 0; i * every < points->size(); ++i) (*points)[i] = (*points)[i * every];
  points->resize((points->size() + every - 1) / every);
  return true;
}

void publish_scan(const sogm_swarm::header_t& header, int sensor, const Eigen::Vector3d& position,
                  const Eigen::Quaterniond& orientation, std::span<const Eigen::Vector3d> points, Outbox& outbox) {
  lidar_scan_t scan{};
  scan.header = header;
  scan.sensor = static_cast<std::int16_t>(sensor);
  Eigen::Map<Eigen::Vector3d>(scan.position) = position;
  scan.orientation[0] = orientation.w();
  Eigen::Map<Eigen::Vector3d>(scan.orientation + 1) = orientation.vec();
  scan.num_parts =
      static_cast<std::int16_t>(std::max<std::size_t>(1, (points.size() + kPointsPerPart - 1) / kPointsPerPart));
  for (; scan.part < scan.num_parts; ++scan.part) {
    const std::size_t from = static_cast<std::size_t>(scan.part) * kPointsPerPart;
    scan.coordinates.clear();
    for (std::size_t i = from; i < std::min(from + kPointsPerPart, points.size()); ++i) {
      const double reach_m = points[i].cwiseAbs().maxCoeff();
      const Eigen::Vector3d point = points[i] * (reach_m > kReach_m ? kReach_m / reach_m : 1.0) / kPointUnit_m;
      for (const double value : point) scan.coordinates.push_back(static_cast<std::int16_t>(std::floor(value + 0.5)));
    }
    scan.num_coordinates = static_cast<std::int32_t>(scan.coordinates.size());
    outbox.publish(BusId::kOnboard, channel::kLidarScan, scan);
  }
}

}  // namespace swarm
