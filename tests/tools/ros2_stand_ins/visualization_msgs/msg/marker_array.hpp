// Stands in for ROS 2's header: what tools/ros2 uses of it, and no more.
#pragma once

#include <cstdint>
#include <geometry_msgs/msg/pose.hpp>
#include <geometry_msgs/msg/twist.hpp>
#include <std_msgs/msg/header.hpp>
#include <string>
#include <vector>

namespace visualization_msgs::msg {

struct Marker {
  static constexpr std::int32_t ARROW = 0, CUBE = 1, SPHERE = 2, CYLINDER = 3, TEXT_VIEW_FACING = 9;
  static constexpr std::int32_t ADD = 0, DELETE = 2, DELETEALL = 3;

  std_msgs::msg::Header header;
  std::string ns;
  std::int32_t id = 0, type = 0, action = 0;
  geometry_msgs::msg::Pose pose;
  geometry_msgs::msg::Vector3 scale;
  std::vector<geometry_msgs::msg::Point> points;
};

struct MarkerArray {
  std::vector<Marker> markers;
};

}  // namespace visualization_msgs::msg
