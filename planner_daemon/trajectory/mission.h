// Missions: places that a robot flies to one after the other, and how far it has come.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <vector>

#include "lcmtypes/bus/time.h"
#include "planner_daemon/trajectory/bezier.h"
#include "sogm_swarm/goal_t.hpp"

namespace swarm {

struct Waypoint {
  static constexpr double kUsualTolerance_m = 0.1;

  Eigen::Vector3d position = Eigen::Vector3d::Zero();          // W [m]
  double tolerance_m = kUsualTolerance_m;                      // so near it counts as reached
  double speed_mps = std::numeric_limits<double>::infinity();  // limit per axis on the way there, if it is lower
  Duration wait{};                                             // stays that near for so long before it goes on
  bool operator==(const Waypoint&) const = default;
};
using Mission = std::vector<Waypoint>;

// What a goal message asks for, from a message that passed decode(); never empty.
Mission mission_of(const sogm_swarm::goal_t& message);
// The message without its header, of 1 to kMaxWaypoints waypoints.
sogm_swarm::goal_t to_goal(const Mission& mission);

// Where a robot is on its mission.
class MissionProgress {
 public:
  // The same mission again goes on where it was; another one begins.
  void fly(Mission mission);
  // The robot is here now. Goes on to the next waypoint where this one is reached, was waited at, and the robot is no
  // faster than it may be from there on.
  void pass(Utime now, const MotionState& robot);
  // By the clock of before it now is so much later.
  void shift(Duration step);

  bool empty() const { return mission_.empty(); }
  int index() const { return static_cast<int>(index_); }
  int size() const { return static_cast<int>(mission_.size()); }
  const Waypoint& waypoint() const { return mission_[index_]; }  // that it flies to; not of an empty mission

 private:
  Mission mission_;
  std::size_t index_ = 0;
  std::optional<Utime> near_since_;  // the waypoint
};

}  // namespace swarm
