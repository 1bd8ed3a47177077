// The bridge to ROS 2 in simulated time, with what it would hear and say; of stand-ins of ROS 2's messages.
#pragma once

#include <cstring>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "tests/support/harness.h"
#include "tools/ros2/ros2_node.h"

namespace swarm::test {

inline constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

inline Eigen::Quaterniond rotated(double roll, double pitch, double yaw) {
  return Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
}

template <class Xyz>
void put(const Eigen::Vector3d& values, Xyz* xyz) {
  xyz->x = values.x(), xyz->y = values.y(), xyz->z = values.z();
}
template <class Xyz>
Eigen::Vector3d vector_of(const Xyz& xyz) {
  return {xyz.x, xyz.y, xyz.z};
}

inline geometry_msgs::msg::Pose pose_at(const Eigen::Vector3d& position, const Eigen::Quaterniond& orientation) {
  geometry_msgs::msg::Pose pose;
  put(position, &pose.position);
  put(orientation.vec(), &pose.orientation);
  pose.orientation.w = orientation.w();
  return pose;
}

inline visualization_msgs::msg::Marker marker_at(int type, const Eigen::Vector3d& position,
                                                 const Eigen::Vector3d& scale, Utime utime) {
  visualization_msgs::msg::Marker marker;
  marker.header.frame_id = "world";
  marker.header.stamp = stamp_of(utime);
  marker.ns = "people";
  marker.type = type;
  marker.pose = pose_at(position, Eigen::Quaterniond::Identity());
  put(scale, &marker.scale);
  return marker;
}

// Points as FLOAT32 behind a field of 4 bytes.
inline sensor_msgs::msg::PointCloud2 cloud_with(const std::vector<Eigen::Vector3f>& points, const std::string& frame,
                                                Utime utime) {
  sensor_msgs::msg::PointCloud2 cloud;
  cloud.header.frame_id = frame;
  cloud.header.stamp = stamp_of(utime);
  for (const char* const name : {"ring", "x", "y", "z"}) {
    sensor_msgs::msg::PointField& field = cloud.fields.emplace_back();
    field.name = name;
    field.offset = static_cast<std::uint32_t>(4 * (cloud.fields.size() - 1));
    field.datatype = field.offset == 0 ? sensor_msgs::msg::PointField::INT32 : sensor_msgs::msg::PointField::FLOAT32;
    field.count = 1;
  }
  cloud.height = 1;
  cloud.width = static_cast<std::uint32_t>(points.size());
  cloud.point_step = 16;
  cloud.row_step = 16 * cloud.width;
  cloud.data.resize(cloud.row_step);
  for (std::size_t i = 0; i < points.size(); ++i) std::memcpy(&cloud.data[16 * i + 4], points[i].data(), 12);
  return cloud;
}

struct RosMailbox : RosOutbox {
  std::string publish_path(int robot_id, const nav_msgs::msg::Path& path) override {
    paths[robot_id].push_back(path);
    return failure;
  }
  std::string publish_command(const trajectory_msgs::msg::MultiDOFJointTrajectory& command) override {
    commands.push_back(command);
    return failure;
  }
  std::string publish_occupied(const sensor_msgs::msg::PointCloud2& cloud) override {
    clouds.push_back(cloud);
    return failure;
  }

  std::string failure;
  std::map<int, std::vector<nav_msgs::msg::Path>> paths;
  std::vector<trajectory_msgs::msg::MultiDOFJointTrajectory> commands;
  std::vector<sensor_msgs::msg::PointCloud2> clouds;
};

inline Ros2Config config_of_robot_3() {
  Ros2Config config;
  config.robot_id = 3;
  return config;
}

struct RosBridge : RosMailbox, Bench<Ros2Node> {
  explicit RosBridge(const Ros2Config& config = config_of_robot_3())
      : Bench(config, 1'700'000'000, static_cast<RosOutbox&>(*this)) {}

  nav_msgs::msg::Odometry odometry_at(const Eigen::Vector3d& position, const Eigen::Quaterniond& orientation,
                                      const Eigen::Vector3d& velocity = Eigen::Vector3d::Zero()) const {
    nav_msgs::msg::Odometry odometry;
    odometry.header.frame_id = "world";
    odometry.header.stamp = stamp_of(now);
    odometry.child_frame_id = "base_link";
    odometry.pose.pose = pose_at(position, orientation);
    put(velocity, &odometry.twist.twist.linear);
    return odometry;
  }
  void hear(const nav_msgs::msg::Odometry& odometry) { node.on_odometry(now, odometry, out); }
  void hear(const sensor_msgs::msg::PointCloud2& cloud) { node.on_cloud(now, cloud, out); }
  void hear(const std::vector<visualization_msgs::msg::Marker>& markers) {
    visualization_msgs::msg::MarkerArray array;
    array.markers = markers;
    node.on_obstacles(now, array, out);
  }
  // That the message is refused for this reason, in words that hold `words`, and changes nothing else.
  template <class Message>
  void expect_refused(const Message& message, RosRefusal reason, const std::string& words) {
    const std::int64_t before = refused(reason);
    const std::size_t letters = out.letters.size();
    hear(message);
    EXPECT_EQ(refused(reason), before + 1) << words;
    EXPECT_EQ(out.letters.size(), letters) << words;
    EXPECT_NE(node.report().words.find(words), std::string::npos) << node.report().words;
  }
  std::int64_t refused(RosRefusal reason) const { return node.report().refused[static_cast<std::size_t>(reason)]; }

  sogm_swarm::setpoint_t setpoint_of(const MotionState& state, double yaw) {
    sogm_swarm::setpoint_t setpoint{};
    setpoint.header = make_header(3, 1, seq++, now);
    Eigen::Map<Eigen::Vector3d>(setpoint.position) = state.position;
    Eigen::Map<Eigen::Vector3d>(setpoint.velocity) = state.velocity;
    Eigen::Map<Eigen::Vector3d>(setpoint.acceleration) = state.acceleration;
    setpoint.yaw = yaw;
    setpoint.yaw_rate = 0.25;
    return setpoint;
  }
  sogm_swarm::announcement_t announcement_of(int robot_id, const Trajectory& committed) {
    sogm_swarm::announcement_t message{};
    message.header = make_header(robot_id, 1, seq++, now);
    message.radius = 0.2f;
    message.committed = committed.to_wire();
    message.least_delay_us = sogm_swarm::announcement_t::kUnknown;
    return message;
  }

  std::int64_t seq = 0;
};

}  // namespace swarm::test
