// Messages of the onboard bus to those of ROS 2, all in W under the frame_id `frame`.
#pragma once

#include <builtin_interfaces/msg/time.hpp>
#include <nav_msgs/msg/path.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>
#include <string>
#include <trajectory_msgs/msg/multi_dof_joint_trajectory.hpp>

#include "map_daemon/sogm.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// UTC.
builtin_interfaces::msg::Time stamp_of(Utime utime);

// What a robot is bound to fly, every 0.1 s from `from` or its start on, the later one, and at its end, each pose with
// its time. It says nothing of where the robot faces. So many poses as it is long: the caller sees to that.
nav_msgs::msg::Path path_of(const Motion& motion, Utime from, const std::string& frame);

// One point for a trajectory follower: position and yaw; velocity and yaw rate; acceleration.
trajectory_msgs::msg::MultiDOFJointTrajectory command_of(Utime utime, const MotionState& state, double yaw_rad,
                                                         double yaw_rate_radps, const std::string& frame);

// The centres of the voxels that are occupied in a frame of the map [m], at the time at which that begins.
sensor_msgs::msg::PointCloud2 cloud_of(const Sogm& sogm, int frame_of_map, const std::string& frame);

}  // namespace swarm
