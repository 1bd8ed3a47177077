// Depth images and LiDAR scans against what they were made of: walls, edges, and points that are known.
#include "map_daemon/perception/range_scan.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <functional>
#include <numbers>
#include <numeric>
#include <vector>

#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using sogm_swarm::depth_image_t;
using sogm_swarm::lidar_scan_t;
using Result = ScanAssembler::Result;

constexpr double kVoxel_m = 0.1;
// A camera on a robot that looks along x: its z is ahead, its x to the right, its y down.
const Eigen::Quaterniond kLevel(0.5, -0.5, 0.5, -0.5);

template <class Message>
void place_at(const Eigen::Vector3d& position, const Eigen::Quaterniond& orientation, Message* message) {
  message->header.utime = to_us(kStart);
  Eigen::Map<Eigen::Vector3d>(message->position) = position;
  const double q[] = {orientation.w(), orientation.x(), orientation.y(), orientation.z()};
  std::copy_n(q, 4, message->orientation);
}

using DepthAt = std::function<double(int x, int y)>;  // [m]

depth_image_t image_of(int width, int height, const DepthAt& depth_m) {
  depth_image_t image{};
  place_at({0, 0, 0}, kLevel, &image);
  image.focal_px[0] = 60.0f, image.focal_px[1] = 50.0f;
  image.center_px[0] = 0.5f * static_cast<float>(width) - 0.7f, image.center_px[1] = 0.4f * static_cast<float>(height);
  image.width = static_cast<std::int16_t>(width);
  image.num_pixels = width * height;
  for (int i = 0; i < image.num_pixels; ++i)
    image.depth_mm.push_back(static_cast<std::int16_t>(1e3 * depth_m(i % width, i / width) + 0.5));
  return image;
}

// Through the middle of a pixel, as long as its depth along z is 1.
Eigen::Vector3d ahead_of(const depth_image_t& image, double x, double y) {
  const Eigen::Quaterniond to_world(image.orientation[0], image.orientation[1], image.orientation[2],
                                    image.orientation[3]);
  return to_world * Eigen::Vector3d((x - double{image.center_px[0]}) / double{image.focal_px[0]},
                                    (y - double{image.center_px[1]}) / double{image.focal_px[1]}, 1.0);
}
// The pixel that a place is seen in.
Eigen::Vector2d pixel_of(const depth_image_t& image, const Eigen::Vector3d& place) {
  const Eigen::Matrix3d rays =
      (Eigen::Matrix3d() << ahead_of(image, 0, 0), ahead_of(image, 1, 0), ahead_of(image, 0, 1)).finished();
  const Eigen::Vector3d share = rays.inverse() * (place - Eigen::Vector3d(image.position));
  return share.tail<2>() / share.sum();
}

RangeScan scan_of(const depth_image_t& image, const ScanConfig& config = {}) {
  RangeScan scan;
  scan.surfaces.assign(3, {1, 2, 3});  // of the scan before
  scan.free.resize(7);
  scan.measured = scan.rays = 99;
  read_scan(image, config, kVoxel_m, &scan);
  EXPECT_EQ(scan.utime, kStart);
  EXPECT_EQ(scan.origin, Eigen::Vector3d(image.position));
  EXPECT_EQ(scan.rays, image.num_pixels);
  EXPECT_DOUBLE_EQ(scan.noise_at(3.0), config.depth_noise_m + 9.0 * config.depth_noise_per_m);
  return scan;
}

bool ends_at(const RangeScan& scan, const Eigen::Vector3d& place) {
  return std::ranges::any_of(scan.free, [&](const auto& ray) { return (ray.to - place).norm() < 1e-9; });
}
double distance_to(const RangeScan::Ray& ray, const Eigen::Vector3d& place) {
  const Eigen::Vector3d way = ray.to - ray.from, to = place - ray.from;
  return (to - std::clamp(to.dot(way) / way.squaredNorm(), 0.0, 1.0) * way).norm();
}

// A ray passes within a voxel of it.
bool is_passed(const RangeScan& scan, const Eigen::Vector3d& place) {
  return std::ranges::any_of(scan.free, [&](const auto& ray) { return distance_to(ray, place) <= kVoxel_m; });
}

// A wall askew, from any pose: points lie on it, and rays free the way to it as densely as voxels lie, and nothing
// beyond.
TEST(RangeScan, PointsLieOnTheWallAndRaysEndThere) {
  Rng rng(1);
  for (int i = 0; i < 20; ++i) {
    SCOPED_TRACE(testing::Message() << "wall " << i);
    const double wall_m = uniform(rng, 1.0, 4.0);
    depth_image_t image = image_of(32, 24, [](int, int) { return 0.0; });
    place_at(in_cube(rng, 30.0), Eigen::Quaterniond::UnitRandom().normalized(), &image);
    const Eigen::Vector3d origin(image.position),
        axis = ahead_of(image, double{image.center_px[0]}, double{image.center_px[1]});
    const Eigen::Vector3d normal = (axis + 0.25 * direction(rng)).normalized();
    const auto beyond_m = [&](const Eigen::Vector3d& place) { return normal.dot(place - origin) - wall_m; };
    for (int p = 0; p < image.num_pixels; ++p) {
      const int row = p / 32;
      image.depth_mm[static_cast<std::size_t>(p)] =
          static_cast<std::int16_t>(1e3 * wall_m / normal.dot(ahead_of(image, p % 32, row)) + 0.5);
    }
    const RangeScan scan = scan_of(image, {.depth_range_m = 30.0});
    ASSERT_EQ(std::ssize(scan.surfaces), image.num_pixels);
    double told_m = 0.0;
    for (const RangeScan::Ray& ray : scan.free) told_m += (ray.to - ray.from).norm();
    EXPECT_LT(told_m, 0.6 * image.num_pixels * wall_m) << "voxels are passed in vain";
    EXPECT_EQ(scan.measured, image.num_pixels);
    for (const Eigen::Vector3d& place : scan.surfaces) {
      EXPECT_LT(std::abs(beyond_m(place)), 1e-3);
      for (const double share : {0.1, 0.5, 0.9, 0.98})
        EXPECT_TRUE(is_passed(scan, origin + share * (place - origin))) << share;
    }
    for (const RangeScan::Ray& ray : scan.free) {
      EXPECT_LT(std::max(beyond_m(ray.from), beyond_m(ray.to)), 1e-3);
      EXPECT_LT((ray.from - origin).cross(ray.to - origin).norm(), 1e-9) << "not from the camera";
    }
  }
}

TEST(RangeScan, ThePoseOfTheCameraIsHonoured) {
  depth_image_t image = image_of(2, 1, [](int x, int) { return x == 0 ? 2.0 : 2.05; });
  image.center_px[0] = 1.0f, image.center_px[1] = -50.0f;  // its first pixel: to the left and below, its second below
  place_at({10, 20, 30}, kLevel, &image);
  const RangeScan level = scan_of(image);
  ASSERT_EQ(level.surfaces.size(), 2u);
  EXPECT_LT((level.surfaces[0] - Eigen::Vector3d(12, 20 + 2.0 / 60, 28)).norm(), 1e-6);
  EXPECT_LT((level.surfaces[1] - Eigen::Vector3d(12.05, 20, 30 - 2.05)).norm(), 1e-6);
  Eigen::Quaterniond turned = Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ()) * kLevel;
  turned.coeffs() *= 0.9995;  // as exact as messages are
  place_at({10, 20, 30}, turned, &image);
  EXPECT_LT((scan_of(image).surfaces.at(1) - Eigen::Vector3d(10, 22.05, 30 - 2.05)).norm(), 1e-6);
}

// What is seen of the world is what has a pixel; a LiDAR looks everywhere.
TEST(RangeScan, KnowsWhatItsCameraSees) {
  Rng rng(5);
  depth_image_t image = image_of(32, 24, [](int, int) { return 2.0; });
  place_at({3, 1, 2}, Eigen::Quaterniond::UnitRandom().normalized(), &image);
  RangeScan scan = scan_of(image);
  int seen = 0;
  for (int i = 0; i < 1000; ++i) {
    const double x = uniform(rng, -10, 42), y = uniform(rng, -8, 32), depth_m = uniform(rng, -3, 6);
    const bool is_in = x >= 0 && x <= 31 && y >= 0 && y <= 23 && depth_m > 0.0;
    EXPECT_EQ(scan.sees(scan.origin + depth_m * ahead_of(image, x, y)), is_in) << x << " " << y << " " << depth_m;
    seen += is_in ? 1 : 0;
  }
  EXPECT_GT(seen, 100);
  lidar_scan_t turn{};
  turn.orientation[0] = 1.0;
  read_scan(std::vector{turn}, {}, kVoxel_m, &scan);
  EXPECT_TRUE(scan.sees({-100, 3, 80}));
}

// Nothing is known of pixels at which nothing was measured.
TEST(RangeScan, ZerosAreNeitherSurfaceNorFree) {
  Rng rng(2);
  const auto is_hole = [](int x, int y) { return x >= 8 && x < 16 && y >= 4 && y < 12; };  // of whole blocks of pixels
  const depth_image_t image =
      image_of(24, 20, [&](int x, int y) { return is_hole(x, y) || uniform(rng, 0, 1) < 0.2 ? 0.0 : 4.0; });
  const auto zeros = std::ranges::count(image.depth_mm, 0);
  const RangeScan scan = scan_of(image);
  EXPECT_EQ(scan.measured, image.num_pixels - zeros);
  EXPECT_EQ(std::ssize(scan.surfaces), image.num_pixels - zeros);
  for (const RangeScan::Ray& ray : scan.free) {
    const Eigen::Vector2d pixel = pixel_of(image, ray.to);
    EXPECT_FALSE(is_hole(static_cast<int>(pixel.x() + 0.2), static_cast<int>(pixel.y() + 0.2))) << pixel.transpose();
    if ((ray.to - scan.origin).dot(ahead_of(image, image.center_px[0], image.center_px[1])) < 3.9) continue;
    const Eigen::Vector2i nearest = (pixel.array() + 0.5).floor().matrix().cast<int>();
    EXPECT_NE(image.depth_mm.at(static_cast<std::size_t>(nearest.y() * 24 + nearest.x())), 0) << pixel.transpose();
  }
  const RangeScan blind = scan_of(image_of(5, 4, [](int, int) { return 0.0; }));
  EXPECT_TRUE(blind.surfaces.empty() && blind.free.empty());
  EXPECT_EQ(blind.measured, 0);
}

// Also what is told of surfaces a little further away.
TEST(RangeScan, WhatIsBeyondTheRangeIsOnlyFree) {
  const auto depth_m = [](int x, int) { return x < 8 ? 32.767 : x < 16 ? 7.5 : 4.2; };
  const depth_image_t image = image_of(24, 16, depth_m);
  const RangeScan scan = scan_of(image, {.depth_range_m = 4.0});
  EXPECT_EQ(scan.range_m, 4.0);
  EXPECT_EQ(scan.measured, 24 * 16);
  const double beyond_m = 4.0 + RangeScan::kBeyond_m;
  for (const RangeScan::Ray& ray : scan.free) EXPECT_LT((ray.to - scan.origin).norm(), beyond_m + 1e-9);
  for (int i = 0; i < 24 * 16; ++i) {
    const int row = i / 24;
    const Eigen::Vector3d ahead = ahead_of(image, i % 24, row), place = depth_m(i % 24, 0) * ahead;
    EXPECT_TRUE(is_passed(scan, std::min(place.norm() - 0.01, beyond_m - 0.01) * ahead.normalized())) << i;
    const auto is_there = [&](const Eigen::Vector3d& other) { return (other - place).norm() < 1e-9; };
    EXPECT_EQ(std::ranges::any_of(scan.surfaces, is_there), place.norm() <= beyond_m) << i;
  }
}

// Pixels at depths between those of the two things beside them, a speck, and the ends of a thin pole, which itself
// stays.
TEST(RangeScan, EdgesAreLeftOut) {
  for (const int edge : {7, 8}) {
    SCOPED_TRACE(edge);
    const DepthAt depth_m = [edge](int x, int y) {
      if (x == 3 && y == 3) return 3.6;
      if (x == 12) return 2.6;
      return x < edge ? 4.6 : x == edge ? 3.4 + 0.35 * (y % 3) : 3.0;
    };
    const depth_image_t image = image_of(16, 12, depth_m);
    const RangeScan scan = scan_of(image, {.depth_range_m = 20.0});
    EXPECT_EQ(scan.measured, 16 * 12);
    EXPECT_EQ(std::ssize(scan.surfaces), 16 * 12 - 12 - 1 - 2);
    for (int i = 0; i < 16 * 12; ++i) {
      const int x = i % 16, y = i / 16;
      const Eigen::Vector3d place = depth_m(x, y) * ahead_of(image, x, y);
      const bool is_left_out = (x == 3 && y == 3) || x == edge || (x == 12 && (y == 0 || y == 11));
      const auto is_there = [&](const Eigen::Vector3d& other) { return (other - place).norm() < 1e-9; };
      EXPECT_EQ(std::ranges::any_of(scan.surfaces, is_there), !is_left_out) << x << " " << y;
      EXPECT_TRUE(is_left_out ? !ends_at(scan, place) : is_passed(scan, 0.98 * place)) << x << " " << y;
    }
  }
}

// As far as four pixels pass the same voxels, one ray tells for them.
TEST(RangeScan, ImagesOfAnySizeAreReadWhole) {
  for (const auto& [width, height] : {std::pair{1, 1}, {3, 1}, {1, 5}, {2, 3}, {5, 3}, {7, 7}, {8, 8}, {17, 9}}) {
    SCOPED_TRACE(testing::Message() << width << " x " << height);
    const depth_image_t image = image_of(width, height, [](int, int) { return 4.0; });
    const RangeScan scan = scan_of(image);
    EXPECT_EQ(scan.measured, width * height);
    ASSERT_EQ(std::ssize(scan.surfaces), width * height);
    for (int i = 0; i < width * height; ++i) {
      const int x = i % width, y = i / width;
      for (const double depth_m : {0.4, 1.0, 2.0, 3.0, 3.95})
        EXPECT_TRUE(is_passed(scan, depth_m * ahead_of(image, x, y))) << i << " " << depth_m;
    }
    for (const RangeScan::Ray& ray : scan.free) {
      const Eigen::Vector2d pixel = pixel_of(image, ray.to);
      EXPECT_TRUE((pixel.array() > -0.01).all() && pixel.x() < width + 0.01 - width % 2 / 2.0 &&
                  pixel.y() < height + 0.01 - height % 2 / 2.0)
          << "beside the image: " << pixel.transpose();
    }
  }
}

// The robot's own parts: behind them nothing is seen.
TEST(RangeScan, WhatIsTooNearIsIgnored) {
  const depth_image_t image = image_of(16, 16, [](int x, int) { return x < 8 ? 0.2 : 4.0; });
  const RangeScan scan = scan_of(image, {.least_range_m = 0.3});
  EXPECT_EQ(scan.measured, 256);
  EXPECT_EQ(scan.surfaces.size(), 128u);
  const auto passes_them = [&](const RangeScan::Ray& ray) { return pixel_of(image, ray.to).x() < 7.9; };
  EXPECT_EQ(std::ranges::count_if(scan.free, passes_them), 0);
}

lidar_scan_t part_of(int number, int parts, std::int64_t seq, const std::vector<Eigen::Vector3d>& points,
                     std::int32_t boot = 1) {
  lidar_scan_t part{};
  place_at({3, -4, 5}, Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ())), &part);
  part.header.boot = boot, part.header.seq = seq;
  part.part = static_cast<std::int16_t>(number), part.num_parts = static_cast<std::int16_t>(parts);
  for (const Eigen::Vector3d& point : points)
    for (const double value : point) part.coordinates.push_back(static_cast<std::int16_t>(std::lround(value / 0.005)));
  part.num_coordinates = static_cast<std::int32_t>(part.coordinates.size());
  return part;
}

// Turned by 90 degrees about z.
TEST(RangeScan, LidarPointsOfAllPartsAreRead) {
  RangeScan scan;
  scan.surfaces.resize(2), scan.free.resize(2), scan.measured = scan.rays = 9;
  const ScanConfig config{.lidar_range_m = 5.0, .least_range_m = 0.3, .lidar_noise_m = 0.04};
  const std::vector<lidar_scan_t> parts = {part_of(0, 3, 1, {{2, 0, 0}, {0, 0, 0}, {0, -3, 1}}), part_of(1, 3, 1, {}),
                                           part_of(2, 3, 1, {{0, 0, 12}, {0.2, 0.2, 0}, {0, 5.2, 0}, {-0.3, 0, 0.1}})};
  read_scan(parts, config, kVoxel_m, &scan);
  EXPECT_EQ(scan.utime, kStart);
  EXPECT_EQ(scan.origin, Eigen::Vector3d(3, -4, 5));
  EXPECT_EQ(scan.range_m, 5.0);
  EXPECT_EQ(scan.rays, 7);
  EXPECT_EQ(scan.measured, 6);
  EXPECT_EQ(scan.noise_at(7.0), 0.04);
  const std::vector<Eigen::Vector3d> ends = {{3, -2, 5}, {6, -4, 6}, {3, -4, 10}, {-2, -4, 5}, {3, -4.3, 5.1}};
  const std::vector<Eigen::Vector3d> surfaces = {{3, -2, 5}, {6, -4, 6}, {-2.2, -4, 5}, {3, -4.3, 5.1}};
  ASSERT_EQ(scan.free.size(), ends.size());
  ASSERT_EQ(scan.surfaces.size(), surfaces.size());
  for (std::size_t i = 0; i < surfaces.size(); ++i) EXPECT_LT((scan.surfaces[i] - surfaces[i]).norm(), 1e-9) << i;
  for (std::size_t i = 0; i < ends.size(); ++i) {
    EXPECT_EQ(scan.free[i].from, scan.origin);
    EXPECT_LT((scan.free[i].to - ends[i]).norm(), 1e-9) << i;
  }
}

// A wall with a post before it, seen by rays that lie closer than voxels: the way to all points is free but for its
// end, and no ray passes further than it measured.
TEST(RangeScan, LidarRaysFreeTheWayToTheirPoints) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 800; ++i) {
    const double angle = 0.002 * (i - 400);
    const double range_m = std::abs(angle - 0.2) < 0.1 ? 1.5 : 4.0 / std::cos(angle);
    points.emplace_back(range_m * std::cos(angle), range_m * std::sin(angle), 0.01 * (i % 3));
  }
  RangeScan scan;
  read_scan(std::vector{part_of(0, 1, 1, points)}, {}, kVoxel_m, &scan);
  ASSERT_EQ(scan.surfaces.size(), points.size());
  EXPECT_LT(scan.free.size(), points.size() / 2) << "voxels are passed in vain";
  for (const RangeScan::Ray& ray : scan.free)
    EXPECT_TRUE(std::ranges::any_of(scan.surfaces, [&](const auto& place) { return (ray.to - place).norm() < 1e-9; }));
  for (const Eigen::Vector3d& place : scan.surfaces) {
    const Eigen::Vector3d way = place - scan.origin;
    for (const double before_m : {3.0, 1.0, 0.25})
      EXPECT_TRUE(before_m > way.norm() || is_passed(scan, place - before_m * way.normalized()))
          << before_m << " m before " << way.transpose();
  }
}

// Every order, with parts that came before and parts of the scan before among them.
TEST(ScanAssembler, PartsComeInAnyOrder) {
  Rng rng(4);
  ScanAssembler assembler;
  for (int seq = 1; seq <= 200; ++seq) {
    SCOPED_TRACE(testing::Message() << "scan " << seq);
    const int parts = uniform_int(rng, 1, 6);
    std::vector<int> order(static_cast<std::size_t>(parts));
    std::iota(order.begin(), order.end(), 0);
    std::ranges::shuffle(order, rng);
    for (int i = 0; i < parts; ++i) {
      const int number = order[static_cast<std::size_t>(i)];
      const lidar_scan_t part = part_of(number, parts, seq, {{0.01 * seq, 0.1 * number, 0}});
      ASSERT_EQ(assembler.add(part), i == parts - 1 ? Result::kComplete : Result::kIncomplete);
      EXPECT_EQ(assembler.add(part), Result::kRefused);
      EXPECT_EQ(assembler.add(part_of(number, parts, seq - 1, {})), Result::kRefused);
      EXPECT_EQ(assembler.add(part_of(order.back(), parts + 1, seq, {})), Result::kRefused);
      EXPECT_EQ(assembler.add(part_of(0, 1, seq + 1000, {}, 0)),
                Result::kRefused);  // before the sensor was started anew
    }
    ASSERT_EQ(std::ssize(assembler.parts()), parts);
    for (int i = 0; i < parts; ++i) {
      EXPECT_EQ(assembler.parts()[static_cast<std::size_t>(i)].part, i);
      EXPECT_EQ(assembler.parts()[static_cast<std::size_t>(i)].coordinates,
                part_of(i, parts, seq, {{0.01 * seq, 0.1 * i, 0}}).coordinates);
    }
  }
}

TEST(ScanAssembler, ANewerScanReplacesAnUnfinishedOne) {
  ScanAssembler assembler;
  EXPECT_EQ(assembler.add(part_of(1, 3, 5, {})), Result::kIncomplete);
  EXPECT_EQ(assembler.add(part_of(0, 3, 5, {})), Result::kIncomplete);
  EXPECT_EQ(assembler.add(part_of(2, 3, 7, {})), Result::kIncomplete);
  EXPECT_EQ(assembler.add(part_of(2, 3, 5, {})), Result::kRefused);  // would have been its last
  EXPECT_EQ(assembler.add(part_of(2, 3, 6, {})), Result::kRefused);
  EXPECT_EQ(assembler.add(part_of(0, 3, 7, {})), Result::kIncomplete);
  EXPECT_EQ(assembler.add(part_of(1, 3, 7, {})), Result::kComplete);
  EXPECT_EQ(assembler.add(part_of(1, 2, 0, {}, 2)), Result::kIncomplete);  // started anew
  EXPECT_EQ(assembler.add(part_of(0, 2, 0, {}, 2)), Result::kComplete);
}

}  // namespace
}  // namespace swarm
