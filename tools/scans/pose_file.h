// Where a sensor was while it recorded: files as TUM's benchmarks have them, `seconds x y z qx qy qz qw` a line.
#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <vector>

namespace swarm {

struct TimedPose {
  double t_s = 0.0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               // W [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  // from sensor to W
};

// Between two poses, b later than a, at constant velocity and nearly constant rate, by arithmetic that is the same
// everywhere; the first or the last one beyond them.
TimedPose pose_between(const TimedPose& a, const TimedPose& b, double t_s);

class PoseTrack {
 public:
  // Lines that are empty or begin with # are passed over. Throws std::runtime_error with path, line, what is wrong and
  // the rule: eight numbers, times that grow, a quaternion of unit length within 0.01, at least two poses.
  explicit PoseTrack(const std::filesystem::path& path);

  double begin_s() const { return poses_.front().t_s; }
  double end_s() const { return poses_.back().t_s; }
  // pose_between() those before and after it; the first or the last one beyond them.
  TimedPose at(double t_s) const;
  // W [m/s].
  Eigen::Vector3d velocity_at(double t_s) const;

 private:
  // The last one that is not later, but not the very last.
  std::size_t before(double t_s) const;

  std::vector<TimedPose> poses_;
};

}  // namespace swarm
