// Long because choice, cost, order and end of the primitives read the same tables of one search; see the header.
#include "planner_daemon/kinodynamic_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace swarm {
namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

constexpr double kUsable = 0.98;  // of a_max: a little is left for rounding
// What lies ahead counts less and less, for it can still be replanned: down to a least share after this long.
constexpr double kFade_s = 1.0, kLeastFade = 0.05;
constexpr std::int64_t kHarmStep_us = 10'000;
constexpr int kLeadOn = 5;          // in an emergency: manoeuvres of one phase that a second one follows
constexpr double kStrayHarm = 1e6;  // of leaving the flight space: worse than any touch

// Lengthens a hash chain by one value (splitmix64's finaliser).
std::uint64_t mix(std::uint64_t hash, std::int64_t value) {
  hash ^= static_cast<std::uint64_t>(value) + 0x9e3779b97f4a7c15ULL + (hash << 6) + (hash >> 2);
  hash = (hash ^ (hash >> 30)) * 0xbf58476d1ce4e5b9ULL;
  hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebULL;
  return hash ^ (hash >> 31);
}

// For the heap: the smallest priority first, among equals the oldest.
constexpr auto kLater = [](const auto& a, const auto& b) {
  return a.priority > b.priority || (a.priority == b.priority && a.node > b.node);
};

template <class State>
MotionState to_motion(const State& state) {
  return {state.position, state.velocity, state.acceleration, Eigen::Vector3d::Zero()};
}

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

double min_time_to_rest(double d, double v, double v_max, double a_max) {
  v = std::clamp(v, -v_max, v_max);
  // Mirror so that the motion first accelerates in the positive direction.
  if (d < v * std::abs(v) / (2 * a_max)) d = -d, v = -v;
  const double peak = std::sqrt(std::max(0.0, a_max * d + v * v / 2));
  if (peak <= v_max) return (peak - v + peak) / a_max;
  const double cruise = d - (2 * v_max * v_max - v * v) / (2 * a_max);
  return (2 * v_max - v) / a_max + cruise / v_max;
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
  for (int i = 0; i < kSamples; ++i) {
    const double s = (i + 1.0) / kSamples;
    const double lag = s * s * s / 3 - s * s * s * s / 12;  // double integral of 2 s - s^2
    weights_[i] = {tau_ * s, tau_ * tau_ * (s * s / 2 - lag), tau_ * tau_ * lag};
  }
  frames_.resize(options.num_pieces);
  goal_frames_.resize(options.num_pieces);
  nodes_.reserve(static_cast<std::size_t>(options.max_expansions) * 32);
  open_.reserve(nodes_.capacity());
  expanded_.reserve(static_cast<std::size_t>(options.max_expansions));
  ways_out_.reserve(static_cast<std::size_t>(options.max_expansions));
  std::size_t slots = 1024;
  while (slots < static_cast<std::size_t>(options.max_expansions) * 4) slots *= 2;
  closed_.resize(slots);
}

KinodynamicSearch::AxisOption KinodynamicSearch::make_option(int axis, double p, double v, double a, double a1,
                                                             int frame) const {
  AxisOption option;
  const GridGeometry& grid = problem_.blocked->geometry;
  const double inverse = 1.0 / grid.resolution_m;
  const double low = limits_.space_min[axis], high = limits_.space_max[axis];
  const int words = grid.words_per_column();
  const int stride = axis == 0 ? grid.size.y() * words : words;
  option.inside = true;
  double before = p;
  for (std::size_t i = 0; i < kSamples; ++i) {
    const double position = p + weights_[i].v * v + weights_[i].a0 * a + weights_[i].a1 * a1;
    const int voxel = static_cast<int>(std::floor(position * inverse)) - grid.origin[axis];
    const bool known = voxel >= 0 && voxel < grid.size[axis];
    if (axis < 2) {
      option.offset[i] = known ? voxel * stride : 0;
      option.in_window[i] = known ? ~std::uint64_t{0} : 0;
    } else {
      option.offset[i] = known ? voxel >> 6 : 0;
      option.in_window[i] = known ? std::uint64_t{1} << (voxel & 63) : 0;
    }
    // A robot outside the flight space may only come back.
    if ((position < low && position < before) || (position > high && position > before)) option.inside = false;
    before = position;
  }
  option.position = before;
  option.velocity = v + tau_ / 3 * (a + 2 * a1);
  option.acceleration = a1;
  option.time_to_goal = axis_time(axis, option.position, option.velocity);
  option.effort = options_.effort_weight * a1 * a1;
  option.cell = problem_.cost_to_go != nullptr ? problem_.cost_to_go->cell_of(frame, axis, option.position) : -1;
  return option;
}

KinodynamicSearch::AxisOptions KinodynamicSearch::axis_options(int axis, const Node& node) const {
  const double p = node.state.position[axis], v = node.state.velocity[axis], a = node.state.acceleration[axis];
  const int frame = goal_frames_[static_cast<std::size_t>(node.depth)];
  // The largest and smallest a1 after which the next primitive can still keep the speed limit: v1 + tau/3 a1 <= v_max.
  const double drift = v + tau_ / 3 * a;
  const double high = std::clamp((limits_.v_max - drift) / tau_, -a_lim_, a_lim_);
  const double low = std::clamp((-limits_.v_max - drift) / tau_, -a_lim_, a_lim_);
  const double rest = std::clamp(-drift / tau_, low, high);  // at rest one primitive later, or as near as may be
  const double gentle = problem_.fine && std::abs(v) < 0.5 * options_.slow_mps ? 0.25 * a_lim_ : 0.0;
  AxisOptions options;
  for (double wanted : {a_lim_, -a_lim_, rest, 0.0, gentle, -gentle}) {
    const double a1 = std::clamp(wanted, low, high);
    bool is_new = true;
    for (int i = 0; i < options.count; ++i) {
      is_new = is_new && std::abs(options.option[i].acceleration - a1) > 0.05 * a_lim_;
    }
    if (!is_new) continue;
    options.option[options.count] = make_option(axis, p, v, a, a1, frame);
    if (options.option[options.count].inside) ++options.count;
  }
  return options;
}

MotionState KinodynamicSearch::propagate(const MotionState& from, const Eigen::Vector3d& a1) const {
  const SampleWeights& end = weights_.back();
  MotionState to;
  to.position = from.position + end.v * from.velocity + end.a0 * from.acceleration + end.a1 * a1;
  to.velocity = from.velocity + tau_ / 3 * (from.acceleration + 2 * a1);
  to.acceleration = a1;
  return to;
}

bool KinodynamicSearch::leaving(int depth, int sample) const {
  return problem_.emergency || (start_blocked_ && (depth + (sample + 1.0) / kSamples) * tau_ <= options_.leave_s);
}

double KinodynamicSearch::zone_cost(const AxisOption& x, const AxisOption& y, const AxisOption& z, int depth) const {
  const auto& frames = frames_[static_cast<std::size_t>(depth)];
  std::array<std::int32_t, kSamples> words;
  std::array<std::uint64_t, kSamples> bits;
  std::uint64_t any = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    words[i] = frames[i] + x.offset[i] + y.offset[i] + z.offset[i];
    bits[i] = x.in_window[i] & y.in_window[i] & z.in_window[i];
    any |= problem_.near->words[static_cast<std::size_t>(words[i])] & bits[i];
  }
  if (any == 0) return 0.0;  // the near zone holds the blocked one
  double cost = 0.0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    const auto in = [&](const Sogm* zone) { return (zone->words[static_cast<std::size_t>(words[i])] & bits[i]) != 0; };
    if (!in(problem_.near)) continue;
    cost += options_.near_weight;
    if (problem_.wake != nullptr && in(problem_.wake)) cost += options_.wake_weight;
    if (!in(problem_.blocked)) continue;
    if (!leaving(depth, static_cast<int>(i))) return -1.0;
    cost += blocked_weight((depth + (static_cast<double>(i) + 1.0) / kSamples) * tau_, in(problem_.tight),
                           in(problem_.contact));
  }
  return cost * tau_ / kSamples;
}

double KinodynamicSearch::blocked_weight(double ahead_s, bool tight, bool contact) const {
  const double fade = std::max(kLeastFade, 1.0 - ahead_s / kFade_s);
  return options_.leave_weight * fade * (contact ? 100.0 : tight ? 10.0 : 1.0);
}

bool KinodynamicSearch::strays(const Eigen::Vector3d& before, const Eigen::Vector3d& position) const {
  return ((position.array() < limits_.space_min.array() && position.array() < before.array()) ||
          (position.array() > limits_.space_max.array() && position.array() > before.array()))
      .any();
}

bool KinodynamicSearch::free_at(const Eigen::Vector3d& position, std::int64_t utime) const {
  if (problem_.emergency ||
      (start_blocked_ && utime - problem_.start_utime <= static_cast<std::int64_t>(options_.leave_s * 1e6)))
    return true;
  const Sogm& blocked = *problem_.blocked;
  return !blocked.occupied(blocked.frame_at(utime), blocked.geometry.voxel_of(position));
}

double KinodynamicSearch::axis_time(int axis, double position, double velocity) const {
  return min_time_to_rest(problem_.goal[axis] - position, velocity, limits_.v_max, a_lim_);
}

double KinodynamicSearch::time_to_goal(double x_s, double y_s, double z_s) {
  const double longest = std::max({x_s, y_s, z_s});
  return longest + 0.05 * (x_s + y_s + z_s - longest);  // the slowest axis decides, the others break ties
}

double KinodynamicSearch::delay_s(int frame, const Eigen::Vector3d& position) const {
  const CostToGo* to_go = problem_.cost_to_go;
  if (to_go == nullptr) return 0.0;
  return to_go->delay_s(frame, to_go->cell_of(frame, 0, position.x()), to_go->cell_of(frame, 1, position.y()),
                        to_go->cell_of(frame, 2, position.z()));
}

double KinodynamicSearch::time_to_goal(const Eigen::Vector3d& position) const {
  return time_to_goal(axis_time(0, position.x(), 0.0), axis_time(1, position.y(), 0.0),
                      axis_time(2, position.z(), 0.0)) +
         delay_s(problem_.blocked->num_frames, position);
}

bool KinodynamicSearch::seen_before(const State& state, int depth) {
  const bool still_blocked = start_blocked_ && depth * tau_ < options_.leave_s;  // every way out counts
  const bool slow = still_blocked || state.velocity.cwiseAbs().maxCoeff() < options_.slow_mps;
  const double refine = slow ? 3.0 : 1.0;
  std::uint64_t key = mix(slow ? 1 : 0, depth);
  for (int axis = 0; axis < 3; ++axis) {
    key = mix(key, std::llround(state.position[axis] / options_.cell_m * refine));
    key = mix(key, std::llround(state.velocity[axis] / options_.cell_mps * refine));
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
                                          const AxisOption& z) {
  if (nodes_.size() == nodes_.capacity()) return -1;  // bounded memory: the best were kept
  const Node& node = nodes_[static_cast<std::size_t>(index)];
  const double zones = zone_cost(x, y, z, node.depth);
  if (zones < 0.0) return -1;
  const CostToGo* to_go = problem_.cost_to_go;
  const int frame = goal_frames_[static_cast<std::size_t>(node.depth)];
  Node child;
  child.state = {{x.position, y.position, z.position},
                 {x.velocity, y.velocity, z.velocity},
                 {x.acceleration, y.acceleration, z.acceleration}};
  child.cost = node.cost + zones + tau_ * (1.0 + x.effort + y.effort + z.effort);
  child.time_to_goal = time_to_goal(x.time_to_goal, y.time_to_goal, z.time_to_goal) +
                       (to_go != nullptr ? to_go->delay_s(frame, x.cell, y.cell, z.cell) : 0.0);
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
  for (int x = 0; x < xs.count; ++x) {
    for (int y = 0; y < ys.count; ++y) {
      for (int z = 0; z < zs.count; ++z) visit(add_child(index, xs.option[x], ys.option[y], zs.option[z]));
    }
  }
}

void KinodynamicSearch::trace_back(std::int32_t index, SearchResult* result) const {
  for (; index >= 0; index = nodes_[index].parent) result->knots[nodes_[index].depth] = to_motion(nodes_[index].state);
}

double KinodynamicSearch::harm_at(const Eigen::Vector3d& position, std::int64_t utime) const {
  const Sogm& blocked = *problem_.blocked;
  const Eigen::Vector3i voxel = blocked.geometry.voxel_of(position);
  const int frame = blocked.frame_at(utime);
  if (!blocked.occupied(frame, voxel)) return 0.0;
  return blocked_weight(1e-6 * static_cast<double>(utime - problem_.start_utime),
                        problem_.tight->occupied(frame, voxel), problem_.contact->occupied(frame, voxel));
}

double KinodynamicSearch::harm(const Motion& motion) const {
  double harm = 0.0;
  for (std::int64_t t = problem_.start_utime; t < hover_until_utime_; t += kHarmStep_us)
    harm += harm_at(motion.at(t).position, t);
  return harm * 1e-6 * kHarmStep_us;
}

std::int64_t KinodynamicSearch::brake(const Node& node, SearchResult* result, double* harm) const {
  const Eigen::Vector3d drift = node.state.velocity + tau_ / 3 * node.state.acceleration;
  const Eigen::Vector3d a1 = -drift / (tau_ * (brake_pieces_ - 1));
  std::int64_t first_blocked = kNever;
  *harm = 0.0;
  const auto look = [&](const Eigen::Vector3d& position, std::int64_t utime, double duration_s) {
    if (problem_.emergency) *harm += harm_at(position, utime) * duration_s;
    if (!free_at(position, utime)) first_blocked = utime;
  };
  MotionState state = to_motion(node.state);
  Eigen::Vector3d before = state.position;
  for (int k = 0; k < brake_pieces_; ++k) {
    const bool last = k == brake_pieces_ - 1;
    const Eigen::Vector3d a = last ? Eigen::Vector3d::Zero().eval() : a1;
    const std::int64_t begin = problem_.start_utime + (node.depth + k) * std::int64_t{options_.piece_us};
    for (int i = 0; i < kSamples && first_blocked == kNever; ++i) {
      const std::int64_t utime = begin + (i + 1) * std::int64_t{options_.piece_us} / kSamples;
      const Eigen::Vector3d position =
          state.position + weights_[i].v * state.velocity + weights_[i].a0 * state.acceleration + weights_[i].a1 * a;
      look(position, utime, tau_ / kSamples);
      if (first_blocked == kNever && strays(before, position)) {
        first_blocked = utime;
        *harm += kStrayHarm;
      }
      before = position;
    }
    state = propagate(state, a);
    if (last) state.velocity.setZero(), state.acceleration.setZero();
    result->knots[static_cast<std::size_t>(node.depth + k + 1)] = state;
  }
  result->num_pieces = node.depth + brake_pieces_;
  // At rest, one look per frame is enough.
  const Sogm& map = *problem_.blocked;
  std::int64_t utime = problem_.start_utime + result->num_pieces * std::int64_t{options_.piece_us};
  while (first_blocked == kNever && utime < hover_until_utime_) {
    const std::int64_t into_frame = std::max<std::int64_t>(0, utime - map.start_utime) % map.frame_duration_us;
    const std::int64_t next = std::min(hover_until_utime_, utime + map.frame_duration_us - into_frame);
    look(state.position, utime, 1e-6 * static_cast<double>(next - utime));
    utime = next;
  }
  return first_blocked;
}

bool KinodynamicSearch::shoot(const Node& node, SearchResult* result) const {
  const Sogm& avoided = problem_.wake != nullptr ? *problem_.wake : *problem_.blocked;
  const MotionState start = to_motion(node.state);
  MotionState goal;
  goal.position = problem_.goal;
  const double least_s = node.time_to_goal;
  const int room = options_.num_pieces - node.depth;
  const int first = std::max(1, static_cast<int>(std::ceil(least_s / tau_ - 1e-9)));
  for (int pieces = first; pieces <= std::min(room, first + 3); ++pieces) {
    const double duration = pieces * tau_;
    const ControlPoints whole = quintic_control_points(start, goal, duration);
    bool ok = true;
    for (int k = 1; k <= pieces && ok; ++k) {
      MotionState& knot = result->knots[node.depth + k];
      knot = k == pieces ? goal : evaluate_bezier(whole, duration, static_cast<double>(k) / pieces);
      const MotionState& before = k == 1 ? start : result->knots[node.depth + k - 1];
      const ControlPoints points = quintic_control_points(before, knot, tau_);
      ok = max_speed_bound(points, tau_) <= limits_.v_max + 1e-9 &&
           max_acceleration_bound(points, tau_) <= limits_.a_max + 1e-9;
    }
    if (!ok) continue;
    // Free on the way, and at the goal until the horizon; inside the flight space.
    const std::int64_t begin = problem_.start_utime + node.depth * std::int64_t{options_.piece_us};
    const int samples = room * kSamples;
    for (int i = 1; i <= samples && ok; ++i) {
      const double s = std::min(1.0, static_cast<double>(i) / (pieces * kSamples));
      const Eigen::Vector3d position = evaluate_bezier(whole, duration, s).position;
      const std::int64_t utime = begin + i * std::int64_t{options_.piece_us} / kSamples;
      ok = !avoided.occupied(avoided.frame_at(utime), avoided.geometry.voxel_of(position)) &&
           (position.array() >= limits_.space_min.array() - 1e-6).all() &&
           (position.array() <= limits_.space_max.array() + 1e-6).all();
    }
    if (!ok) continue;
    result->num_pieces = node.depth + pieces;
    return true;
  }
  return false;
}

SearchStatus KinodynamicSearch::find(const SearchProblem& problem, SearchResult* result) {
  problem_ = problem;
  result->expansions = 0;
  result->free_until_utime = kNever;
  result->settled = false;
  const Sogm& blocked = *problem.blocked;
  hover_until_utime_ = std::max(problem.start_utime + std::int64_t{options_.num_pieces} * options_.piece_us,
                                blocked.start_utime + blocked.num_frames * blocked.frame_duration_us);
  start_blocked_ =
      blocked.occupied(blocked.frame_at(problem.start_utime), blocked.geometry.voxel_of(problem.start.position));
  result->left_blocked = start_blocked_;
  for (int depth = 0; depth < options_.num_pieces; ++depth) {
    for (int i = 0; i < kSamples; ++i) {
      const std::int64_t offset = (depth * kSamples + i + 1) * std::int64_t{options_.piece_us} / kSamples;
      frames_[depth][i] = blocked.frame_at(problem.start_utime + offset) * blocked.geometry.words_per_frame();
    }
    goal_frames_[depth] =
        problem.cost_to_go == nullptr
            ? 0
            : problem.cost_to_go->frame_at(problem.start_utime + (depth + 1) * std::int64_t{options_.piece_us});
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
  push(0);
  if (problem.emergency) return escape(result);
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
    std::array<AxisOption, 3> same;
    for (int axis = 0; axis < 3; ++axis) {
      const AxisOptions options = axis_options(axis, node);
      const auto off = [&](const AxisOption& option) {
        return std::abs(option.acceleration - node.state.acceleration[axis]);
      };
      const auto* end = options.option.data() + options.count;
      const auto* nearest =
          std::min_element(options.option.data(), end, [&](const auto& a, const auto& b) { return off(a) < off(b); });
      if (nearest == end) return;
      same[static_cast<std::size_t>(axis)] = *nearest;
    }
    index = add_child(index, same[0], same[1], same[2]);
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
