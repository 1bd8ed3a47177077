// What a range sensor measured, as rays in the world: where they ended, and what they passed. From the messages of
// depth cameras and of LiDARs.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/time.h"

namespace swarm {

struct ScanConfig {
  double lidar_range_m = 6.0, depth_range_m = 5.0;         // what is further away is not looked at
  double least_range_m = 0.25;                             // and what is nearer is the robot itself
  double lidar_noise_m = 0.02;                             // standard deviations of ranges
  double depth_noise_m = 0.01, depth_noise_per_m = 0.002;  // the second times the square of the depth
};

struct RangeScan {
  struct Ray {
    Eigen::Vector3d from, to;  // W [m]
  };

  // Surfaces are told so much beyond the range, so that of what begins within it the whole side is seen; by a camera
  // also what is free, so that it is seen to end there.
  static constexpr double kBeyond_m = 0.4;

  Utime utime{};
  double range_m = 0.0;                              // within which all that its rays met is told
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // of the rays, W [m]
  std::vector<Eigen::Vector3d> surfaces;             // where rays ended, W [m]
  std::vector<Ray> free;                             // what they passed
  int measured = 0, rays = 0;                        // of all rays so many told a distance, however far
  double noise_m = 0.0, noise_per_m = 0.0;           // standard deviation of a range, the second times its square

  // Of a camera: from W to its frame, whose z is ahead, and what it sees of x/z and y/z. A LiDAR sees all around.
  bool is_image = false;
  Eigen::Matrix3d to_camera = Eigen::Matrix3d::Identity();
  Eigen::Array2d low = Eigen::Array2d::Zero(), high = Eigen::Array2d::Zero();

  bool sees(const Eigen::Vector3d& place) const {
    if (!is_image) return true;
    const Eigen::Array3d at = to_camera * (place - origin);
    return at.z() > 0.0 && (at.head<2>() >= at.z() * low).all() && (at.head<2>() <= at.z() * high).all();
  }
  double noise_at(double range) const { return noise_m + noise_per_m * range * range; }

  void clear();
};

// Into `scan` (its memory is reused). Pixels that lie on the edge between two things, at a depth that neither has, are
// left out: they are where nothing is. Where several rays pass the same voxels, one of them tells that these are
// free.
void read_scan(const sogm_swarm::depth_image_t& image, const ScanConfig& config, double resolution_m, RangeScan* scan);

// Puts the parts of one LiDAR's scans together: in any order, of the newest scan only.
class ScanAssembler {
 public:
  enum class Result { kIncomplete, kComplete, kRefused };

  // `part` passed decode(). Complete: with it the scan is whole, and `parts()` are all its parts in order. Refused: it
  // is of an older scan, or was there already, or is not of a scan of so many parts.
  Result add(const sogm_swarm::lidar_scan_t& part);
  const std::vector<sogm_swarm::lidar_scan_t>& parts() const { return parts_; }

 private:
  SequenceGate newest_;
  std::int64_t seq_ = 0;
  std::int32_t boot_ = 0;  // of the scan at hand
  std::vector<sogm_swarm::lidar_scan_t> parts_;
  std::vector<char> have_;
};

void read_scan(const std::vector<sogm_swarm::lidar_scan_t>& parts, const ScanConfig& config, double resolution_m,
               RangeScan* scan);

}  // namespace swarm
