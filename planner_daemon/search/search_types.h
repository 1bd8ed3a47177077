// What a search is asked and what it answers.
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>

#include "planner_daemon/search/space_time_heuristic.h"
#include "planner_daemon/space/configuration_space.h"
#include "planner_daemon/trajectory/motion_limits.h"
#include "planner_daemon/trajectory/trajectory.h"

namespace swarm {

struct SearchLimits : MotionLimits {
  Eigen::Vector3d space_min = Eigen::Vector3d::Constant(-1e3);  // flight space of the robot's centre, W [m]
  Eigen::Vector3d space_max = Eigen::Vector3d::Constant(1e3);
};

struct SearchOptions {
  Duration piece = 200ms;    // duration tau of a primitive
  int num_pieces = 10;       // horizon in primitives, braking to rest included; <= Trajectory::kMaxPieces
  int max_expansions = 150;  // the budget, counted
  double heuristic_weight = 1.5;
  double cell_m = 0.3;            // closed list: position
  double cell_mps = 0.9;          // closed list: velocity
  double slow_mps = 0.6;          // nodes slower than this on every axis manoeuvre in a narrow place: a third of the
                                  // cells, and axes slower than half of it also a quarter of the acceleration
  double effort_weight = 0.072;   // cost per second of full acceleration, with its square, on each axis
  double inflation_weight = 0.4;  // cost per second spent in the inflation layer; well below 1, or narrow places are
                                  // shunned
  double recently_occupied_weight = 1.0;  // cost per second where something was recently, on top
  double leave_s = 0.45;                  // a robot that starts in blocked space may take this long to leave it
  double leave_weight = 30.0;  // cost per second of that; ten times as much within the emergency clearance and again
                               // in a collision
};

struct SearchProblem {
  MotionState start;
  Utime start_utime{};
  Eigen::Vector3d goal = Eigen::Vector3d::Zero();  // W [m]
  double v_max_mps =
      std::numeric_limits<double>::infinity();    // per axis, where the limits allow more; faster starts brake
  ConfigurationSpace* space = nullptr;            // composed; works out what is looked at
  const SpaceTimeHeuristic* heuristic = nullptr;  // knows detours and waits; null: none
  bool fine = true;  // slow nodes manoeuvre finely (see slow_mps): narrow places, at a price
};

enum class SearchStatus {
  kGoal,      // comes to rest at the goal within the horizon
  kSurvives,  // stays free and comes to rest at the horizon
  kPartial,   // no free motion survives: the longest one, free until free_until_utime
};
const char* to_string(SearchStatus status);

// Knots of a motion that ends at rest, a primitive's duration apart.
struct SearchPath {
  std::array<MotionState, Trajectory::kMaxPieces + 1> knots;
  int num_pieces = 0;  // up to rest: fewer than the horizon when it rests at the goal earlier

  const MotionState& start() const { return knots.front(); }
  const MotionState& end() const { return knots[static_cast<std::size_t>(num_pieces)]; }
};

struct SearchResult : SearchPath {
  Utime free_until_utime{};   // the path meets blocked space then; kNever: not within the map; of an escape always
  int expansions = 0;         // nodes expanded; of an escape: manoeuvres looked at
  bool settled = false;       // the budget was spent or nothing was left to expand: the best seen
  bool left_blocked = false;  // it started in blocked space
};

}  // namespace swarm
