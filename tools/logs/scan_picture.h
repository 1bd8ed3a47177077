// The newest whole scan of each of a robot's sensors, for whoever draws it: the points that perception looks at, and
// which of them it takes for robots.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "map_daemon/perception/peer_mask.h"
#include "map_daemon/perception/range_scan.h"

namespace swarm {

// Where robots were by what they announced, with the margin and the time-out that perception has by default.
PeerMask usual_peer_mask();

class ScanPicture {
 public:
  // Kept as it came: what nobody looks at costs a copy.
  void keep(const sogm_swarm::depth_image_t& image, const std::vector<PeerMask::Ball>& robots);
  void keep(const std::vector<sogm_swarm::lidar_scan_t>& parts, const std::vector<PeerMask::Ball>& robots);

  Utime utime() const;
  // What is within them is no obstacle.
  const std::vector<PeerMask::Ball>& robots() const { return robots_; }
  // Where rays ended, as far away as perception looks by default: x, y, z [W, m], and 1 on a robot, 0 elsewhere. Of
  // more than `most` every second, third, ... is left out.
  std::vector<Eigen::Vector4f> points(std::size_t most) const;

 private:
  std::vector<sogm_swarm::lidar_scan_t> parts_;    // or
  std::vector<sogm_swarm::depth_image_t> images_;  // one
  std::vector<PeerMask::Ball> robots_;
};

class ScanPictures {
 public:
  // Messages of this robot's that passed decode(). What becomes whole with it, or null.
  const ScanPicture* add(const sogm_swarm::depth_image_t& image, PeerMask* robots);
  const ScanPicture* add(const sogm_swarm::lidar_scan_t& part, PeerMask* robots);

  const std::map<int, ScanPicture>& sensors() const { return sensors_; }
  std::int64_t count() const { return count_; }  // of whole scans

 private:
  std::map<int, ScanPicture> sensors_;  // cameras behind LiDARs
  std::map<int, ScanAssembler> assemblers_;
  std::int64_t count_ = 0;
};

}  // namespace swarm
