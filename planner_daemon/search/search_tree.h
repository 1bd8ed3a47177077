// The tree that a search grows: nodes, their children by motion primitives, and what these cost.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "planner_daemon/search/search_context.h"

namespace swarm {

struct SearchNode {
  struct State {
    Eigen::Vector3d position, velocity, acceleration;
    MotionState motion() const { return {position, velocity, acceleration, Eigen::Vector3d::Zero()}; }
  };
  State state;
  double cost = 0.0;
  double time_to_goal_s = 0.0;
  std::int32_t parent = -1;
  std::int16_t depth = 0;
};

class SearchTree {
 public:
  // Holds at most so many nodes per expansion: what comes then is dropped, the best were kept.
  static constexpr std::size_t kNodesPerExpansion = 32;

  // `context` must outlive it.
  explicit SearchTree(const SearchContext& context);

  // The root alone: the start of the context's problem.
  void plant();
  std::size_t size() const { return nodes_.size(); }
  std::size_t capacity() const { return nodes_.capacity(); }
  const SearchNode& operator[](std::int32_t index) const { return nodes_[static_cast<std::size_t>(index)]; }
  // Cost so far and weighted time to the goal.
  double total(std::int32_t index) const {
    const SearchNode& node = nodes_[static_cast<std::size_t>(index)];
    return node.cost + context_.options.heuristic_weight * node.time_to_goal_s;
  }

  // visit(index) of each child that is free, or may be blocked, by the primitives of a node.
  template <class Visit>
  void for_each_child(std::int32_t index, const Visit& visit);
  // The child by the primitive that goes on with the accelerations; -1: there is none.
  std::int32_t add_child_alike(std::int32_t index);

  // The knots from the root to a node.
  void trace_back(std::int32_t index, SearchPath* path) const;

 private:
  // Options of one axis and their parts of the heuristic.
  struct RatedOptions {
    AxisOptions options;
    std::array<GoalHeuristic::AxisTerm, 6> terms;
  };
  // The words of the layers that hold the samples of a primitive, 0 outside the window; but for inflation only where
  // something is near.
  struct SampleWords {
    std::array<std::size_t, kMaxSamples> index;
    std::array<std::uint64_t, kMaxSamples> inflation, recently_occupied, blocked;
    std::uint64_t any_inflation;
  };
  using Axes = std::array<RatedOptions, 3>;
  using Choice = std::array<std::size_t, 3>;  // numbers of the axes' options

  void rate(const SearchNode& node, Axes* axes) const;
  ConfigurationSpace::Layers look(const SearchNode& node, const Axes& axes) const;
  void look_up(const ConfigurationSpace::Layers& layers, const AxisSamples& x, const AxisSamples& y,
               const AxisSamples& z, int depth, SampleWords* words) const;
  // Cost of the layers one primitive passes; negative when it is blocked.
  double layer_cost(const SampleWords& words, const AxisSamples& x, const AxisSamples& y, const AxisSamples& z,
                    int depth) const;
  // -1 when it is blocked, or tilts the robot too far, or there is no room.
  std::int32_t add_child(std::int32_t index, const Axes& axes, const Choice& choice, const SampleWords& words);

  const SearchContext& context_;
  std::vector<SearchNode> nodes_;  // never more than it has room for: references to them stay good
};

template <class Visit>
void SearchTree::for_each_child(std::int32_t index, const Visit& visit) {
  const SearchNode& node = nodes_[static_cast<std::size_t>(index)];
  Axes axes;  // its own: a visitor may grow the tree on
  rate(node, &axes);
  const ConfigurationSpace::Layers layers = look(node, axes);
  const bool one_word = layers.blocked.geometry.words_per_column() == 1;
  const auto& [xs, ys, zs] = axes;
  const auto count = [](const RatedOptions& axis) { return static_cast<std::size_t>(axis.options.count); };
  SampleWords words;
  for (std::size_t x = 0; x < count(xs); ++x) {
    for (std::size_t y = 0; y < count(ys); ++y) {
      for (std::size_t z = 0; z < count(zs); ++z) {
        if (z == 0 || !one_word)
          look_up(layers, xs.options.option[x].samples, ys.options.option[y].samples, zs.options.option[z].samples,
                  node.depth, &words);
        if (const std::int32_t child = add_child(index, axes, {x, y, z}, words); child >= 0) visit(child);
      }
    }
  }
}

}  // namespace swarm
