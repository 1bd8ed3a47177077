// The perception daemon's node: what it says of which scans, and what it makes of bad ones.
#include "map_daemon/perception/perception_node.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <limits>
#include <sstream>
#include <thread>

#include "lcmtypes/bus/temporary_directory.h"
#include "map_daemon/octomap_file.h"
#include "tests/support/column_scan.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::depth_image_t;
using sogm_swarm::lidar_scan_t;
using sogm_swarm::obstacles_t;
using sogm_swarm::perception_status_t;

constexpr int kOwnId = 4;

class Perceiving : public Bench<PerceptionNode> {
 public:
  explicit Perceiving(const PerceptionNodeConfig& config = own()) : Bench(config, 9) {}

  static PerceptionNodeConfig own() {
    PerceptionNodeConfig config;
    config.robot_id = kOwnId;
    return config;
  }
  lidar_scan_t scan(const Eigen::Vector3d& origin = {0, 0, 1}, double column_y = 0.0) {
    lidar_scan_t message = column_scan(origin, {{{2, column_y}, 0.3}});
    message.header = make_header(kOwnId, 1, seq_++, now);
    return message;
  }
  int reports() const { return out.count(channel::kObstacles); }
  perception_status_t status() {
    run_for(1.01);
    return out.newest<perception_status_t>(channel::kPerceptionStatus);
  }
  int refused(Refusal refusal) const { return node.refused()[refusal]; }

 private:
  std::int64_t seq_ = 1;
};

depth_image_t image_of(double depth_m, Utime utime, std::int64_t seq) {
  depth_image_t image{};
  image.header = make_header(kOwnId, 1, seq, utime);
  image.position[2] = 1.0;
  image.orientation[0] = image.orientation[2] = 0.5, image.orientation[1] = image.orientation[3] = -0.5;
  image.focal_px[0] = image.focal_px[1] = 40.0f;
  image.width = 40;
  image.num_pixels = 40 * 30;
  image.center_px[0] = 19.5f, image.center_px[1] = 14.5f;
  image.depth_mm.assign(1200, static_cast<std::int16_t>(1e3 * depth_m));
  return image;
}

TEST(PerceptionNode, EachScanBecomesAReportAndWhatWasSeen) {
  Perceiving node;
  for (int i = 0; i < 20; ++i) {
    node.send(channel::kLidarScan, node.scan({0.03, 0.04, 1.05}, 0.1 * i));
    node.run_for(0.1);
  }
  EXPECT_EQ(node.reports(), 20);
  const auto report = node.out.newest<obstacles_t>(channel::kObstacles);
  ASSERT_EQ(report.num_obstacles, 1);
  EXPECT_NEAR(report.obstacles[0].position[0], 2.0, 0.04);
  EXPECT_NEAR(report.obstacles[0].position[1], 1.9, 0.04);
  EXPECT_EQ(report.obstacles[0].velocity_sigma, -1.0f);
  EXPECT_EQ(report.complete, 0);
  Sogm seen;
  SogmAssembler assembler;
  int maps = 0;
  for (const auto& part : node.out.all<sogm_swarm::sogm_t>(channel::kSeenSpace))
    maps += assembler.add(part, &seen).status == AssemblyStatus::kComplete;
  EXPECT_EQ(maps, 20);
  ASSERT_EQ(seen.num_frames, 2);
  EXPECT_FALSE(seen.occupied(0, seen.geometry.voxel_of({1.7, 0, 1.0}))) << "it moves";
  EXPECT_FALSE(seen.occupied(1, seen.geometry.voxel_of({1.2, 0, 1.0})));
  const perception_status_t status = node.status();
  EXPECT_EQ(status.scans, 20);
  EXPECT_EQ(status.moving, 1);
  EXPECT_GT(status.points, 20);
}

TEST(PerceptionNode, WhatStandsIsSeenToStand) {
  Perceiving node;
  for (int i = 0; i < 45; ++i) {
    node.send(channel::kLidarScan, node.scan({0.03, 0.04, 1.05}));
    node.run_for(0.1);
  }
  EXPECT_EQ(node.out.newest<obstacles_t>(channel::kObstacles).num_obstacles, 0);
  Sogm seen;
  SogmAssembler assembler;
  for (const auto& part : node.out.all<sogm_swarm::sogm_t>(channel::kSeenSpace)) (void)assembler.add(part, &seen);
  EXPECT_TRUE(seen.occupied(0, seen.geometry.voxel_of({1.7, 0, 1.0})));
  EXPECT_EQ(node.status().standing, 1);
}

TEST(PerceptionNode, TheMapIsWrittenWhenItIsAskedForAndAtTheEndAndReadAtTheStart) {
  const TemporaryDirectory directory("perception_node_test");
  PerceptionNodeConfig config = Perceiving::own();
  config.map = (directory.path() / "map.bt").string();
  const auto stands = [&](const Eigen::Vector3d& place) {
    const auto tree = read_octomap(config.map);
    const octomap::OcTreeNode* node = tree->search(place.x(), place.y(), place.z());
    return node != nullptr && tree->isNodeOccupied(*node);
  };
  {
    Perceiving node(config);
    const auto look = [&](double column_y, int scans) {
      for (int i = 0; i < scans; ++i) {
        node.send(channel::kLidarScan, node.scan({0.03, 0.04, 1.05}, column_y));
        node.run_for(0.1);
      }
    };
    look(0.0, 45);
    EXPECT_FALSE(std::filesystem::exists(config.map));
    EXPECT_EQ(node.status().maps_written, 0);
    sogm_swarm::map_request_t request{};
    request.header = make_header(kOwnId, 1, 1, node.now);
    node.send(channel::kSaveMap, request);
    node.send(channel::kSaveMap, request);  // repeated: refused
    EXPECT_EQ(node.refused(Refusal::kSequence), 1);
    for (int i = 0; i < 200 && node.status().maps_written == 0; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_EQ(node.status().maps_written, 1);
    EXPECT_EQ(node.status().map_state, perception_status_t::kMapKept);
    EXPECT_GT(node.status().map_blocks, 10);
    EXPECT_TRUE(stands({1.75, 0.05, 1.05}));
    look(1.5, 45);
    EXPECT_FALSE(stands({1.75, 1.45, 1.05}));
  }
  EXPECT_TRUE(stands({1.75, 1.45, 1.05})) << "written at the end";
  EXPECT_FALSE(stands({1.75, 0.05, 1.05})) << "it is gone";
  Perceiving next(config);
  for (int i = 0; i < 2; ++i) {  // from so high above it that its beams pass
    next.send(channel::kLidarScan, next.scan({-1.0, 3.0, 3.55}, 5.0));
    next.run_for(0.1);
  }
  const Sogm& seen = next.node.perception().seen_space();
  EXPECT_TRUE(seen.occupied(0, seen.geometry.voxel_of({1.75, 1.45, 1.05}))) << "it was not seen, but is known";
}

TEST(PerceptionNode, DepthImagesAreSeenAsWell) {
  Perceiving node;
  node.send(channel::kDepthImage, image_of(2.0, node.now, 1));
  node.now += 50ms;
  node.send(channel::kDepthImage, image_of(2.0, node.now, 2));
  EXPECT_EQ(node.reports(), 2);
  const Sogm& seen = node.node.perception().seen_space();
  EXPECT_TRUE(seen.occupied(0, seen.geometry.voxel_of({2.0, 0, 1.0}))) << "x is ahead";
  EXPECT_FALSE(seen.occupied(1, seen.geometry.voxel_of({1.0, 0, 1.0})));
}

TEST(PerceptionNode, ScansInPartsWaitForEachOther) {
  Perceiving node;
  lidar_scan_t first = node.scan(), second = first;
  first.num_parts = second.num_parts = 2;
  second.part = 1;
  node.send(channel::kLidarScan, second);
  EXPECT_EQ(node.reports(), 0);
  node.send(channel::kLidarScan, first);
  EXPECT_EQ(node.reports(), 1);
  node.send(channel::kLidarScan, first);
  EXPECT_EQ(node.refused(Refusal::kSequence), 1);
}

TEST(PerceptionNode, BadScansAreRefusedAndCounted) {
  Perceiving node;
  const auto refuses = [&](Refusal refusal, auto spoil) {
    const int before = node.refused(refusal);
    lidar_scan_t scan = node.scan();
    spoil(scan);
    node.send(channel::kLidarScan, scan);
    EXPECT_EQ(node.refused(refusal), before + 1) << to_string(refusal);
    EXPECT_EQ(node.reports(), 1);
  };
  const lidar_scan_t good = node.scan();
  node.send(channel::kLidarScan, good);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refuses(Refusal::kValue, [nan](lidar_scan_t& scan) { scan.position[1] = nan; });
  refuses(Refusal::kValue, [nan](lidar_scan_t& scan) { scan.orientation[2] = nan; });
  refuses(Refusal::kValue, [](lidar_scan_t& scan) { scan.orientation[0] = 0.9; });
  refuses(Refusal::kValue, [](lidar_scan_t& scan) { scan.sensor = 8; });
  refuses(Refusal::kInconsistent, [](lidar_scan_t& scan) { scan.part = 1; });
  refuses(Refusal::kInconsistent, [](lidar_scan_t& scan) { scan.coordinates.pop_back(), --scan.num_coordinates; });
  refuses(Refusal::kRobot, [](lidar_scan_t& scan) { scan.header.robot_id = 5; });
  refuses(Refusal::kTime, [](lidar_scan_t& scan) { scan.header.utime -= 600'000; });
  refuses(Refusal::kTime, [](lidar_scan_t& scan) { scan.header.utime += 200'000; });
  refuses(Refusal::kSequence, [&](lidar_scan_t& scan) { scan.header = good.header; });
}

TEST(PerceptionNode, BlindScansAreCountedAndNotUsed) {
  Perceiving node;
  node.send(channel::kDepthImage, image_of(0.0, node.now, 1));
  EXPECT_EQ(node.reports(), 0);
  const perception_status_t status = node.status();
  EXPECT_EQ(status.blind, 1);
  EXPECT_EQ(status.state, perception_status_t::kNoScan);
}

TEST(PerceptionNode, APoseThatJumpsMakesItForget) {
  Perceiving node;
  node.send(channel::kLidarScan, node.scan());
  node.run_for(0.1);
  node.send(channel::kLidarScan, node.scan({0.9, 0, 1}));  // 9 m/s
  EXPECT_EQ(node.reports(), 2);
  node.run_for(0.1);
  node.send(channel::kLidarScan, node.scan({3.0, 0, 1}));
  EXPECT_EQ(node.reports(), 2);
  EXPECT_EQ(node.refused(Refusal::kInconsistent), 1);
  EXPECT_TRUE(node.node.perception().tracker().tracks().empty());
  EXPECT_TRUE(node.node.activity(node.now).waits);
  node.run_for(0.1);
  node.send(channel::kLidarScan, node.scan({3.05, 0, 1}));  // it knows again where it is
  EXPECT_EQ(node.reports(), 3);
  EXPECT_EQ(node.status().jumps, 1);
}

TEST(PerceptionNode, PeersAreMaskedWhileTheyAreHeard) {
  Perceiving node;
  sogm_swarm::announcement_t peer{};
  peer.header = make_header(7, 1, 1, node.now);
  peer.radius = 0.3f;
  peer.committed = Trajectory::hover(1, node.now, {2, 0, 1}).to_wire();
  peer.least_delay_us = sogm_swarm::announcement_t::kUnknown;
  node.send(channel::kPeerTrajectory, peer);
  node.send(channel::kLidarScan, node.scan());
  EXPECT_GT(node.node.perception().masked(), 0);
  node.run_for(0.6);
  node.send(channel::kLidarScan, node.scan());
  EXPECT_EQ(node.node.perception().masked(), 0);
  peer.header.seq = 2;
  node.send(channel::kOwnTrajectory, peer);  // it is not the robot itself
  EXPECT_EQ(node.refused(Refusal::kRobot), 1);
}

TEST(PerceptionNode, SaysWhatItWaitsFor) {
  Perceiving node;
  EXPECT_EQ(node.node.activity(node.now).text, "waits for LIDAR_SCAN or DEPTH_IMAGE");
  EXPECT_TRUE(node.node.activity(node.now).waits);
  node.send(channel::kLidarScan, node.scan());
  EXPECT_FALSE(node.node.activity(node.now).waits);
  EXPECT_EQ(node.status().state, perception_status_t::kNoScan) << "silent for a second";
  EXPECT_TRUE(node.node.activity(node.now).waits);
}

TEST(PerceptionNode, ClocksMayBeSet) {
  Perceiving node;
  node.send(channel::kLidarScan, node.scan());
  node.run_for(0.05);
  node.wall_ahead = -100s;
  node.step();
  EXPECT_FALSE(node.node.activity(node.now).waits);
  node.run_for(0.05);
  node.send(channel::kLidarScan, node.scan());
  EXPECT_EQ(node.reports(), 2);
  EXPECT_EQ(node.node.perception().tracker().tracks().size(), 1u);
}

TEST(PerceptionNode, OptionsThatContradictEachOtherAreRefused) {
  PerceptionNodeConfig config = Perceiving::own();
  config.perception.scan.depth_range_m = 2.0;
  config.perception.scan.least_range_m = 2.0;
  EXPECT_THROW(verify(config), OptionError);
}

}  // namespace
}  // namespace swarm::test
