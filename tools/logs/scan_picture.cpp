#include "tools/logs/scan_picture.h"

#include <algorithm>

#include "map_daemon/perception/perception_node.h"

namespace swarm {

using sogm_swarm::depth_image_t;
using sogm_swarm::lidar_scan_t;

PeerMask usual_peer_mask() {
  const PerceptionNodeConfig usual;
  return {usual.peer_margin_m, to_duration(usual.peer_timeout_s)};
}

void ScanPicture::keep(const depth_image_t& image, const std::vector<PeerMask::Ball>& robots) {
  images_ = {image};
  robots_ = robots;
}

void ScanPicture::keep(const std::vector<lidar_scan_t>& parts, const std::vector<PeerMask::Ball>& robots) {
  parts_ = parts;
  robots_ = robots;
}

Utime ScanPicture::utime() const {
  return to_utime(images_.empty() ? parts_.front().header.utime : images_.front().header.utime);
}

std::vector<Eigen::Vector4f> ScanPicture::points(std::size_t most) const {
  const PerceptionConfig usual;
  RangeScan scan;
  if (images_.empty()) {
    read_scan(parts_, usual.scan, usual.resolution_m, &scan);
  } else {
    read_scan(images_.front(), usual.scan, usual.resolution_m, &scan);
  }
  const std::size_t step = (scan.surfaces.size() + most - 1) / std::max<std::size_t>(most, 1);
  std::vector<Eigen::Vector4f> points;
  for (std::size_t i = 0; i < scan.surfaces.size(); i += step) {
    const Eigen::Vector3d& place = scan.surfaces[i];
    const bool on_robot =
        std::ranges::any_of(robots_, [&](const PeerMask::Ball& ball) { return ball.contains(place); });
    Eigen::Vector4d point;
    point << place, on_robot ? 1.0 : 0.0;
    points.push_back(point.cast<float>());
  }
  return points;
}

const ScanPicture* ScanPictures::add(const depth_image_t& image, PeerMask* robots) {
  ScanPicture& scan = sensors_[lidar_scan_t::kMaxSensors + image.sensor];
  scan.keep(image, robots->at(to_utime(image.header.utime)));
  ++count_;
  return &scan;
}

const ScanPicture* ScanPictures::add(const lidar_scan_t& part, PeerMask* robots) {
  ScanAssembler& assembler = assemblers_[part.sensor];
  if (assembler.add(part) != ScanAssembler::Result::kComplete) return nullptr;
  ScanPicture& scan = sensors_[part.sensor];
  scan.keep(assembler.parts(), robots->at(to_utime(part.header.utime)));
  ++count_;
  return &scan;
}

}  // namespace swarm
