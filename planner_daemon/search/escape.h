// The answer to an emergency, when nothing free survives: the manoeuvre that violates the clearance least.
#pragma once

#include <vector>

#include "planner_daemon/search/search_context.h"
#include "planner_daemon/search/search_lists.h"
#include "planner_daemon/search/search_tree.h"
#include "planner_daemon/search/search_types.h"

namespace swarm {

// Looks at manoeuvres of two phases, not at a tree that drops nodes alike: one that brakes is alike after 0.1 s.
class EscapeSearch {
 public:
  // Throws what KinodynamicSearch throws.
  EscapeSearch(const SearchLimits& limits, const SearchOptions& options);
  EscapeSearch(const EscapeSearch&) = delete;  // its parts refer to each other
  EscapeSearch& operator=(const EscapeSearch&) = delete;

  // In each phase an acceleration is held for some primitives, then the robot brakes; the least cost and violation,
  // counted to the end of the map, wins. As many as the budget allows: all of one phase, then those of a second one
  // after the best of the first. Slow nodes do not manoeuvre finely, whatever the problem says.
  void find(const SearchProblem& problem, SearchResult* result);

  // Of the problem last searched: what a motion costs from the start to the end of horizon and map by passing blocked
  // space, weighed by how deep and how soon; or by leaving the flight space, which is worse than anything.
  double violation_cost(const Motion& motion) const;

 private:
  // From a node on with the same accelerations, as far as it goes.
  void hold(std::int32_t index);
  // Of braking from a node.
  double brake_violation(const SearchNode& node, SearchPath* path) const;

  SearchContext context_;
  SearchTree tree_;
  std::vector<OpenEntry> manoeuvres_;
};

}  // namespace swarm
