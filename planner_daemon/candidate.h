// What could be flown next, and the policy that chooses: apart from how it is planned.
#pragma once

#include <span>

#include "planner_daemon/trajectory/trajectory.h"

namespace swarm {

struct Candidate {
  enum class Kind {
    kSmooth,   // the optimised trajectory
    kRaw,      // the search's own path
    kBlocked,  // the same, but it is not free all the way, or passes the limits
    kEscape,   // what violates least, in pieces of half the duration
    kOwn,      // the motion already flown
  };
  Kind kind;
  Trajectory trajectory;        // empty for the own motion
  double violation_cost = 0.0;  // of the blocked space that it passes; 0: free
  double time_to_goal_s = 0.0;  // from where it ends
};

// What the search says of the place the robot is in.
struct Situation {
  bool in_danger = false;  // it begins in blocked space, or nothing survives
  bool is_stuck = false;   // the search spent its budget: its path ends where it got to
};

struct Choice {
  const Candidate* planned;
  bool fly;  // false: the own motion is the better one
};

// `candidates`: what was planned first, then an escape and the own motion, if there are.
Choice choose(std::span<const Candidate> candidates, const Situation& situation);

}  // namespace swarm
