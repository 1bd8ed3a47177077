#include "tools/scans/pose_file.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>

namespace swarm {
namespace {

constexpr double kUnit = 0.01;  // of a quaternion's length
constexpr double kFar_m = 1e5;

TimedPose pose_of(const std::string& line, const std::string& where) {
  std::istringstream in(line);
  double v[8];
  for (double& value : v)
    if (!(in >> value)) throw std::runtime_error(where + ": must be 't x y z qx qy qz qw'");
  std::string more;
  if (in >> more) throw std::runtime_error(where + ": '" + more + "' is more than 't x y z qx qy qz qw'");
  if (!std::all_of(v, v + 8, [](double value) { return std::isfinite(value); }))
    throw std::runtime_error(where + ": must be finite numbers");
  TimedPose pose{v[0], {v[1], v[2], v[3]}, Eigen::Quaterniond(v[7], v[4], v[5], v[6])};
  if (pose.position.cwiseAbs().maxCoeff() > kFar_m) throw std::runtime_error(where + ": must be within 1e5 m");
  if (std::abs(pose.orientation.norm() - 1.0) > kUnit)
    throw std::runtime_error(where + ": the quaternion's length is " + std::to_string(pose.orientation.norm()) +
                             ", must be 1");
  pose.orientation.normalize();
  return pose;
}

}  // namespace

PoseTrack::PoseTrack(const std::filesystem::path& path) {
  std::ifstream in(path);
  if (!in) throw std::runtime_error(path.string() + ": must be a readable file");
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::size_t first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos || line[first] == '#') continue;
    const std::string where = path.string() + ":" + std::to_string(number);
    const TimedPose pose = pose_of(line, where);
    if (!poses_.empty() && pose.t_s <= poses_.back().t_s)
      throw std::runtime_error(where + ": time " + std::to_string(pose.t_s) + ": must be later than that before");
    poses_.push_back(pose);
  }
  if (poses_.size() < 2) throw std::runtime_error(path.string() + ": must have two poses at least");
}

std::size_t PoseTrack::before(double t_s) const {
  const auto later = std::upper_bound(poses_.begin() + 1, poses_.end() - 1, t_s,
                                      [](double t, const TimedPose& pose) { return t < pose.t_s; });
  return static_cast<std::size_t>(later - poses_.begin()) - 1;
}

TimedPose PoseTrack::at(double t_s) const {
  return pose_between(poses_[before(t_s)], poses_[before(t_s) + 1], t_s);
}

TimedPose pose_between(const TimedPose& a, const TimedPose& b, double t_s) {
  const double share = std::clamp((t_s - a.t_s) / (b.t_s - a.t_s), 0.0, 1.0);
  const double sign = a.orientation.dot(b.orientation) < 0.0 ? -1.0 : 1.0;
  const Eigen::Vector4d turned = (1.0 - share) * a.orientation.coeffs() + sign * share * b.orientation.coeffs();
  return {t_s, a.position + share * (b.position - a.position), Eigen::Quaterniond(turned.normalized())};
}

Eigen::Vector3d PoseTrack::velocity_at(double t_s) const {
  const TimedPose &a = poses_[before(t_s)], &b = poses_[before(t_s) + 1];
  if (t_s < begin_s() || t_s > end_s()) return Eigen::Vector3d::Zero();
  return (b.position - a.position) / (b.t_s - a.t_s);
}

}  // namespace swarm
