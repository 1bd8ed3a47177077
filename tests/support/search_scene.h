// Scenes for the search's tests: the configuration space around a map, starts, and what its results mean.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "map_daemon/dilation.h"
#include "planner_daemon/search/escape.h"
#include "planner_daemon/search/kinodynamic_search.h"
#include "tests/support/random_map.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {

inline constexpr double kBlocked_m = 0.3, kInflation_m = 0.15, kEmergency_m = 0.23, kCollision_m = 0.16;
inline constexpr int kSamples = kBlockSamples;  // of a primitive, at the speeds and resolutions of these tests

// A map, the configuration space around it that a search looks at, and what its layers must be by their definition.
struct Scene {
  explicit Scene(const Sogm& map, double recently_occupied_s = 0.0)
      : occupied(map),
        space({.radius_m = 0.2,
               .clearance_m = kBlocked_m - 0.2,
               .emergency_clearance_m = kEmergency_m - 0.2,
               .collision_depth_m = 0.2 - kCollision_m,
               .inflation_m = kInflation_m,
               .recently_occupied_s = recently_occupied_s}) {
    Sogm recently = occupied;
    const auto frames_back = static_cast<int>(std::lround(recently_occupied_s / to_seconds(map.frame_duration)));
    for (int frame = 0; frame < map.num_frames; ++frame) {
      for (int before = std::max(0, frame - frames_back); before < frame; ++before) {
        for (int i = 0; i < map.geometry.words_per_frame(); ++i)
          recently.column(frame, 0, 0)[i] |= map.column(before, 0, 0)[i];
      }
    }
    dilate(occupied, kBlocked_m, &blocked);
    dilate(recently, kBlocked_m, &recently_occupied);
    dilate(recently_occupied, kInflation_m, &inflation);
    dilate(occupied, kEmergency_m, &emergency);
    dilate(occupied, kCollision_m, &collision);
    space.compose(occupied, {}, {});
  }
  SearchProblem problem(const MotionState& start, Utime start_utime, const Eigen::Vector3d& goal) const {
    SearchProblem problem;
    problem.start = start;
    problem.start_utime = start_utime;
    problem.goal = goal;
    problem.space = &space;
    return problem;
  }
  Sogm occupied, blocked, recently_occupied, inflation, emergency, collision;
  mutable ConfigurationSpace space;  // works itself out while it is looked at
};

// What a path does not leave: the flight space, where all that blocks lies in the window.
inline Eigen::AlignedBox3d space_of(const Scene& scene, const SearchLimits& limits) {
  const GridGeometry& grid = scene.occupied.geometry;
  const double rim_m = grid.resolution_m * std::ceil(kBlocked_m / grid.resolution_m - 1e-9);
  const Eigen::Array3d low = grid.resolution_m * grid.origin.cast<double>();
  const Eigen::Array3d high = low + grid.resolution_m * grid.size.cast<double>().array();
  return {limits.space_min.cwiseMax((low + rim_m).matrix()), limits.space_max.cwiseMin((high - rim_m).matrix())};
}

inline bool occupied_at(const Sogm& sogm, const Eigen::Vector3d& position, Utime utime) {
  return sogm.occupied(sogm.frame_at(utime), sogm.geometry.voxel_of(position));
}

// A state from which the limits can be kept: what the search itself leads through.
inline MotionState viable_state(Rng& rng, const SearchLimits& limits, double tau, const Eigen::Vector3d& half) {
  MotionState state;
  state.position = in_box(rng, -half, half);
  for (int axis = 0; axis < 3; ++axis) {
    double &v = state.velocity[axis], &a = state.acceleration[axis];
    do {
      v = uniform(rng, -limits.v_max_mps, limits.v_max_mps);
      a = uniform(rng, -0.98 * limits.a_max_mps2, 0.98 * limits.a_max_mps2);
    } while (std::abs(v + tau / 3 * a) > limits.v_max_mps);
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
  out << to_string(status) << ", start " << problem.start << " at " << (problem.start_utime - kStart).count()
      << " us, goal " << problem.goal.transpose() << ", " << result.expansions << " expansions";
  for (int k = 0; k <= result.num_pieces; ++k) out << "\n  " << result.knots[static_cast<std::size_t>(k)];
  return out.str();
}

}  // namespace swarm
