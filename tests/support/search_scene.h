// Scenes for the search's tests: the zones around a map, starts, and what its results mean.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string>

#include "map_daemon/dilation.h"
#include "planner_daemon/search/kinodynamic_search.h"
#include "tests/support/random_map.h"
#include "tests/support/random_motion.h"

namespace swarm {

inline constexpr std::int64_t kStart = 1'700'000'000'000'000;
inline constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
inline constexpr double kBlocked_m = 0.3, kNear_m = 0.45, kTight_m = 0.23, kContact_m = 0.16;
inline constexpr int kSamples = 8;  // collision checks per primitive

// The zones that a search looks at.
struct Scene {
  explicit Scene(const Sogm& map) : occupied(map) {
    dilate(occupied, kBlocked_m, &blocked);
    dilate(occupied, kNear_m, &near);
    dilate(occupied, kTight_m, &tight);
    dilate(occupied, kContact_m, &contact);
  }
  SearchProblem problem(const MotionState& start, std::int64_t start_utime, const Eigen::Vector3d& goal) const {
    SearchProblem p;
    p.start = start;
    p.start_utime = start_utime;
    p.goal = goal;
    p.blocked = &blocked;
    p.near = &near;
    p.tight = &tight;
    p.contact = &contact;
    return p;
  }
  Sogm occupied, blocked, near, tight, contact;
};

inline bool occupied_at(const Sogm& sogm, const Eigen::Vector3d& position, std::int64_t utime) {
  return sogm.occupied(sogm.frame_at(utime), sogm.geometry.voxel_of(position));
}

// A state from which the limits can be kept: what the search itself leads through.
inline MotionState viable_state(Rng& rng, const SearchLimits& limits, double tau, const Eigen::Vector3d& half) {
  MotionState state;
  state.position = in_box(rng, -half, half);
  for (int axis = 0; axis < 3; ++axis) {
    double &v = state.velocity[axis], &a = state.acceleration[axis];
    do {
      v = uniform(rng, -limits.v_max, limits.v_max);
      a = uniform(rng, -0.98 * limits.a_max, 0.98 * limits.a_max);
    } while (std::abs(v + tau / 3 * a) > limits.v_max);
  }
  return state;
}

inline MotionState at_rest(const Eigen::Vector3d& position) {
  MotionState state;
  state.position = position;
  return state;
}

inline MotionState state_at(const SearchResult& result, double tau, double t) {
  const int piece = std::min(static_cast<int>(t / tau), result.num_pieces);
  if (piece == result.num_pieces) return at_rest(result.knots[static_cast<std::size_t>(piece)].position);
  const ControlPoints points = quintic_control_points(result.knots[static_cast<std::size_t>(piece)],
                                                      result.knots[static_cast<std::size_t>(piece) + 1], tau);
  return evaluate_bezier(points, tau, t / tau - piece);
}

inline std::string describe(const SearchProblem& problem, const SearchResult& result, SearchStatus status) {
  std::ostringstream out;
  out.precision(17);
  out << to_string(status) << ", start " << problem.start << " at " << problem.start_utime - kStart << " us, goal "
      << problem.goal.transpose() << ", " << result.expansions << " expansions";
  for (int k = 0; k <= result.num_pieces; ++k) out << "\n  " << result.knots[static_cast<std::size_t>(k)];
  return out.str();
}

}  // namespace swarm
