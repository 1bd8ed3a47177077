// ROS 2 messages to those of the onboard bus. Of every message the numbers must be finite and within the ranges of the
// .lcm files, quaternions of unit length within 0.01, and its frame_id must be that of W, unless something else is
// said.
#pragma once

#include <Eigen/Core>
#include <builtin_interfaces/msg/time.hpp>
#include <cstdint>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <nav_msgs/msg/odometry.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>
#include <string>
#include <vector>
#include <visualization_msgs/msg/marker_array.hpp>

#include "lcmtypes/bus/time.h"
#include "sogm_swarm/goal_t.hpp"
#include "sogm_swarm/obstacles_t.hpp"
#include "sogm_swarm/robot_state_t.hpp"
#include "tools/scans/pose_file.h"

namespace swarm {

// Why a message was refused, all of it.
enum class RosRefusal : std::uint8_t {
  kFrame,       // in another frame
  kTime,        // too old, or from the future
  kOrder,       // not newer than the one before
  kValue,       // not finite, or out of range
  kQuaternion,  // not of unit length
  kLayout,      // a cloud whose fields or sizes are others
  kPose,        // a cloud from when it is not known where the robot was
};
inline constexpr int kNumRosRefusals = 7;
const char* to_string(RosRefusal reason);

// What the functions below throw: the reason, and what is wrong with which rule.
struct RosRefused {
  RosRefusal reason;
  std::string words;
};

// UTC.
Utime utime_of(const builtin_interfaces::msg::Time& stamp);

// The messages have no header yet, but for the utime where one is said.
//
// The twist is in the child frame, as nav_msgs has it, or in W where the child frame is that of W.
sogm_swarm::robot_state_t state_of(const nav_msgs::msg::Odometry& odometry, const std::string& frame);
// Of the body; good where state_of() took the message.
TimedPose body_pose_of(const nav_msgs::msg::Odometry& odometry);

// One place, as accurate and as fast as usual; the way that it faces means nothing.
sogm_swarm::goal_t goal_of(const geometry_msgs::msg::PoseStamped& pose, const std::string& frame);

// How well trackers know, for they do not say: standard deviations of an axis.
struct MarkerSigmas {
  double position_m = 0.05, velocity_mps = 0.2;
};

struct MarkerObstacles {
  sogm_swarm::obstacles_t message;  // header.utime: of the newest marker, `now` where there is none
  int passed_over = 0;              // markers of other types
};

// Cylinders (columns), cubes (boxes) and spheres; what of the first two does not stand upright is the upright box
// around it. One is known by its namespace and id. An arrow of two points in the namespace NS/velocity says where the
// marker of NS with its id will be in a second; without one, velocities are not measured. Actions are done in order as
// RViz does them, and an array with a DELETEALL tells of all that is there (`complete`). Markers of one array must be
// stamped within a second.
MarkerObstacles obstacles_of(const visualization_msgs::msg::MarkerArray& markers, const std::string& frame,
                             const MarkerSigmas& sigmas, Utime now);

// Points of a cloud in its frame, whatever that is [m]: fields x, y and z, all FLOAT32 or FLOAT64, little-endian. Those
// that are no numbers, as organised clouds have where nothing was measured, or beyond kMaxPosition_m are left out.
std::vector<Eigen::Vector3d> points_of(const sensor_msgs::msg::PointCloud2& cloud);

}  // namespace swarm
