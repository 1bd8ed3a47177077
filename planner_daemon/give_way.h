// Where a robot flies to for a while instead of its goal, so that it and others get on.
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>

#include "planner_daemon/planner.h"

namespace swarm {

class GiveWay {
 public:
  GiveWay(int robot_id, const PlannerConfig& config) : robot_id_(robot_id), config_(config) {}

  // For a request with its map, own motion, start, goal and peers, of the robot's own planner. None: to the goal.
  std::optional<Eigen::Vector3d> place(Utime now, const PlanRequest& request, Planner& planner);
  // By the clock of before it now is so much later.
  void shift(Duration step);

 private:
  // With the only peer around; until they part.
  struct Meeting {
    int peer_id;
    double way_m;  // the least one to the goal since then
    Utime since;   // and when it last became less
  };
  // Where it lets a peer pass.
  struct Beside {
    StaticHeuristic::Refuge refuge;
    Utime until;
    int peer_id;
    double left_m;  // that both have to fly until it has passed: the least so far
  };

  // A place farther from a peer beside which the robot rests, closer than plans may pass; none: there is no such peer.
  std::optional<Eigen::Vector3d> apart(const PlanRequest& request) const;
  // A place beside the way of a peer, or back from it; none: there is no such peer, or no such place.
  std::optional<Eigen::Vector3d> beside(Utime now, const PlanRequest& request, Planner& planner);
  bool still_waits(Utime now, const PlanRequest& request);
  // It has met a peer and has come no nearer to its goal for so long.
  Duration held_up(Utime now, const PlanRequest& request, const Planner& planner, const Peer& met);

  int robot_id_;
  PlannerConfig config_;
  std::optional<Meeting> meeting_;
  std::optional<Beside> beside_;
  std::map<int, Utime> stayed_;  // peers that did not come, though this robot had made way until then
};

}  // namespace swarm
