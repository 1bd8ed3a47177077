// The flight controller's local frame (north, east, down; yaw clockwise from north) and our world frame W (x and y
// level, z up; yaw counter-clockwise from x). Both are right-handed.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <numbers>

namespace swarm {

// Vectors as MAVLink carries them.
inline std::array<float, 3> to_floats(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}
inline Eigen::Vector3d to_vector(const std::array<float, 3>& values) {
  return Eigen::Vector3f::Map(values.data()).cast<double>();
}

class NedFrame {
 public:
  // `north_rad`: yaw of north in W, 0 where W's x axis points north. `origin`: of the controller's frame, in W [m].
  NedFrame(double north_rad, const Eigen::Vector3d& origin) : north_rad_(north_rad), origin_(origin) {
    const double c = std::cos(north_rad), s = std::sin(north_rad);
    from_world_ << c, s, 0, s, -c, 0, 0, 0, -1;  // rows: north, east, down in W
  }

  Eigen::Vector3d position_to_ned(const Eigen::Vector3d& in_world) const { return from_world_ * (in_world - origin_); }
  Eigen::Vector3d position_to_world(const Eigen::Vector3d& ned) const { return to_world(ned) + origin_; }
  // Velocities, accelerations.
  Eigen::Vector3d to_ned(const Eigen::Vector3d& in_world) const { return from_world_ * in_world; }
  Eigen::Vector3d to_world(const Eigen::Vector3d& ned) const { return from_world_.transpose() * ned; }
  // Either way: yaw in the one is what it is in the other, within [-pi, pi].
  double yaw(double yaw_rad) const { return std::remainder(north_rad_ - yaw_rad, 2 * std::numbers::pi); }

 private:
  double north_rad_;
  Eigen::Vector3d origin_;
  Eigen::Matrix3d from_world_;
};

}  // namespace swarm
