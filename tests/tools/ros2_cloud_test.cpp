// Clouds of ROS 2 become scans: in the LiDAR's frame or in W, placed by the odometry around them.
#include <chrono>
#include <numbers>

#include "lcmtypes/bus/channels.h"
#include "tests/support/ros2_bridge.h"

namespace swarm::test {
namespace {

using sensor_msgs::msg::PointCloud2;
using sensor_msgs::msg::PointField;
using sogm_swarm::lidar_scan_t;

Ros2Config with_lidar() {
  Ros2Config config = config_of_robot_3();
  config.sensor = 2;
  config.lidar_position = {0.1, 0, -0.05};
  config.lidar_angles_deg = {0, 30, 90};
  return config;
}

// Points of a scan in W.
std::vector<Eigen::Vector3d> points_in_world(const lidar_scan_t& scan) {
  const double* const q = scan.orientation;
  const Eigen::Quaterniond orientation(q[0], q[1], q[2], q[3]);
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < scan.coordinates.size(); i += 3) {
    const Eigen::Vector3d point(scan.coordinates[i], scan.coordinates[i + 1], scan.coordinates[i + 2]);
    points.emplace_back(Eigen::Vector3d(scan.position) + orientation * (0.005 * point));
  }
  return points;
}

const std::vector<Eigen::Vector3f> kPoints = {{1.0f, 2.0f, -0.5f}, {-3.0f, 0.25f, 4.0f}};

TEST(Ros2Cloud, IsPlacedWhereTheLidarWas) {
  for (const std::string frame : {"lidar", "world"}) {
    RosBridge bridge(with_lidar());
    const double half_pi = std::numbers::pi / 2;
    bridge.hear(bridge.odometry_at({0, 0, 1}, rotated(0, 0, 0)));
    bridge.run_for(0.05);
    const Utime between = bridge.now;
    bridge.run_for(0.05);
    bridge.hear(cloud_with(kPoints, frame, between));
    EXPECT_EQ(bridge.out.count(channel::kLidarScan), 0);  // where the robot was is not known yet
    bridge.hear(bridge.odometry_at({2, 0, 1}, rotated(0, 0, half_pi)));
    const auto scan = bridge.out.newest<lidar_scan_t>(channel::kLidarScan);
    EXPECT_EQ(scan.header.robot_id, 3);
    EXPECT_EQ(to_utime(scan.header.utime), between);
    EXPECT_EQ(scan.sensor, 2);
    EXPECT_EQ(scan.num_parts, 1);
    const Eigen::Quaterniond body = rotated(0, 0, half_pi / 2);
    const Eigen::Vector3d position = Eigen::Vector3d(1, 0, 1) + body * Eigen::Vector3d(0.1, 0, -0.05);
    EXPECT_LT((Eigen::Vector3d(scan.position) - position).norm(), 1e-9);
    const Eigen::Quaterniond orientation = body * rotated(0, std::numbers::pi / 6, half_pi);
    const std::vector<Eigen::Vector3d> points = points_in_world(scan);
    ASSERT_EQ(points.size(), kPoints.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d point = kPoints[i].cast<double>();
      const Eigen::Vector3d wanted = frame == "world" ? point : position + orientation * point;
      EXPECT_LT((points[i] - wanted).norm(), 0.005) << frame << " " << i;
    }
    EXPECT_EQ(bridge.node.report().scans, 1);
  }
}

TEST(Ros2Cloud, AtTheTimeOfOdometryIsPlacedAtOnce) {
  RosBridge bridge;
  bridge.hear(bridge.odometry_at({1, 2, 3}, rotated(0, 0, 0)));
  bridge.hear(cloud_with({{100.0f, 1.0f, 2.0f}, {400.0f, 0.0f, 0.0f}}, "lidar", bridge.now));
  const auto scan = bridge.out.newest<lidar_scan_t>(channel::kLidarScan);
  EXPECT_EQ(Eigen::Vector3d(scan.position), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(scan.coordinates, (std::vector<std::int16_t>{20000, 200, 400, 32000, 0, 0}));  // free as far as can be said
}

TEST(Ros2Cloud, OrganisedCloudsOfDoublesAreReadRowByRow) {
  PointCloud2 cloud;
  for (const char* const name : {"z", "y", "x"}) {
    PointField& field = cloud.fields.emplace_back();
    field.name = name;
    field.datatype = PointField::FLOAT64;
    field.offset = static_cast<std::uint32_t>(8 * (cloud.fields.size() - 1));
  }
  cloud.height = 3;
  cloud.width = 2;
  cloud.point_step = 24;
  cloud.row_step = 50;  // two bytes lie fallow
  cloud.data.resize(150);
  const double points[6][3] = {{3, 2, 1}, {kNoNumber, 0, 0}, {6, 5, 4}, {1.7e308, 0, 0}, {9, 8, 7}, {0, -1.1e5, 0}};
  for (std::size_t i = 0; i < 6; ++i) std::memcpy(&cloud.data[50 * (i / 2) + 24 * (i % 2)], points[i], 24);
  EXPECT_EQ(points_of(cloud), (std::vector<Eigen::Vector3d>{{1, 2, 3}, {4, 5, 6}, {7, 8, 9}}));
}

TEST(Ros2Cloud, OfAnyNumberOfEmptyRowsIsEmpty) {
  PointCloud2 cloud = cloud_with({}, "lidar", kStart);
  ASSERT_EQ(cloud.row_step, 0u);
  cloud.height = 0xFFFFFFFF;
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_TRUE(points_of(cloud).empty());
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 500ms);  // it does not look at each
}

TEST(Ros2Cloud, OfManyPointsIsThinnedAndCutIntoParts) {
  RosBridge bridge;
  bridge.hear(bridge.odometry_at({0, 0, 1}, rotated(0, 0, 0)));
  bridge.hear(cloud_with(std::vector<Eigen::Vector3f>(170'000, {1, 2, 3}), "lidar", bridge.now));
  const auto parts = bridge.out.all<lidar_scan_t>(channel::kLidarScan);
  ASSERT_EQ(parts.size(), 9u);  // 85,000 points, 10,000 a part
  for (const lidar_scan_t& part : parts) EXPECT_EQ(part.header.seq, parts[0].header.seq);
  EXPECT_EQ(parts.back().num_coordinates, 15'000);
  EXPECT_EQ(bridge.node.report().thinned, 1);
}

TEST(Ros2Cloud, ThatCannotBeIsRefused) {
  RosBridge bridge;
  bridge.hear(bridge.odometry_at({0, 0, 1}, rotated(0, 0, 0)));
  const PointCloud2 good = cloud_with(kPoints, "lidar", bridge.now);
  const auto expect_refused = [&](const auto& spoil, RosRefusal reason, const std::string& words) {
    PointCloud2 bad = good;
    spoil(bad);
    bridge.expect_refused(bad, reason, "cloud: " + words);
  };
  const RosRefusal layout = RosRefusal::kLayout;
  expect_refused([](PointCloud2& c) { c.header.frame_id = "camera"; }, RosRefusal::kFrame,
                 "frame_id 'camera': must be 'lidar' or 'world'");
  expect_refused([](PointCloud2& c) { c.header.stamp.sec = 0; }, RosRefusal::kTime, "stamp is ");
  expect_refused([](PointCloud2& c) { c.header.stamp.sec = 0, c.data.clear(); }, RosRefusal::kTime, "stamp is ");
  expect_refused([](PointCloud2& c) { c.is_bigendian = true; }, layout, "is_bigendian");
  expect_refused([](PointCloud2& c) { c.fields.pop_back(); }, layout, "has no field z");
  expect_refused([](PointCloud2& c) { c.fields[1].datatype = PointField::INT32; }, layout, "field x: must be FLOAT32");
  expect_refused([](PointCloud2& c) { c.fields[3].offset = 13; }, layout, "field z: must end within point_step");
  expect_refused([](PointCloud2& c) { c.data.pop_back(); }, layout, "width, height");
  expect_refused([](PointCloud2& c) { c.width = 0xFFFFFFFF; }, layout, "width, height");
  expect_refused([](PointCloud2& c) { c.height = 0xFFFFFFFF; }, layout, "width, height");
  expect_refused([](PointCloud2& c) { c.row_step = 0; }, layout, "width, height");
  bridge.hear(good);
  EXPECT_EQ(bridge.node.report().scans, 1);
  bridge.expect_refused(good, RosRefusal::kOrder, "cloud: stamp");
}

TEST(Ros2Cloud, FromWhenNobodyKnowsWhereTheRobotWasIsRefused) {
  RosBridge bridge;
  bridge.run_for(1.0);
  const Utime early = bridge.now - 100ms;
  bridge.hear(bridge.odometry_at({0, 0, 1}, rotated(0, 0, 0)));
  bridge.expect_refused(cloud_with(kPoints, "lidar", early), RosRefusal::kPose, "cloud: odometry has a gap");
  bridge.run_for(0.1);
  bridge.hear(cloud_with(kPoints, "lidar", bridge.now));  // waits
  bridge.run_for(0.1);
  bridge.hear(cloud_with(kPoints, "lidar", bridge.now));  // too
  bridge.run_for(0.1);
  bridge.hear(bridge.odometry_at({0, 0, 1}, rotated(0, 0, 0)));  // 0.3 s after the one before
  EXPECT_EQ(bridge.refused(RosRefusal::kPose), 3);
  EXPECT_EQ(bridge.node.report().scans, 0);
}

TEST(Ros2Cloud, WaitsForOdometryThatIsLaterThanTheNextOnes) {
  RosBridge bridge;
  const auto hear_odometry_of = [&](Utime utime) {
    nav_msgs::msg::Odometry odometry = bridge.odometry_at({0, 0, 1}, rotated(0, 0, 0));
    odometry.header.stamp = stamp_of(utime);
    bridge.hear(odometry);
  };
  const auto hear_clouds = [&](int clouds, double every_s) {
    for (int i = 0; i < clouds; ++i) {
      bridge.run_for(every_s);
      bridge.hear(cloud_with(kPoints, "lidar", bridge.now));
    }
  };
  const Utime begin = bridge.now;
  hear_odometry_of(begin);
  hear_clouds(3, 0.05);
  EXPECT_EQ(bridge.node.report().scans, 0);
  hear_odometry_of(begin + 100ms);
  EXPECT_EQ(bridge.node.report().scans, 2);
  hear_odometry_of(begin + 150ms);
  const auto scans = bridge.out.all<lidar_scan_t>(channel::kLidarScan);
  ASSERT_EQ(scans.size(), 3u);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(to_utime(scans[i].header.utime), begin + (i + 1) * 50ms);

  hear_clouds(5, 0.02);
  EXPECT_EQ(bridge.refused(RosRefusal::kPose), 0);
  hear_clouds(1, 0.02);  // the first of six goes
  EXPECT_EQ(bridge.refused(RosRefusal::kPose), 1);
  EXPECT_EQ(bridge.node.report().words, "cloud: no odometry since its stamp");
  hear_clouds(1, 0.95);  // and two that are a second older than this
  EXPECT_EQ(bridge.refused(RosRefusal::kPose), 3);
  hear_odometry_of(bridge.now);  // of three others it is not known where the robot was
  EXPECT_EQ(bridge.refused(RosRefusal::kPose), 6);
  EXPECT_EQ(bridge.node.report().scans, 4);
}

}  // namespace
}  // namespace swarm::test
