// What all parts of a search share: limits, options, the problem, and where in the maps its primitives are sampled.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "planner_daemon/search/goal_heuristic.h"
#include "planner_daemon/search/primitives.h"
#include "planner_daemon/search/search_types.h"

namespace swarm {

enum class BlockedSpace {
  kForbidden,  // but for a start inside it, which is left within SearchOptions::leave_s
  kCosts,      // may be passed everywhere, at the cost of leaving it
};

struct SearchContext {
  // Throws what Primitives throws.
  SearchContext(const SearchLimits& limits_in, const SearchOptions& options_in, BlockedSpace rule_in);

  // Another problem; its space must be composed.
  void set(const SearchProblem& problem_in);

  Utime utime_at(int depth) const { return problem.start_utime + depth * options.piece; }
  // Whether a sample of a primitive may lie in blocked space.
  bool may_be_blocked(int depth, int sample) const {
    return rule == BlockedSpace::kCosts ||
           (start_blocked &&
            (depth + (sample + 1.0) / primitives.num_samples()) * primitives.tau_s() <= options.leave_s);
  }
  // Frames in force during a primitive.
  int first_frame(int depth) const { return first_words[static_cast<std::size_t>(depth)].front() / words_per_frame; }
  int last_frame(int depth) const {
    return first_words[static_cast<std::size_t>(depth)][static_cast<std::size_t>(primitives.num_samples()) - 1] /
           words_per_frame;
  }
  Utime utime_of_sample(int depth, int sample) const {
    return utime_at(depth) + (sample + 1) * options.piece / primitives.num_samples();
  }
  // Cost per second in blocked space, so long after the start.
  double blocked_cost(double ahead_s, Severity severity) const;

  SearchLimits limits;
  SearchOptions options;
  BlockedSpace rule;
  Primitives primitives;

  SearchProblem problem;
  double v_max_mps = 0.0;  // of the limits and the problem the lower one
  GoalHeuristic heuristic;
  Eigen::AlignedBox3d space;  // that paths must not leave: the flight space, as far as the map goes, W [m]
  bool start_blocked = false;
  Utime hover_until_utime{};                                       // end of horizon and map
  int words_per_frame = 0;                                         // of the maps
  std::vector<std::array<std::int32_t, kMaxSamples>> first_words;  // of the frame in force, by depth and sample
  std::vector<int> heuristic_steps;                                // at the end of each depth
};

}  // namespace swarm
