// What an escape costs, and that it finds the way out.
#include "planner_daemon/search/escape.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "planner_daemon/search/search_tree.h"
#include "tests/support/search_scene.h"

namespace swarm {
namespace {

using Eigen::Vector3d;

TEST(EscapeSearchTest, ViolationCostsTheMoreTheSoonerAndTheDeeper) {
  const SearchOptions options;
  Sogm occupied = empty_map({6, 6, 3}, 0.1, 10, kStart, 200ms);
  const Vector3d place(0.05, 0.05, 0.05);  // a voxel's centre
  mark_moving(&occupied, place, Vector3d::Zero(), 0.01);
  const Scene scene(occupied);
  EscapeSearch search(SearchLimits(), options);
  SearchProblem problem = scene.problem(at_rest({2, 2, 1}), kStart, {2, 2, 1});
  SearchResult result;
  search.find(problem, &result);
  const auto hovering = [](const Vector3d& at) { return Motion{Trajectory::hover(1, kStart, at), {}}; };
  // The weight falls from 1 to 0.05 within the first 0.95 s: mean (1 + 0.05) / 2; then 0.05 until 2 s.
  const double all = options.leave_weight * (0.95 * 0.525 + 1.05 * 0.05);
  EXPECT_NEAR(search.violation_cost(hovering(place + Vector3d(0.3, 0, 0))), all, 0.02 * all);
  EXPECT_NEAR(search.violation_cost(hovering(place + Vector3d(0.2, 0, 0))), 10 * all, 0.2 * all);
  EXPECT_NEAR(search.violation_cost(hovering(place + Vector3d(0.1, 0, 0))), 100 * all, 2 * all);
  EXPECT_EQ(search.violation_cost(hovering(place + Vector3d(0.4, 0, 0))), 0.0);
  // Half as long, but later: far less.
  Sogm late = empty_map({6, 6, 3}, 0.1, 10, kStart, 200ms);
  mark_box(&late, place.array() - 0.01, place.array() + 0.01, 5, 9);
  const Scene later(late);
  problem = later.problem(at_rest({2, 2, 1}), kStart, {2, 2, 1});
  search.find(problem, &result);
  EXPECT_NEAR(search.violation_cost(hovering(place)), 100 * options.leave_weight * 1.0 * 0.05, 3.0);
}

// A column comes from where the goal lies: to its sides, or away from it, nothing is touched.
TEST(EscapeSearchTest, TheWayOutViolatesLeast) {
  const SearchLimits limits;
  SearchOptions options;
  options.piece = 100ms;
  options.max_expansions *= 2;
  EscapeSearch search(limits, options);
  SpaceTimeHeuristic heuristic;
  int touched_at_rest = 0;
  Rng rng(4);
  for (int trial = 0; trial < 20; ++trial) {
    Sogm occupied = empty_map({6, 6, 3}, 0.1, 20, kStart, 100ms);
    const double angle = uniform(rng, 0, 6.28);
    const Vector3d side(std::cos(angle), std::sin(angle), 0);
    mark_moving(&occupied, -0.8 * side, 1.0 * side, 0.3, true);
    const Scene scene(occupied);
    SearchProblem problem = scene.problem(at_rest({0, 0, 0}), kStart, -3 * side);
    heuristic.build({&occupied}, kBlocked_m, nullptr, {problem.start.position, kStart, limits.v_max_mps, 1.0},
                    problem.goal, limits.space_min, limits.space_max);
    problem.heuristic = &heuristic;
    SearchResult result;
    search.find(problem, &result);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << describe(problem, result, SearchStatus::kSurvives));
    EXPECT_LE(result.expansions, options.max_expansions);
    int touches = 0;
    for (double t = 0.0; t < 1.0; t += 0.005) {
      const MotionState state = state_at(result, 0.1, t);
      touches += occupied_at(scene.collision, state.position, kStart + to_duration(t));
      touched_at_rest += occupied_at(scene.collision, Vector3d::Zero(), kStart + to_duration(t));
      ASSERT_LE(state.velocity.cwiseAbs().maxCoeff(), limits.v_max_mps + 1e-8);
      ASSERT_LE(state.acceleration.cwiseAbs().maxCoeff(), limits.a_max_mps2 + 1e-8);
    }
    EXPECT_EQ(touches, 0);
  }
  EXPECT_GT(touched_at_rest, 20 * 50);
}

// An acceleration that jerk kept from going further goes on growing to what is usable.
TEST(EscapeSearchTest, WhatJerkKeptBackGoesOn) {
  SearchLimits limits;
  limits.v_max_mps = 1.5, limits.j_max_mps3 = 20.0;
  SearchContext context(limits, SearchOptions(), BlockedSpace::kCosts);
  const Scene scene(empty_map({6, 6, 3}, 0.1, 20, kStart, 100ms));
  context.set(scene.problem(at_rest({0, 0, 0}), kStart, {-2, 0, 0}));
  SearchTree tree(context);
  tree.plant();
  const double step = context.primitives.step_mps2(), usable = context.primitives.a_usable_mps2().x();
  ASSERT_LT(step, usable);
  std::vector<std::int32_t> children;
  tree.for_each_child(0, [&](std::int32_t child) { children.push_back(child); });
  int grew = 0;
  for (const std::int32_t child : children) {
    const std::int32_t next = tree.add_child_alike(child);
    if (next < 0) continue;
    for (int axis = 0; axis < 3; ++axis) {
      const double now = tree[child].state.acceleration[axis], then = tree[next].state.acceleration[axis];
      if (std::abs(now) < 0.99 * step) continue;
      EXPECT_GT(then / now, 1.0) << now;
      EXPECT_LE(std::abs(then), usable + 1e-9);
      ++grew;
    }
  }
  EXPECT_GT(grew, 10);
}

// With limited jerk the acceleration of a manoeuvre grows from primitive to primitive.
TEST(EscapeSearchTest, GetsAwayWithinItsJerk) {
  SearchLimits limits;
  limits.j_max_mps3 = 40.0;
  SearchOptions options;
  EscapeSearch search(limits, options);
  Sogm occupied = empty_map({6, 6, 3}, 0.1, 20, kStart, 100ms);
  mark_moving(&occupied, {-1.2, 0.05, 0.0}, {1.0, 0, 0}, 0.3, true);
  const Scene scene(occupied);
  const SearchProblem problem = scene.problem(at_rest({0, 0, 0}), kStart, {-3, 0, 0});
  SearchResult result;
  search.find(problem, &result);
  double fastest_mps2 = 0.0;
  const double tau = to_seconds(options.piece);
  for (double t = 0.0; t < tau * result.num_pieces; t += 0.001) {
    const MotionState state = state_at(result, tau, t);
    EXPECT_FALSE(occupied_at(scene.collision, state.position, kStart + to_duration(t))) << t;
    ASSERT_LE(state.jerk.cwiseAbs().maxCoeff(), limits.j_max_mps3 + 1e-6) << t;
    fastest_mps2 = std::max(fastest_mps2, state.acceleration.cwiseAbs().maxCoeff());
  }
  EXPECT_GT(fastest_mps2, 4.5);  // a primitive changes it by 4 m/s^2
}

}  // namespace
}  // namespace swarm
