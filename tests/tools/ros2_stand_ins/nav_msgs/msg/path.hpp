// Stands in for ROS 2's header: what tools/ros2 uses of it, and no more.
#pragma once

#include <geometry_msgs/msg/pose_stamped.hpp>
#include <vector>

namespace nav_msgs::msg {

struct Path {
  std_msgs::msg::Header header;
  std::vector<geometry_msgs::msg::PoseStamped> poses;
};

}  // namespace nav_msgs::msg
