#include "planner_daemon/search/search_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace swarm {

SearchTree::SearchTree(const SearchContext& context) : context_(context) {
  nodes_.reserve(static_cast<std::size_t>(context.options.max_expansions) * kNodesPerExpansion);
}

void SearchTree::plant() {
  const MotionState& start = context_.problem.start;
  SearchNode root;
  root.state = {start.position, start.velocity, start.acceleration};
  const int step = context_.heuristic.step_at(context_.problem.start_utime);
  const auto term = [&](int axis) {
    return context_.heuristic.axis_term(step, axis, start.position[axis], start.velocity[axis]);
  };
  root.time_to_goal_s = context_.heuristic.time_to_goal(step, term(0), term(1), term(2));
  nodes_.clear();
  nodes_.push_back(root);
}

void SearchTree::rate(const SearchNode& node, Axes* axes) const {
  const int step = context_.heuristic_steps[static_cast<std::size_t>(node.depth)];
  const MotionState from = node.state.motion();
  for (int axis = 0; axis < 3; ++axis) {
    RatedOptions& rated = (*axes)[static_cast<std::size_t>(axis)];
    context_.primitives.axis_options(axis, from, context_.problem.fine, &rated.options);
    for (std::size_t i = 0; i < static_cast<std::size_t>(rated.options.count); ++i) {
      const AxisOption& option = rated.options.option[i];
      rated.terms[i] = context_.heuristic.axis_term(step, axis, option.position, option.velocity);
    }
  }
}

// Has the layers worked out that the node's primitives pass.
ConfigurationSpace::Layers SearchTree::look(const SearchNode& node, const Axes& axes) const {
  Columns columns{Eigen::Vector2i::Constant(std::numeric_limits<int>::max()),
                  Eigen::Vector2i::Constant(std::numeric_limits<int>::min())};
  for (int axis = 0; axis < 2; ++axis) {
    const AxisOptions& options = axes[static_cast<std::size_t>(axis)].options;
    for (std::size_t i = 0; i < static_cast<std::size_t>(options.count); ++i) {
      columns.first[axis] = std::min(columns.first[axis], options.option[i].samples.low);
      columns.last[axis] = std::max(columns.last[axis], options.option[i].samples.high);
    }
  }
  return context_.problem.space->layers(context_.first_frame(node.depth), context_.last_frame(node.depth), columns);
}

void SearchTree::look_up(const ConfigurationSpace::Layers& layers, const AxisSamples& x, const AxisSamples& y,
                         const AxisSamples& z, int depth, SampleWords* words) const {
  const auto& first_words = context_.first_words[static_cast<std::size_t>(depth)];
  const auto num_samples = static_cast<std::size_t>(context_.primitives.num_samples());
  std::array<std::uint64_t, kMaxSamples> inside;
  words->any_inflation = 0;
  for (std::size_t first = 0; first < num_samples; first += kBlockSamples) {
    for (std::size_t i = first; i < first + kBlockSamples; ++i) {
      words->index[i] = static_cast<std::size_t>(first_words[i] + x.offset[i] + y.offset[i] + z.offset[i]);
      inside[i] = x.in_window[i] & y.in_window[i];
      words->inflation[i] = layers.inflation.words()[words->index[i]] & inside[i];
      words->any_inflation |= words->inflation[i];
    }
  }
  if (words->any_inflation == 0) return;
  for (std::size_t first = 0; first < num_samples; first += kBlockSamples) {
    for (std::size_t i = first; i < first + kBlockSamples; ++i) {
      words->recently_occupied[i] = layers.recently_occupied.words()[words->index[i]] & inside[i];
      words->blocked[i] = layers.blocked.words()[words->index[i]] & inside[i];
    }
  }
}

double SearchTree::layer_cost(const SampleWords& words, const AxisSamples& x, const AxisSamples& y,
                              const AxisSamples& z, int depth) const {
  const int num_samples = context_.primitives.num_samples();
  const auto any = [&](const std::array<std::uint64_t, kMaxSamples>& layer) {
    std::uint64_t bits = 0;
    for (std::size_t first = 0; first < static_cast<std::size_t>(num_samples); first += kBlockSamples) {
      for (std::size_t i = first; i < first + kBlockSamples; ++i) bits |= layer[i] & z.in_window[i];
    }
    return bits != 0;
  };
  if (words.any_inflation == 0 || !any(words.inflation)) return 0.0;  // inflation holds the other layers
  const double tau_s = context_.primitives.tau_s();
  double cost = 0.0;
  if (any(words.blocked)) {
    if (!context_.start_blocked && context_.rule == BlockedSpace::kForbidden) return -1.0;
    for (int i = 0; i < num_samples; ++i) {
      const auto sample = static_cast<std::size_t>(i);
      const std::uint64_t bit = words.blocked[sample] & z.in_window[sample];
      if (bit == 0) continue;
      if (!context_.may_be_blocked(depth, i)) return -1.0;
      cost += context_.blocked_cost((depth + (i + 1.0) / num_samples) * tau_s,
                                    context_.problem.space->severity(words.index[sample], bit));
    }
  }
  if (context_.problem.space->has_walls()) {
    for (int i = 0; i < num_samples; ++i) {
      const auto sample = static_cast<std::size_t>(i);
      if ((words.inflation[sample] & z.in_window[sample]) == 0 ||
          !context_.problem.space->meets_wall(x.half[sample], y.half[sample], z.half[sample]))
        continue;
      if (!context_.may_be_blocked(depth, i)) return -1.0;
      cost += context_.blocked_cost((depth + (i + 1.0) / num_samples) * tau_s, Severity::kCollision);
    }
  }
  int inflation = 0, recently_occupied = 0;
  for (std::size_t first = 0; first < static_cast<std::size_t>(num_samples); first += kBlockSamples) {
    for (std::size_t i = first; i < first + kBlockSamples; ++i) {
      inflation += (words.inflation[i] & z.in_window[i]) != 0;
      recently_occupied += (words.recently_occupied[i] & z.in_window[i]) != 0;
    }
  }
  cost += inflation * context_.options.inflation_weight + recently_occupied * context_.options.recently_occupied_weight;
  return cost * tau_s / num_samples;
}

std::int32_t SearchTree::add_child(std::int32_t index, const Axes& axes, const Choice& choice,
                                   const SampleWords& words) {
  if (nodes_.size() == nodes_.capacity()) return -1;
  const auto& [xs, ys, zs] = axes;
  const AxisOption &x = xs.options.option[choice[0]], &y = ys.options.option[choice[1]];
  const AxisOption& z = zs.options.option[choice[2]];
  if (!context_.primitives.can_tilt(x.acceleration, y.acceleration, z.acceleration)) return -1;
  const SearchNode& node = nodes_[static_cast<std::size_t>(index)];
  const double layers = layer_cost(words, x.samples, y.samples, z.samples, node.depth);
  if (layers < 0.0) return -1;
  SearchNode child;
  child.state = {{x.position, y.position, z.position},
                 {x.velocity, y.velocity, z.velocity},
                 {x.acceleration, y.acceleration, z.acceleration}};
  child.cost = node.cost + layers + context_.primitives.tau_s() * (1.0 + x.effort + y.effort + z.effort);
  child.time_to_goal_s = context_.heuristic.time_to_goal(context_.heuristic_steps[static_cast<std::size_t>(node.depth)],
                                                         xs.terms[choice[0]], ys.terms[choice[1]], zs.terms[choice[2]]);
  child.parent = index;
  child.depth = static_cast<std::int16_t>(node.depth + 1);
  nodes_.push_back(child);
  return static_cast<std::int32_t>(nodes_.size() - 1);
}

std::int32_t SearchTree::add_child_alike(std::int32_t index) {
  const SearchNode& node = nodes_[static_cast<std::size_t>(index)];
  Axes axes;
  rate(node, &axes);
  Choice choice{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    // An acceleration that jerk alone kept from going further goes on.
    const double now = node.state.acceleration[static_cast<Eigen::Index>(axis)];
    const double step =
        node.parent < 0 ? 0.0 : now - (*this)[node.parent].state.acceleration[static_cast<Eigen::Index>(axis)];
    const double wanted = std::abs(step) > 0.999 * context_.primitives.step_mps2() ? now + step : now;
    const auto change = [wanted](const AxisOption& option) { return std::abs(option.acceleration - wanted); };
    const AxisOptions& options = axes[axis].options;
    const AxisOption *begin = options.option.data(), *end = begin + options.count;
    const AxisOption* least =
        std::min_element(begin, end, [&](const auto& a, const auto& b) { return change(a) < change(b); });
    if (least == end) return -1;
    choice[axis] = static_cast<std::size_t>(least - begin);
  }
  const auto samples = [&](std::size_t axis) -> const AxisSamples& {
    return axes[axis].options.option[choice[axis]].samples;
  };
  SampleWords words;
  look_up(look(node, axes), samples(0), samples(1), samples(2), node.depth, &words);
  return add_child(index, axes, choice, words);
}

void SearchTree::trace_back(std::int32_t index, SearchPath* path) const {
  for (; index >= 0; index = nodes_[static_cast<std::size_t>(index)].parent) {
    const SearchNode& node = nodes_[static_cast<std::size_t>(index)];
    path->knots[static_cast<std::size_t>(node.depth)] = node.state.motion();
  }
}

}  // namespace swarm
