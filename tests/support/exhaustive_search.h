// The oracle of the kinodynamic search: all chains of primitives, one by one.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/search_scene.h"

namespace swarm {

// Written from the header's words: per axis the strongest acceleration either way that leaves the speed limit within
// reach, the one that stops, none, and, where steps are fine, gentle ones at low speed; nearly equal ones once.
class ExhaustiveSearch {
 public:
  ExhaustiveSearch(const Scene& scene, const SearchProblem& problem, const SearchLimits& limits,
                   const SearchOptions& options)
      : scene_(scene),
        problem_(problem),
        limits_(limits),
        options_(options),
        space_(space_of(scene, limits)),
        primitives_(limits, options),
        tau_(to_seconds(options.piece)) {
    start_blocked_ = occupied_at(scene.blocked, problem.start.position, problem.start_utime);
    brake_pieces_ = static_cast<int>(std::ceil(limits.v_max_mps / (tau_ * a_lim()))) + 1;
    walk(problem.start, 0, 0.0, false);
  }
  double least_total = INFINITY;     // cost + weight * time to the goal, of the ends that come to rest freely
  Utime longest_until{};             // of all nodes, braking from there
  bool can_avoid_collision = false;  // some end comes to rest freely and nowhere collided
  int nodes = 0;

  // Cost of the knots' first pieces and the remaining time to the goal: what the search minimises.
  double total(const SearchResult& result) const {
    double cost = 0.0;
    const int depth = options_.num_pieces - brake_pieces_;
    for (int k = 0; k < depth; ++k)
      cost += piece_cost(result.knots[static_cast<std::size_t>(k)], result.knots[static_cast<std::size_t>(k) + 1], k);
    return cost + options_.heuristic_weight * time_to_goal(result.knots[static_cast<std::size_t>(depth)]);
  }

 private:
  double a_lim() const { return 0.98 * limits_.a_max_mps2; }

  double time_to_goal(const MotionState& state) const {
    double longest = 0.0, sum = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double t = min_time_to_rest(problem_.goal[axis] - state.position[axis], state.velocity[axis],
                                        limits_.v_max_mps, a_lim());
      longest = std::max(longest, t);
      sum += t;
    }
    return longest + 0.1 * (sum - longest);
  }

  // The first sample that leaves the space, or lies outside and farther than the one before; kSamples + 1: none.
  int first_stray(int axis, double p, double v, double a, double a1) const {
    double before = p;
    for (int i = 1; i <= kSamples; ++i) {
      const double s = static_cast<double>(i) / kSamples, lag = s * s * s / 3 - s * s * s * s / 12;
      const double now = p + tau_ * s * v + tau_ * tau_ * (s * s / 2 * a + lag * (a1 - a));
      if ((now < space_.min()[axis] && now < before) || (now > space_.max()[axis] && now > before)) return i;
      before = now;
    }
    return kSamples + 1;
  }

  std::vector<double> axis_choices(int axis, const MotionState& from) const {
    const double p = from.position[axis], v = from.velocity[axis], a = from.acceleration[axis];
    // After a1 and one more primitive to a = 0 the speed is v + tau/3 a + tau a1.
    const double drift = v + tau_ / 3 * a;
    const double most = std::min(a_lim(), std::max(-a_lim(), (limits_.v_max_mps - drift) / tau_));
    const double least = std::max(-a_lim(), std::min(a_lim(), (-limits_.v_max_mps - drift) / tau_));
    std::vector<double> wishes = {a_lim(), -a_lim(), std::clamp(-drift / tau_, least, most), 0.0};
    if (problem_.fine && std::abs(v) < options_.slow_mps / 2) wishes.insert(wishes.end(), {a_lim() / 4, -a_lim() / 4});
    std::vector<double> choices;
    for (double wish : wishes) {
      const double a1 = std::clamp(wish, least, most);
      const auto near_a1 = [&](double choice) { return std::abs(choice - a1) <= 0.05 * a_lim(); };
      if (std::none_of(choices.begin(), choices.end(), near_a1) && first_stray(axis, p, v, a, a1) > kSamples)
        choices.push_back(a1);
    }
    return choices;
  }

  // INFINITY when blocked.
  double piece_cost(const MotionState& from, const MotionState& to, int depth) const {
    const ControlPoints points = quintic_control_points(from, to, tau_);
    double cost = tau_ * (1.0 + options_.effort_weight * (to.acceleration / limits_.a_max_mps2).squaredNorm());
    for (int i = 1; i <= kSamples; ++i) {
      const Eigen::Vector3d p = evaluate_bezier(points, tau_, static_cast<double>(i) / kSamples).position;
      const Duration since = (depth * kSamples + i) * options_.piece / kSamples;
      const Utime utime = problem_.start_utime + since;
      double weight = 0.0;
      if (occupied_at(scene_.inflation, p, utime)) {
        weight += options_.inflation_weight;
        if (occupied_at(scene_.recently_occupied, p, utime)) weight += options_.recently_occupied_weight;
      }
      if (occupied_at(scene_.blocked, p, utime)) {
        if (!start_blocked_ || since > to_duration(options_.leave_s)) return INFINITY;
        weight += options_.leave_weight;
        if (occupied_at(scene_.emergency, p, utime)) weight += 9 * options_.leave_weight;
        if (occupied_at(scene_.collision, p, utime)) weight += 90 * options_.leave_weight;
      }
      cost += weight * tau_ / kSamples;
    }
    return cost;
  }

  // Brakes evenly, then hovers to the horizon: when it first is blocked or strays.
  Utime brake(const MotionState& node, int depth) const {
    SearchResult path;
    path.knots[0] = node;
    path.num_pieces = brake_pieces_;
    const Eigen::Vector3d drift = node.velocity + tau_ / 3 * node.acceleration;
    int strays_at = std::numeric_limits<int>::max();  // sample
    for (int k = 1; k <= brake_pieces_; ++k) {
      const Eigen::Vector3d a1 =
          k < brake_pieces_ ? (-drift / (tau_ * (brake_pieces_ - 1))).eval() : Eigen::Vector3d::Zero().eval();
      const MotionState& from = path.knots[static_cast<std::size_t>(k) - 1];
      for (int axis = 0; axis < 3; ++axis) {
        const int i = first_stray(axis, from.position[axis], from.velocity[axis], from.acceleration[axis], a1[axis]);
        if (i <= kSamples) strays_at = std::min(strays_at, (k - 1) * kSamples + i);
      }
      path.knots[static_cast<std::size_t>(k)] = primitives_.propagate(from, a1);
    }
    for (int i = 1; i <= (options_.num_pieces - depth) * kSamples; ++i) {
      const Duration since = (depth * kSamples + i) * options_.piece / kSamples;
      if (i == strays_at) return problem_.start_utime + since;
      if (start_blocked_ && since <= to_duration(options_.leave_s)) continue;
      if (occupied_at(scene_.blocked, state_at(path, tau_, i * tau_ / kSamples).position,
                      problem_.start_utime + since)) {
        return problem_.start_utime + since;
      }
    }
    return kNever;
  }

  bool touches(const MotionState& from, const MotionState& to, int depth) const {
    const ControlPoints points = quintic_control_points(from, to, tau_);
    for (int i = 1; i <= kSamples; ++i) {
      const Duration since = (depth * kSamples + i) * options_.piece / kSamples;
      const Eigen::Vector3d p = evaluate_bezier(points, tau_, static_cast<double>(i) / kSamples).position;
      if (occupied_at(scene_.collision, p, problem_.start_utime + since)) return true;
    }
    return false;
  }

  void walk(const MotionState& node, int depth, double cost, bool touched) {
    ++nodes;
    const Utime until = brake(node, depth);
    longest_until = std::max(longest_until, until);
    if (depth == options_.num_pieces - brake_pieces_) {
      if (until == kNever) {
        least_total = std::min(least_total, cost + options_.heuristic_weight * time_to_goal(node));
        can_avoid_collision = can_avoid_collision || !touched;
      }
      return;
    }
    std::array<std::vector<double>, 3> choices;
    for (int axis = 0; axis < 3; ++axis) choices[static_cast<std::size_t>(axis)] = axis_choices(axis, node);
    for (double x : choices[0]) {
      for (double y : choices[1]) {
        for (double z : choices[2]) {
          const MotionState next = primitives_.propagate(node, {x, y, z});
          const double added = piece_cost(node, next, depth);
          if (added < INFINITY) walk(next, depth + 1, cost + added, touched || touches(node, next, depth));
        }
      }
    }
  }

  const Scene& scene_;
  const SearchProblem& problem_;
  SearchLimits limits_;
  SearchOptions options_;
  Eigen::AlignedBox3d space_;
  Primitives primitives_;
  double tau_;
  int brake_pieces_;
  bool start_blocked_;
};

}  // namespace swarm
