// Stands in for ROS 2's header: what tools/ros2 uses of it, and no more.
#pragma once

namespace geometry_msgs::msg {

struct Vector3 {
  double x = 0.0, y = 0.0, z = 0.0;
};

struct Twist {
  Vector3 linear, angular;
};

}  // namespace geometry_msgs::msg
