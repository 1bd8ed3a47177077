#include "planner_daemon/search/escape.h"

#include <algorithm>
#include <limits>

#include "planner_daemon/search/braking.h"

namespace swarm {
namespace {

constexpr int kLeadOn = 5;  // manoeuvres of the first phase that a second one follows
constexpr Duration kViolationStep = 10ms;
constexpr double kStrayCost = 1e6;    // of leaving the flight space: worse than any collision
constexpr double kRounding_m = 1e-3;  // of what is carried in floats

}  // namespace

EscapeSearch::EscapeSearch(const SearchLimits& limits, const SearchOptions& options)
    : context_(limits, options, BlockedSpace::kCosts), tree_(context_) {
  manoeuvres_.reserve(static_cast<std::size_t>(options.max_expansions));
}

void EscapeSearch::hold(std::int32_t index) {
  while (index >= 0 && tree_[index].depth < context_.primitives.max_depth()) index = tree_.add_child_alike(index);
}

double EscapeSearch::brake_violation(const SearchNode& node, SearchPath* path) const {
  double violation = 0.0;
  brake(context_, node, path, [&](const BrakeSample& sample) {
    if (sample.blocked_bit != 0 || sample.meets_wall) {
      const double ahead_s = to_seconds(sample.utime - context_.problem.start_utime);
      const Severity severity =
          sample.meets_wall ? Severity::kCollision : context_.problem.space->severity(sample.word, sample.blocked_bit);
      violation += sample.duration_s * context_.blocked_cost(ahead_s, severity);
    }
    if (sample.strays) violation += kStrayCost;
    return !sample.strays;
  });
  return violation;
}

// All manoeuvres of one phase; from the best of them, as far as the budget goes, all of another.
void EscapeSearch::find(const SearchProblem& problem, SearchResult* result) {
  context_.set(problem);
  context_.problem.fine = false;
  result->expansions = 0;
  result->free_until_utime = kNever;
  result->settled = false;
  result->left_blocked = context_.start_blocked;
  tree_.plant();
  OpenEntry best{std::numeric_limits<double>::infinity(), 0};
  manoeuvres_.assign(1, {0.0, 0});
  for (int phase = 0; phase < 2; ++phase) {
    const std::size_t first = phase == 0 ? 0 : tree_.size();
    const std::size_t width = phase == 0 ? 1 : kLeadOn;
    std::sort(manoeuvres_.begin(), manoeuvres_.end());
    for (std::size_t i = 0; i < std::min(width, manoeuvres_.size()); ++i) {
      if (tree_[manoeuvres_[i].node].depth == context_.primitives.max_depth()) continue;
      tree_.for_each_child(manoeuvres_[i].node, [this](std::int32_t child) { hold(child); });
    }
    manoeuvres_.clear();
    for (std::size_t i = first; i < tree_.size() && result->expansions < context_.options.max_expansions; ++i) {
      const auto index = static_cast<std::int32_t>(i);
      const double violation = brake_violation(tree_[index], result);
      ++result->expansions;
      manoeuvres_.push_back({tree_.total(index) + violation, index});
      best = std::min(best, manoeuvres_.back());
    }
  }
  (void)brake_violation(tree_[best.node], result);
  tree_.trace_back(best.node, result);
}

double EscapeSearch::violation_cost(const Motion& motion) const {
  double cost = 0.0;
  const Sogm& map = context_.problem.space->grid();
  const Eigen::AlignedBox3d& space = context_.space;
  Eigen::Vector3d before = motion.at(context_.problem.start_utime).position;
  for (Utime t = context_.problem.start_utime; t < context_.hover_until_utime; t += kViolationStep) {
    const Eigen::Vector3d position = motion.at(t).position;
    const auto severity = context_.problem.space->severity_at(position, map.frame_at(t));
    if (severity) cost += context_.blocked_cost(to_seconds(t - context_.problem.start_utime), *severity);
    // As in the search: whoever is outside may only come back.
    const Eigen::Array3d below = space.min() - position, above = position - space.max();
    const Eigen::Array3d moved = position - before;
    if ((below > kRounding_m && moved < 0.0).any() || (above > kRounding_m && moved > 0.0).any()) return kStrayCost;
    before = position;
  }
  return cost * to_seconds(kViolationStep);
}

}  // namespace swarm
