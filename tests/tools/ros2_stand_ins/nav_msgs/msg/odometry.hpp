// Stands in for ROS 2's header: what tools/ros2 uses of it, and no more.
#pragma once

#include <geometry_msgs/msg/pose.hpp>
#include <geometry_msgs/msg/twist.hpp>
#include <std_msgs/msg/header.hpp>
#include <string>

namespace geometry_msgs::msg {

struct PoseWithCovariance {
  Pose pose;
};

struct TwistWithCovariance {
  Twist twist;
};

}  // namespace geometry_msgs::msg

namespace nav_msgs::msg {

struct Odometry {
  std_msgs::msg::Header header;
  std::string child_frame_id;
  geometry_msgs::msg::PoseWithCovariance pose;
  geometry_msgs::msg::TwistWithCovariance twist;
};

}  // namespace nav_msgs::msg
