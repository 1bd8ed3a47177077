// The simulated depth cameras or LiDARs of a robot: what they measure of the world, with their noise, and where they
// take themselves to be.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "lcmtypes/bus/time.h"
#include "sogm_swarm/depth_image_t.hpp"
#include "sogm_swarm/lidar_scan_t.hpp"
#include "swarm_sim/environment/pose_drift.h"
#include "swarm_sim/environment/ray_caster.h"
#include "swarm_sim/environment/wander.h"
#include "swarm_sim/world/random.h"

namespace swarm {

// How it sits on a body, and looks along x.
Pose pose_of(const Mount& mount);

// A body that flies with this acceleration (W [m/s^2]) and looks to `yaw_rad`: its rotors push along its z axis.
Eigen::Quaterniond attitude_of(const Eigen::Vector3d& acceleration, double yaw_rad);

class RangeSensors {
 public:
  // The same robot of the same world measures the same. `world` must outlive it.
  RangeSensors(const World& world, int robot_id);

  Duration period() const;

  // What they measure at world time `t_s` on a body at `truth` that takes itself to be at `believed`; without headers.
  // As messages: the parts of a LIDAR_SCAN of each, or a DEPTH_IMAGE of each.
  std::vector<sogm_swarm::lidar_scan_t> scan(RayCaster& caster, const std::vector<RayCaster::Ball>& robots, double t_s,
                                             const Pose& truth, const Pose& believed);
  std::vector<sogm_swarm::depth_image_t> images(RayCaster& caster, const std::vector<RayCaster::Ball>& robots,
                                                double t_s, const Pose& truth, const Pose& believed);

 private:
  Pose with_error(const Pose& pose, double t_s);
  // Distances of rays in a grid of `width` a row, as measured; 0 where nothing was.
  void measure(RayCaster& caster, const Eigen::Matrix3d& to_world, int width, double least_m, double range_m,
               double noise_per_m2);

  SensorOptions options_;
  std::vector<Pose> mounts_;  // on the body
  Random random_;
  EstimateError position_error_, turn_error_;
  double last_t_s_ = -1.0;
  std::vector<Eigen::Vector3d> directions_;  // of length 1, in the sensor's frame
  std::vector<double> true_m_, measured_m_;
};

}  // namespace swarm
