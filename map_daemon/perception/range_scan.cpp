#include "map_daemon/perception/range_scan.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <utility>

namespace swarm {
namespace {

using sogm_swarm::depth_image_t;
using sogm_swarm::lidar_scan_t;

constexpr double kPointUnit_m = 0.005;
constexpr int kEdge_mm = 100, kEdgeShare = 33;  // depths that differ by less, and one part in so many, belong together
constexpr std::int16_t kNeighbours = 2;         // of four that a pixel has in common with what it lies on

Eigen::Matrix3d rotation(const double (&q)[4]) {
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
}

// Whether a surface at this distance is told.
bool is_told(double distance_m, double range_m) {
  return distance_m <= range_m + RangeScan::kBeyond_m;
}

// Reads an image in blocks of 8 x 8 pixels.
class DepthReader {
 public:
  DepthReader(const depth_image_t& image, const ScanConfig& config, double resolution_m, RangeScan* scan)
      : image_(image),
        config_(config),
        least_m_(0.5 * resolution_m),
        width_(image.width),
        height_(image.num_pixels / image.width),
        scan_(*scan) {
    const Eigen::Matrix3d to_world = rotation(image.orientation);
    right_ = to_world.col(0) / double{image.focal_px[0]};
    down_ = to_world.col(1) / double{image.focal_px[1]};
    corner_ = to_world.col(2) - double{image.center_px[0]} * right_ - double{image.center_px[1]} * down_;
    const double apart_m = kApart * resolution_m * std::min(image.focal_px[0], image.focal_px[1]);
    for (std::size_t level = 1; level < reach_m_.size(); ++level) reach_m_[level] = apart_m / (1 << level);
  }

  void read() {
    for (int y = 0; y < height_; y += kEdge) {
      for (int x = 0; x < width_; x += kEdge) {
        read_block(x, y);
        tell<kLevels - 1>({x, y}, 0, 0, 0.0);
      }
    }
  }

 private:
  static constexpr int kLevels = 4, kEdge = 1 << (kLevels - 1), kPadded = kEdge + 2;

  using Row = Eigen::Array<double, kEdge, 1>;

  static constexpr std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static constexpr std::size_t padded(int i, int j) { return index((i + 1) * kPadded + j + 1); }
  // Through the middle of a pixel, as long as its depth is 1.
  Eigen::Vector3d direction(double x, double y) const { return corner_ + x * right_ + y * down_; }
  // Of the part of the block at hand that is the i-th down and the j-th to the right of those with 2^level pixels along
  // each edge.
  double& free_m(int level, int i, int j) {
    return free_m_[static_cast<std::size_t>(level)][static_cast<std::size_t>((i << (kLevels - 1 - level)) + j)];
  }

  // Its depths, and those beside it; outside of the image nothing is measured.
  void copy_block(int x0, int y0) {
    depths_.fill(0);
    const int first = std::max(x0 - 1, 0), count = std::min(x0 + kEdge + 1, width_) - first;
    for (int y = std::max(y0 - 1, 0); y < std::min(y0 + kEdge + 1, height_); ++y)
      std::copy_n(image_.depth_mm.begin() + y * width_ + first, count, &depths_[padded(y - y0, first - x0)]);
  }

  // Which pixels lie on an edge. Without branches, of short numbers: compilers make vector instructions of it.
  void find_edges() {
    constexpr std::size_t begin = padded(0, 0), end = padded(kEdge - 1, kEdge);
    for (std::size_t i = begin; i < end; ++i) {  // what lies beside the block, too
      const std::int16_t depth = depths_[i];
      const auto limit = static_cast<std::int16_t>(kEdge_mm + static_cast<std::uint16_t>(depth) / kEdgeShare);
      std::int16_t alike = 0, around = 0;
      const auto look_at = [&](std::int16_t other) {
        const auto apart = static_cast<std::int16_t>(other - depth);
        const std::int16_t measured = other != 0 ? 1 : 0, near = apart < limit && apart > -limit ? 1 : 0;
        around = static_cast<std::int16_t>(around + measured);
        alike = static_cast<std::int16_t>(alike + (measured & near));
      };
      look_at(depths_[i - 1]);
      look_at(depths_[i + 1]);
      look_at(depths_[i - kPadded]);
      look_at(depths_[i + kPadded]);
      is_on_edge_[i] = alike < std::min(kNeighbours, around) ? 1 : 0;
    }
  }

  void measure_block(int x0, int y0) {
    std::array<Row, 3> of_column;
    for (int j = 0; j < kEdge; ++j)
      for (int axis = 0; axis < 3; ++axis) of_column[index(axis)](j) = corner_(axis) + (x0 + j) * right_(axis);
    for (int i = 0; i < kEdge; ++i) {
      auto& ahead = ahead_[index(i)];
      for (int axis = 0; axis < 3; ++axis) ahead[index(axis)] = of_column[index(axis)] + (y0 + i) * down_(axis);
      const Row length = (ahead[0].square() + (ahead[1].square() + ahead[2].square())).sqrt();
      const Row depth_mm =
          Eigen::Map<const Eigen::Array<std::int16_t, kEdge, 1>>(&depths_[padded(i, 0)]).cast<double>();
      Row& distance_m = distance_m_[index(i)];
      distance_m = 1e-3 * depth_mm * length;
      depth_m_[index(i)] = distance_m.min(config_.depth_range_m + RangeScan::kBeyond_m) / length;
    }
  }

  void read_block(int x0, int y0) {
    copy_block(x0, y0);
    find_edges();
    measure_block(x0, y0);
    for (int i = 0; i < kEdge; i += 2)
      for (int j = 0; j < kEdge; j += 2) free_m(1, i / 2, j / 2) = read_four(x0, i, j);
    for (int level = 2; level < kLevels; ++level) {
      const int size = 1 << level;
      for (int i = 0; i < kEdge / size; ++i) {
        for (int j = 0; j < kEdge / size; ++j) {
          const bool is_whole = x0 + (j + 1) * size <= width_ && y0 + (i + 1) * size <= height_;
          const auto part = [&](int k, int l) { return free_m(level - 1, 2 * i + k, 2 * j + l); };
          free_m(level, i, j) = is_whole ? std::min({part(0, 0), part(0, 1), part(1, 0), part(1, 1)}) : 0.0;
        }
      }
    }
  }

  // How deep all four pixels, as far as they measured anything, are free.
  double read_four(int x0, int i0, int j0) {
    double shared_m = 0.0;
    for (int k = 0; k < 4; ++k) {
      const int i = i0 + k / 2, j = j0 + k % 2;
      free_m(0, i, j) = 0.0;
      const int depth = depths_[padded(i, j)];
      if (depth == 0) continue;
      const bool is_first = shared_m == 0.0;
      ++scan_.measured;
      const double distance_m = distance_m_[index(i)](j), depth_m = depth_m_[index(i)](j);
      if (distance_m < config_.least_range_m) {  // and hides what is behind
        shared_m = kHidden;
        continue;
      }
      shared_m = is_first ? depth_m : std::min(shared_m, depth_m);
      if (is_on_edge_[padded(i, j)] != 0) continue;
      if (is_told(distance_m, config_.depth_range_m)) {
        const auto& [x, y, z] = ahead_[index(i)];
        scan_.surfaces.push_back(scan_.origin + 1e-3 * depth * Eigen::Vector3d(x(j), y(j), z(j)));
      }
      const bool is_told_beside = (k == 1 || k == 2) && x0 + j0 + 1 < width_;  // by the two on the diagonal
      if (!is_told_beside) free_m(0, i, j) = depth_m;
    }
    return shared_m;
  }

  // What a part of the block passes from a depth on: one ray tells it as deep as all of the part is free, and where it
  // is hardly wider than a voxel; then its parts do.
  template <int level>
  void tell(const Eigen::Vector2i& at, int i, int j, double from_m) {
    const double end_m = std::min(free_m(level, i, j), reach_m_[level]);
    if (end_m > from_m + least_m_) {
      constexpr int size = 1 << level;
      const Eigen::Vector3d ahead =
          direction(at.x() + j * size + 0.5 * (size - 1), at.y() + i * size + 0.5 * (size - 1));
      scan_.free.push_back({scan_.origin + from_m * ahead, scan_.origin + end_m * ahead});
      from_m = end_m;
    }
    if constexpr (level > 0)
      for (int k = 0; k < 4; ++k) tell<level - 1>(at, 2 * i + k / 2, 2 * j + k % 2, from_m);
  }

  static constexpr double kApart = 1.25;   // voxels that rays are apart at most
  static constexpr double kHidden = -1.0;  // nothing is free

  const depth_image_t& image_;
  const ScanConfig& config_;
  double least_m_;  // what a ray adds
  int width_, height_;
  RangeScan& scan_;
  Eigen::Vector3d corner_, right_, down_;  // to the first pixel, and from each to the next
  std::array<double, kLevels> reach_m_{std::numeric_limits<double>::infinity()};
  // Of the block at hand: with a row and a column more on each side; and row by row.
  std::array<std::int16_t, kPadded * kPadded> depths_{}, is_on_edge_{};
  std::array<std::array<Row, 3>, kEdge> ahead_;  // x, y and z of the directions, W
  // Of what was measured, and how deep it is free: also beside all surfaces that are told, or columns that come into
  // range would not be seen to end.
  std::array<Row, kEdge> distance_m_, depth_m_;
  std::array<std::array<double, kEdge * kEdge>, kLevels> free_m_{};
};

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
  scan->rays = image.num_pixels;
  scan->range_m = config.depth_range_m;
  scan->noise_m = config.depth_noise_m;
  scan->noise_per_m = config.depth_noise_per_m;
  const Eigen::Array2d focal(double{image.focal_px[0]}, double{image.focal_px[1]});
  const Eigen::Array2d center(double{image.center_px[0]}, double{image.center_px[1]});
  const int height = image.num_pixels / image.width;
  scan->is_image = true;
  scan->to_camera = rotation(image.orientation).transpose();
  scan->low = -center / focal;
  scan->high = (Eigen::Array2d(image.width - 1, height - 1) - center) / focal;
  DepthReader(image, config, resolution_m, scan).read();
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
  scan->is_image = false;
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
      const double free_m = std::min(distance_m, config.lidar_range_m);  // at most as far as is looked
      if (is_told(distance_m, config.lidar_range_m)) scan->surfaces.push_back(scan->origin + way);
      const Eigen::Vector3d ahead = way / distance_m;
      if (ahead.dot(told) > told_cosine && free_m < told_m + 2.0 * resolution_m) continue;
      told = ahead;
      told_m = free_m;
      scan->free.push_back({scan->origin, scan->origin + free_m * ahead});
    }
  }
}

}  // namespace swarm
