#include "planner_daemon/trajectory/mission.h"

#include <cmath>
#include <utility>

namespace swarm {

Mission mission_of(const sogm_swarm::goal_t& message) {
  Mission mission;
  for (const sogm_swarm::waypoint_t& place : message.waypoints) {
    Waypoint& waypoint = mission.emplace_back(Waypoint{Eigen::Vector3d(place.position)});
    if (place.tolerance > 0.0) waypoint.tolerance_m = place.tolerance;
    if (place.speed > 0.0) waypoint.speed_mps = place.speed;
    waypoint.wait = to_duration(place.wait);
  }
  return mission;
}

sogm_swarm::goal_t to_goal(const Mission& mission) {
  sogm_swarm::goal_t message{};
  for (const Waypoint& waypoint : mission) {
    sogm_swarm::waypoint_t& place = message.waypoints.emplace_back();
    Eigen::Map<Eigen::Vector3d>(place.position) = waypoint.position;
    place.tolerance = waypoint.tolerance_m;
    place.speed = std::isfinite(waypoint.speed_mps) ? waypoint.speed_mps : 0.0;
    place.wait = to_seconds(waypoint.wait);
  }
  message.num_waypoints = static_cast<std::int32_t>(mission.size());
  return message;
}

void MissionProgress::fly(Mission mission) {
  if (mission == mission_) return;
  mission_ = std::move(mission);
  index_ = 0;
  near_since_.reset();
}

void MissionProgress::pass(Utime now, const MotionState& robot) {
  if (empty()) return;
  const bool is_near = (robot.position - waypoint().position).norm() <= waypoint().tolerance_m;
  if (!is_near) near_since_.reset();
  if (!is_near || index_ + 1 == mission_.size()) return;
  if (!near_since_ || *near_since_ > now) near_since_ = now;
  const bool is_slow = robot.velocity.cwiseAbs().maxCoeff() <= mission_[index_ + 1].speed_mps;
  if (now - *near_since_ < waypoint().wait || !is_slow) return;
  ++index_;
  near_since_.reset();
}

void MissionProgress::shift(Duration step) {
  if (near_since_) *near_since_ += step;
}

}  // namespace swarm
