// How far a robot drifts from where it takes itself to be: its odometry's frame moves and turns in the world, as a
// recorded one did.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <string>

#include "planner_daemon/trajectory/bezier.h"
#include "tools/scans/pose_file.h"

namespace swarm {

// Of a sensor, a body or a frame, in the world.
struct Pose {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               // W [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  // to W
};

Pose operator*(const Pose& outer, const Pose& inner);
Pose inverse(const Pose& pose);

class PoseDrift {
 public:
  // `file`: the odometry's error by time, as poses (pose_file.h): what is truly at p is taken to be at R p + t. It
  // counts from where in the file it begins, which `seed` tells, and after the end of the file it stays. Throws
  // std::runtime_error when the file is not such.
  PoseDrift(const std::string& file, std::uint64_t seed);

  // From truth to where things are taken to be, at world time `t_s`; none until 0.
  Pose at(double t_s) const;
  // Where one is who takes itself to be in this state.
  MotionState truth_of(const MotionState& believed, double t_s) const;

 private:
  PoseTrack errors_;
  double begin_s_;
  Pose first_;  // inverse of the error there
};

}  // namespace swarm
