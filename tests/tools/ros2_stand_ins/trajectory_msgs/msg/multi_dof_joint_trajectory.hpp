// Stands in for ROS 2's header: what tools/ros2 uses of it, and no more.
#pragma once

#include <geometry_msgs/msg/pose.hpp>
#include <geometry_msgs/msg/twist.hpp>
#include <std_msgs/msg/header.hpp>
#include <string>
#include <vector>

namespace geometry_msgs::msg {

struct Transform {
  Vector3 translation;
  Quaternion rotation;
};

}  // namespace geometry_msgs::msg

namespace trajectory_msgs::msg {

struct MultiDOFJointTrajectoryPoint {
  std::vector<geometry_msgs::msg::Transform> transforms;
  std::vector<geometry_msgs::msg::Twist> velocities, accelerations;
};

struct MultiDOFJointTrajectory {
  std_msgs::msg::Header header;
  std::vector<std::string> joint_names;
  std::vector<MultiDOFJointTrajectoryPoint> points;
};

}  // namespace trajectory_msgs::msg
