#include "planner_daemon/search/kinodynamic_search.h"

#include <algorithm>
#include <cmath>

#include "planner_daemon/search/braking.h"

namespace swarm {
namespace {

// std::llround calls the library.
std::int64_t nearest(double value) {
  return static_cast<std::int64_t>(value + std::copysign(0.5, value));
}

}  // namespace

KinodynamicSearch::KinodynamicSearch(const SearchLimits& limits, const SearchOptions& options)
    : context_(limits, options, BlockedSpace::kForbidden),
      tree_(context_),
      shot_(context_),
      closed_(static_cast<std::size_t>(options.max_expansions) * 4),
      cell_mps_(std::min(options.cell_mps, 0.15 * limits.axis_mps2().minCoeff())) {
  open_.reserve(tree_.capacity());
  expanded_.reserve(static_cast<std::size_t>(options.max_expansions));
}

bool KinodynamicSearch::seen_before(const SearchNode& node) {
  const SearchOptions& options = context_.options;
  // Every way out of blocked space counts.
  const bool still_blocked = context_.start_blocked && node.depth * context_.primitives.tau_s() < options.leave_s;
  const bool slow = still_blocked || node.state.velocity.cwiseAbs().maxCoeff() < options.slow_mps;
  const double refine = slow ? 3.0 : 1.0;
  std::uint64_t key = mix(slow ? 1 : 0, node.depth);
  for (int axis = 0; axis < 3; ++axis) {
    key = mix(key, nearest(node.state.position[axis] / options.cell_m * refine));
    key = mix(key, nearest(node.state.velocity[axis] / cell_mps_ * refine));
  }
  return !closed_.insert(key);
}

SearchStatus KinodynamicSearch::find(const SearchProblem& problem, SearchResult* result) {
  context_.set(problem);
  shot_.reset();
  open_.clear();
  closed_.clear();
  expanded_.clear();
  result->expansions = 0;
  result->free_until_utime = kNever;
  result->settled = false;
  result->left_blocked = context_.start_blocked;
  const double tau_s = context_.primitives.tau_s();

  tree_.plant();
  open_.push({tree_.total(0), 0});
  while (!open_.empty() && result->expansions < context_.options.max_expansions) {
    const std::int32_t index = open_.pop();
    const SearchNode& node = tree_[index];
    if (seen_before(node)) continue;
    expanded_.push_back(index);
    ++result->expansions;
    // None before blocked space is left.
    if (!context_.may_be_blocked(node.depth, 0) &&
        node.time_to_goal_s <= (context_.options.num_pieces - node.depth) * tau_s && shot_.shoot(node, result)) {
      tree_.trace_back(index, result);
      return SearchStatus::kGoal;
    }
    if (node.depth < context_.primitives.max_depth()) {
      tree_.for_each_child(index, [this](std::int32_t child) { open_.push({tree_.total(child), child}); });
    } else if (brake_until_blocked(context_, node, result) == kNever) {
      tree_.trace_back(index, result);
      return SearchStatus::kSurvives;
    }
  }
  return settle(result);
}

SearchStatus KinodynamicSearch::settle(SearchResult* result) {
  result->settled = true;
  const auto cost = [this](std::int32_t index) {  // but for the time it takes to get there
    return tree_.total(index) - tree_[index].depth * context_.primitives.tau_s();
  };
  std::sort(expanded_.begin(), expanded_.end(),
            [&](std::int32_t a, std::int32_t b) { return cost(a) < cost(b) || (cost(a) == cost(b) && a < b); });
  std::int32_t longest = 0;
  Utime longest_until = Utime::min();
  for (const std::int32_t index : expanded_) {
    const Utime until = brake_until_blocked(context_, tree_[index], result);
    if (until > longest_until) longest_until = until, longest = index;
    if (until == kNever) break;
  }
  result->free_until_utime = brake_until_blocked(context_, tree_[longest], result);
  tree_.trace_back(longest, result);
  return longest_until == kNever ? SearchStatus::kSurvives : SearchStatus::kPartial;
}

}  // namespace swarm
