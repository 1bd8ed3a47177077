// The order of the search; see search_primitives.cpp and search_endings.cpp for what it is made of.
#include "planner_daemon/search/kinodynamic_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace swarm {
namespace {

constexpr double kUsable = 0.98;  // of a_max: a little is left for rounding
constexpr int kLeadOn = 5;        // in an emergency: manoeuvres of one phase that a second one follows

// Lengthens a hash chain by one value (splitmix64's finaliser).
std::uint64_t mix(std::uint64_t hash, std::int64_t value) {
  hash ^= static_cast<std::uint64_t>(value) + 0x9e3779b97f4a7c15ULL + (hash << 6) + (hash >> 2);
  hash = (hash ^ (hash >> 30)) * 0xbf58476d1ce4e5b9ULL;
  hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebULL;
  return hash ^ (hash >> 31);
}

// std::llround calls the library.
std::int64_t nearest(double value) {
  return static_cast<std::int64_t>(value + std::copysign(0.5, value));
}

// For the heap: the smallest priority first, among equals the oldest.
constexpr auto kLater = [](const auto& a, const auto& b) {
  return a.priority > b.priority || (a.priority == b.priority && a.node > b.node);
};

}  // namespace

const char* to_string(SearchStatus status) {
  switch (status) {
    case SearchStatus::kGoal:
      return "goal";
    case SearchStatus::kSurvives:
      return "survives";
    case SearchStatus::kPartial:
      return "partial";
  }
  return "?";
}

int KinodynamicSearch::brake_pieces(const SearchLimits& limits, std::int32_t piece_us) {
  return static_cast<int>(std::ceil(limits.v_max / (1e-6 * piece_us * kUsable * limits.a_max))) + 1;
}

KinodynamicSearch::KinodynamicSearch(const SearchLimits& limits, const SearchOptions& options)
    : limits_(limits),
      options_(options),
      tau_(options.piece_us * 1e-6),
      a_lim_(kUsable * limits.a_max),
      brake_pieces_(brake_pieces(limits, options.piece_us)) {
  max_depth_ = options.num_pieces - brake_pieces_;
  if (options.num_pieces > Trajectory::kMaxPieces || max_depth_ < 1) {
    throw std::invalid_argument("horizon: " + std::to_string(options.num_pieces) + " pieces; must be at least " +
                                std::to_string(brake_pieces_ + 1) + " (braking takes " + std::to_string(brake_pieces_) +
                                ") and at most " + std::to_string(Trajectory::kMaxPieces));
  }
  for (std::size_t i = 0; i < kSamples; ++i) {
    const double s = (static_cast<double>(i) + 1.0) / kSamples;
    const double lag = s * s * s / 3 - s * s * s * s / 12;  // double integral of 2 s - s^2
    weights_.v[i] = tau_ * s;
    weights_.a0[i] = tau_ * tau_ * (s * s / 2 - lag);
    weights_.a1[i] = tau_ * tau_ * lag;
  }
  frames_.resize(options.num_pieces);
  goal_steps_.resize(options.num_pieces);
  nodes_.reserve(static_cast<std::size_t>(options.max_expansions) * 32);
  open_.reserve(nodes_.capacity());
  expanded_.reserve(static_cast<std::size_t>(options.max_expansions));
  ways_out_.reserve(static_cast<std::size_t>(options.max_expansions));
  std::size_t slots = 1024;
  while (slots < static_cast<std::size_t>(options.max_expansions) * 4) slots *= 2;
  closed_.resize(slots);
}

double KinodynamicSearch::time_to_goal(double x_s, double y_s, double z_s) {
  const double longest = std::max({x_s, y_s, z_s});
  return longest + 0.05 * (x_s + y_s + z_s - longest);  // the slowest axis decides, the others break ties
}

double KinodynamicSearch::time_to_goal(const Eigen::Vector3d& position) const {
  const double time_s =
      time_to_goal(axis_time(0, position.x(), 0.0), axis_time(1, position.y(), 0.0), axis_time(2, position.z(), 0.0));
  const CostToGo* to_go = problem_.cost_to_go;
  if (to_go == nullptr) return time_s;
  const int end = to_go->num_steps();
  return time_s + to_go->delay_s(end, to_go->cell_of(end, 0, position.x()), to_go->cell_of(end, 1, position.y()),
                                 to_go->cell_of(end, 2, position.z()));
}

bool KinodynamicSearch::seen_before(const State& state, int depth) {
  const bool still_blocked = start_blocked_ && depth * tau_ < options_.leave_s;  // every way out counts
  const bool slow = still_blocked || state.velocity.cwiseAbs().maxCoeff() < options_.slow_mps;
  const double refine = slow ? 3.0 : 1.0;
  std::uint64_t key = mix(slow ? 1 : 0, depth);
  for (int axis = 0; axis < 3; ++axis) {
    key = mix(key, nearest(state.position[axis] / options_.cell_m * refine));
    key = mix(key, nearest(state.velocity[axis] / options_.cell_mps * refine));
  }
  key |= 1;  // 0 marks a free slot
  std::size_t slot = (key >> 1) & (closed_.size() - 1);
  while (closed_[slot] != 0) {
    if (closed_[slot] == key) return true;
    slot = (slot + 1) & (closed_.size() - 1);
  }
  closed_[slot] = key;
  return false;
}

std::int32_t KinodynamicSearch::add_child(std::int32_t index, const AxisOption& x, const AxisOption& y,
                                          const AxisOption& z, const SampleWords& words) {
  if (nodes_.size() == nodes_.capacity()) return -1;  // bounded memory: the best were kept
  const Node& node = nodes_[static_cast<std::size_t>(index)];
  const double zones = zone_cost(words, z.samples, node.depth);
  if (zones < 0.0) return -1;
  const CostToGo* to_go = problem_.cost_to_go;
  const int step = goal_steps_[static_cast<std::size_t>(node.depth)];
  Node child;
  child.state = {{x.position, y.position, z.position},
                 {x.velocity, y.velocity, z.velocity},
                 {x.acceleration, y.acceleration, z.acceleration}};
  child.cost = node.cost + zones + tau_ * (1.0 + x.effort + y.effort + z.effort);
  child.time_to_goal = time_to_goal(x.time_to_goal, y.time_to_goal, z.time_to_goal) +
                       (to_go != nullptr ? to_go->delay_s(step, x.cell, y.cell, z.cell) : 0.0);
  child.parent = index;
  child.depth = static_cast<std::int16_t>(node.depth + 1);
  nodes_.push_back(child);
  return static_cast<std::int32_t>(nodes_.size() - 1);
}

double KinodynamicSearch::total(std::int32_t index) const {
  const Node& node = nodes_[static_cast<std::size_t>(index)];
  return node.cost + options_.heuristic_weight * node.time_to_goal;
}

void KinodynamicSearch::push(std::int32_t index) {
  if (index < 0) return;
  open_.push_back({total(index), index});
  std::push_heap(open_.begin(), open_.end(), kLater);
}

std::int32_t KinodynamicSearch::pop() {
  std::pop_heap(open_.begin(), open_.end(), kLater);
  const std::int32_t index = open_.back().node;
  open_.pop_back();
  return index;
}

template <class Visit>
void KinodynamicSearch::for_each_child(std::int32_t index, const Visit& visit) {
  const Node& node = nodes_[static_cast<std::size_t>(index)];
  const AxisOptions xs = axis_options(0, node), ys = axis_options(1, node), zs = axis_options(2, node);
  prepare(node, xs, ys);
  const int depth = node.depth;  // the node itself may move
  const bool one_word = problem_.blocked->geometry.words_per_column() == 1;
  SampleWords words;
  for (int x = 0; x < xs.count; ++x) {
    for (int y = 0; y < ys.count; ++y) {
      for (int z = 0; z < zs.count; ++z) {
        const AxisOption &along_x = xs.option[x], &along_y = ys.option[y], &along_z = zs.option[z];
        if (z == 0 || !one_word) words = sample_words(along_x.samples, along_y.samples, along_z.samples, depth);
        visit(add_child(index, along_x, along_y, along_z, words));
      }
    }
  }
}

void KinodynamicSearch::trace_back(std::int32_t index, SearchResult* result) const {
  for (; index >= 0; index = nodes_[index].parent) result->knots[nodes_[index].depth] = nodes_[index].state.motion();
}

SearchStatus KinodynamicSearch::find(const SearchProblem& problem, SearchResult* result) {
  problem_ = problem;
  result->expansions = 0;
  result->free_until_utime = kNever;
  result->settled = false;
  const Sogm& blocked = *problem.blocked;
  const GridGeometry& grid = blocked.geometry;
  for (int axis = 0; axis < 3; ++axis) {
    const int words = axis == 0 ? grid.size.y() * grid.words_per_column() : axis == 1 ? grid.words_per_column() : 1;
    axes_[static_cast<std::size_t>(axis)] = {
        1.0 / grid.resolution_m,           grid.origin[axis],       grid.size[axis],        axis == 2 ? 6 : 0, words,
        axis == 2 ? 0 : ~std::uint64_t{0}, limits_.space_min[axis], limits_.space_max[axis]};
  }
  hover_until_utime_ = std::max(problem.start_utime + std::int64_t{options_.num_pieces} * options_.piece_us,
                                blocked.start_utime + blocked.num_frames * blocked.frame_duration_us);
  start_blocked_ = blocked_at(problem.start.position, blocked.frame_at(problem.start_utime));
  result->left_blocked = start_blocked_;
  goal_open_utime_.reset();
  for (int depth = 0; depth < options_.num_pieces; ++depth) {
    for (int i = 0; i < kSamples; ++i) {
      const std::int64_t offset = (depth * kSamples + i + 1) * std::int64_t{options_.piece_us} / kSamples;
      frames_[depth][i] = blocked.frame_at(problem.start_utime + offset) * blocked.geometry.words_per_frame();
    }
    goal_steps_[depth] =
        problem.cost_to_go == nullptr
            ? 0
            : problem.cost_to_go->step_at(problem.start_utime + (depth + 1) * std::int64_t{options_.piece_us});
  }
  nodes_.clear();
  open_.clear();
  expanded_.clear();
  std::fill(closed_.begin(), closed_.end(), 0);

  Node root;
  root.state = {problem.start.position, problem.start.velocity, problem.start.acceleration};
  const auto axis_s = [&](int axis) { return axis_time(axis, root.state.position[axis], root.state.velocity[axis]); };
  root.time_to_goal = time_to_goal(axis_s(0), axis_s(1), axis_s(2));
  nodes_.push_back(root);
  if (problem.emergency) return escape(result);
  push(0);
  while (!open_.empty() && result->expansions < options_.max_expansions) {
    const std::int32_t index = pop();
    const Node& node = nodes_[static_cast<std::size_t>(index)];
    if (seen_before(node.state, node.depth)) continue;
    expanded_.push_back(index);
    ++result->expansions;
    // None before blocked space is left.
    if (!leaving(node.depth, 0) && node.time_to_goal <= (options_.num_pieces - node.depth) * tau_ &&
        shoot(node, result)) {
      trace_back(index, result);
      return SearchStatus::kGoal;
    }
    double harm = 0.0;
    if (node.depth < max_depth_) {
      for_each_child(index, [this](std::int32_t child) { push(child); });
    } else if (brake(node, result, &harm) == kNever) {
      trace_back(index, result);
      return SearchStatus::kSurvives;
    }
  }
  return settle(result);
}

void KinodynamicSearch::hold(std::int32_t index) {
  while (index >= 0 && nodes_[static_cast<std::size_t>(index)].depth < max_depth_) {
    const Node& node = nodes_[static_cast<std::size_t>(index)];
    const std::array<AxisOptions, 3> options{axis_options(0, node), axis_options(1, node), axis_options(2, node)};
    std::array<const AxisOption*, 3> same;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto off = [&](const AxisOption& option) {
        return std::abs(option.acceleration - node.state.acceleration[static_cast<int>(axis)]);
      };
      const AxisOption *begin = options[axis].option.data(), *end = begin + options[axis].count;
      same[axis] = std::min_element(begin, end, [&](const auto& a, const auto& b) { return off(a) < off(b); });
      if (same[axis] == end) return;
    }
    prepare(node, options[0], options[1]);
    index = add_child(index, *same[0], *same[1], *same[2],
                      sample_words(same[0]->samples, same[1]->samples, same[2]->samples, node.depth));
  }
}

// Manoeuvres of two phases: in each of them an acceleration is held for some primitives, then the robot brakes. All of
// one phase; from those that do least harm, counted to the end of the map, all of another.
SearchStatus KinodynamicSearch::escape(SearchResult* result) {
  OpenEntry best{std::numeric_limits<double>::infinity(), 0};
  double harm = 0.0;
  ways_out_.assign(1, {0.0, 0});
  for (int phase = 0; phase < 2; ++phase) {
    const std::size_t first = phase == 0 ? 0 : nodes_.size();
    const int width = phase == 0 ? 1 : kLeadOn;
    std::sort(ways_out_.begin(), ways_out_.end(), [](const OpenEntry& a, const OpenEntry& b) { return kLater(b, a); });
    for (int i = 0; i < std::min(width, static_cast<int>(ways_out_.size())); ++i) {
      if (nodes_[static_cast<std::size_t>(ways_out_[i].node)].depth == max_depth_) continue;
      for_each_child(ways_out_[i].node, [this](std::int32_t child) { hold(child); });
    }
    ways_out_.clear();
    for (std::size_t i = first; i < nodes_.size() && result->expansions < options_.max_expansions; ++i) {
      const auto index = static_cast<std::int32_t>(i);
      (void)brake(nodes_[i], result, &harm);
      ++result->expansions;
      ways_out_.push_back({total(index) + harm, index});
      if (kLater(best, ways_out_.back())) best = ways_out_.back();
    }
  }
  (void)brake(nodes_[static_cast<std::size_t>(best.node)], result, &harm);
  trace_back(best.node, result);
  return SearchStatus::kSurvives;
}

SearchStatus KinodynamicSearch::settle(SearchResult* result) {
  result->settled = true;
  const auto cost = [this](std::int32_t index) {  // but for the time it takes to get there
    return total(index) - nodes_[static_cast<std::size_t>(index)].depth * tau_;
  };
  std::sort(expanded_.begin(), expanded_.end(),
            [&](std::int32_t a, std::int32_t b) { return cost(a) < cost(b) || (cost(a) == cost(b) && a < b); });
  double harm = 0.0;
  std::int32_t longest = 0;
  std::int64_t longest_until = -1;
  for (const std::int32_t index : expanded_) {
    const std::int64_t until = brake(nodes_[static_cast<std::size_t>(index)], result, &harm);
    if (until > longest_until) longest_until = until, longest = index;
    if (until == kNever) break;
  }
  result->free_until_utime = brake(nodes_[static_cast<std::size_t>(longest)], result, &harm);
  trace_back(longest, result);
  return longest_until == kNever ? SearchStatus::kSurvives : SearchStatus::kPartial;
}

}  // namespace swarm
