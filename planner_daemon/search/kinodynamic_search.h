// Kinodynamic A* through the SOGM (paper section IV-A): motion primitives of a double integrator with continuous
// acceleration, a time-optimal heuristic (Pontryagin), and survival to the horizon as the goal.
#pragma once

#include <cstdint>
#include <vector>

#include "planner_daemon/search/goal_shot.h"
#include "planner_daemon/search/search_context.h"
#include "planner_daemon/search/search_lists.h"
#include "planner_daemon/search/search_tree.h"
#include "planner_daemon/search/search_types.h"

namespace swarm {

class KinodynamicSearch {
 public:
  // Throws std::invalid_argument when the braking distance does not fit the horizon (num_pieces too small).
  KinodynamicSearch(const SearchLimits& limits, const SearchOptions& options);
  KinodynamicSearch(const KinodynamicSearch&) = delete;  // its parts refer to each other
  KinodynamicSearch& operator=(const KinodynamicSearch&) = delete;

  SearchStatus find(const SearchProblem& problem, SearchResult* result);

  // Of the problem last searched: what the path does not leave.
  const Eigen::AlignedBox3d& space() const { return context_.space; }
  // Of the problem last searched: time to the goal, but for accelerations, of a robot that comes to rest there [s].
  double time_to_goal(const Eigen::Vector3d& position) const {
    return context_.heuristic.time_to_goal_at_rest(position);
  }

 private:
  // Whether a node like this one, at the same depth, was expanded before; now it was.
  bool seen_before(const SearchNode& node);
  // The budget is spent or nothing is left to expand: the node nearest to the goal that can come to rest, or else the
  // motion that stays free the longest.
  SearchStatus settle(SearchResult* result);

  SearchContext context_;
  SearchTree tree_;
  GoalShot shot_;
  OpenList open_;
  ClosedList closed_;
  std::vector<std::int32_t> expanded_;
  double cell_mps_;  // of the closed list
};

}  // namespace swarm
