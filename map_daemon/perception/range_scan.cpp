#include "map_daemon/perception/range_scan.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace swarm {
namespace {

using sogm_swarm::depth_image_t;
using sogm_swarm::lidar_scan_t;

constexpr double kPointUnit_m = 0.005;
constexpr double kEdge_m = 0.1, kEdgeShare = 0.03;  // depths that differ by less belong together
constexpr int kNeighbours = 2;                      // of four that a pixel has in common with what it lies on

Eigen::Matrix3d rotation(const double (&q)[4]) {
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
}

// Depths of an image in metres; 0: nothing was measured.
class Depths {
 public:
  explicit Depths(const depth_image_t& image)
      : image_(image), width_(image.width), height_(image.num_pixels / image.width) {}
  int width() const { return width_; }
  int height() const { return height_; }
  double operator()(int x, int y) const {
    if (x < 0 || y < 0 || x >= width_ || y >= height_) return 0.0;
    return 1e-3 * image_.depth_mm[static_cast<std::size_t>(y * width_ + x)];
  }
  bool is_on_edge(int x, int y) const {
    const double depth = (*this)(x, y), apart = kEdge_m + kEdgeShare * depth;
    int alike = 0, around = 0;
    for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
      const double other = (*this)(x + dx, y + dy);
      if (other == 0.0) continue;
      ++around;
      if (std::abs(other - depth) < apart) ++alike;
    }
    return alike < std::min(kNeighbours, around);
  }

 private:
  const depth_image_t& image_;
  int width_, height_;
};

// How far a ray is free, at most as far as is looked, and whether it ends on a surface that is told.
struct RayEnd {
  double free_m;
  bool is_surface;
};
RayEnd end_of(double distance_m, double range_m) {
  return {std::min(distance_m, range_m), distance_m <= range_m + RangeScan::kBeyond_m};
}

}  // namespace

void RangeScan::clear() {
  surfaces.clear();
  free.clear();
  measured = rays = 0;
}

void read_scan(const depth_image_t& image, const ScanConfig& config, double resolution_m, RangeScan* scan) {
  scan->clear();
  scan->utime = to_utime(image.header.utime);
  scan->origin = Eigen::Vector3d(image.position);
  const Eigen::Matrix3d to_world = rotation(image.orientation);
  const Depths depths(image);
  scan->rays = image.num_pixels;
  scan->range_m = config.depth_range_m;
  scan->noise_m = config.depth_noise_m;
  scan->noise_per_m = config.depth_noise_per_m;
  // Two pixels are a voxel apart at this depth.
  const double block_m = resolution_m * std::min(image.focal_px[0], image.focal_px[1]) / 2.0;
  const auto direction = [&](double x, double y) {
    return Eigen::Vector3d(to_world * Eigen::Vector3d((x - double{image.center_px[0]}) / double{image.focal_px[0]},
                                                      (y - double{image.center_px[1]}) / double{image.focal_px[1]},
                                                      1.0));
  };
  for (int y = 0; y < depths.height(); y += 2) {
    for (int x = 0; x < depths.width(); x += 2) {
      double shared_m = block_m;  // all four pixels are free as deep as that
      int seen = 0;
      for (int i = 0; i < 4; ++i) {
        const int px = x + i % 2, py = y + i / 2;
        const double depth_m = depths(px, py);
        if (depth_m == 0.0) continue;
        ++scan->measured;
        ++seen;
        const Eigen::Vector3d ahead = direction(px, py);
        const double length = ahead.norm(), distance_m = depth_m * length;
        if (distance_m < config.least_range_m) {  // and hides what is behind
          shared_m = 0.0;
          continue;
        }
        const RayEnd end = end_of(distance_m, config.depth_range_m);
        const double free_depth_m = end.free_m / length;
        shared_m = std::min(shared_m, free_depth_m);
        if (depths.is_on_edge(px, py)) continue;
        if (end.is_surface) scan->surfaces.push_back(scan->origin + depth_m * ahead);
        const bool is_told_beside = (i == 1 || i == 2) && px + 1 < depths.width();  // by the two on the diagonal
        if (free_depth_m > block_m && !is_told_beside)
          scan->free.push_back({scan->origin + block_m * ahead, scan->origin + free_depth_m * ahead});
      }
      if (seen > 0 && shared_m > 0.0)
        scan->free.push_back({scan->origin, scan->origin + shared_m * direction(x + 0.5, y + 0.5)});
    }
  }
}

ScanAssembler::Result ScanAssembler::add(const lidar_scan_t& part) {
  const auto number = static_cast<std::size_t>(part.part), all = static_cast<std::size_t>(part.num_parts);
  if (newest_.pass(part.header) == Refusal::kNone) {
    boot_ = part.header.boot, seq_ = part.header.seq;
    parts_.resize(all);
    have_.assign(all, 0);
  }
  const bool is_of_it = part.header.boot == boot_ && part.header.seq == seq_ && all == parts_.size();
  if (!is_of_it || have_[number] != 0) return Result::kRefused;
  have_[number] = 1;
  parts_[number] = part;
  return std::ranges::all_of(have_, [](char have) { return have != 0; }) ? Result::kComplete : Result::kIncomplete;
}

void read_scan(const std::vector<lidar_scan_t>& parts, const ScanConfig& config, double resolution_m, RangeScan* scan) {
  scan->clear();
  scan->utime = to_utime(parts[0].header.utime);
  scan->origin = Eigen::Vector3d(parts[0].position);
  scan->range_m = config.lidar_range_m;
  scan->noise_m = config.lidar_noise_m;
  scan->noise_per_m = 0.0;
  const Eigen::Matrix3d to_world = kPointUnit_m * rotation(parts[0].orientation);
  // A ray that is within half a voxel of the one that last told what is free tells nothing new.
  const double beside = 0.5 * resolution_m / config.lidar_range_m, told_cosine = 1.0 - 0.5 * beside * beside;
  Eigen::Vector3d told = Eigen::Vector3d::Zero();
  double told_m = 0.0;
  for (const lidar_scan_t& part : parts) {
    for (std::size_t i = 0; i + 2 < part.coordinates.size(); i += 3) {
      ++scan->rays;
      const Eigen::Vector3d way =
          to_world * Eigen::Vector3d(part.coordinates[i], part.coordinates[i + 1], part.coordinates[i + 2]);
      const double distance_m = way.norm();
      if (distance_m == 0.0) continue;
      ++scan->measured;
      if (distance_m < config.least_range_m) continue;
      const RayEnd end = end_of(distance_m, config.lidar_range_m);
      if (end.is_surface) scan->surfaces.push_back(scan->origin + way);
      const Eigen::Vector3d ahead = way / distance_m;
      if (ahead.dot(told) > told_cosine && end.free_m < told_m + 2.0 * resolution_m) continue;
      told = ahead;
      told_m = end.free_m;
      scan->free.push_back({scan->origin, scan->origin + end.free_m * ahead});
    }
  }
}

}  // namespace swarm
