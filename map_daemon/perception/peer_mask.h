// Who flies is no obstacle: where the robot itself and its peers were at the time of a scan, by what they announced.
#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "lcmtypes/bus/time.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

class PeerMask {
 public:
  struct Ball {
    Eigen::Vector3d center;  // W [m]
    double radius_m;

    bool contains(const Eigen::Vector3d& place) const { return (place - center).squaredNorm() <= radius_m * radius_m; }
  };

  // `margin_m`: around each, for how far scans and announcements err about where a robot is. Who was not heard for
  // `timeout` is masked no longer.
  PeerMask(double margin_m, Duration timeout) : margin_m_(margin_m), timeout_(timeout) {}

  // An announcement that passed decode(), newer than those of that robot before.
  void hear(const sogm_swarm::announcement_t& announcement, Utime now);
  // The clock was set.
  void shift(Duration step);

  // Where they were at `utime`. Valid until the next call.
  const std::vector<Ball>& at(Utime utime);

 private:
  struct Robot {
    Motion motion;
    Trajectory before;  // what it flew until `motion` began: scans are of a moment ago
    double radius_m = 0.0;
    Utime heard{};
  };

  double margin_m_;
  Duration timeout_;
  std::map<int, Robot> robots_;  // by id
  std::vector<Ball> balls_;
};

}  // namespace swarm
