// The search as a whole; its primitives are in primitives_test.cpp, its oracle in exhaustive_search.h.
// Long because each rule (limits, layers, leaving, ending, budget) has a property of its own.
#include "planner_daemon/search/kinodynamic_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/exhaustive_search.h"
#include "tests/support/search_scene.h"

namespace swarm {
namespace {

using Eigen::Vector3d;

// What every result promises, whatever the map: begins at the start, keeps the limits at every millisecond, ends at
// rest, and is free (or not) when it says so.
void check_path(const SearchResult& result, SearchStatus status, const Scene& scene, const SearchProblem& problem,
                const SearchLimits& limits, const SearchOptions& options) {
  const double tau = to_seconds(options.piece);
  ASSERT_GE(result.num_pieces, 1);
  ASSERT_LE(result.num_pieces, options.num_pieces);
  ASSERT_LE(result.expansions, options.max_expansions);
  const MotionState &first = result.knots[0], &last = result.knots[static_cast<std::size_t>(result.num_pieces)];
  ASSERT_EQ(first.position, problem.start.position);
  ASSERT_EQ(first.velocity, problem.start.velocity);
  ASSERT_EQ(first.acceleration, problem.start.acceleration);
  ASSERT_EQ(last.velocity, Vector3d::Zero());
  ASSERT_EQ(last.acceleration, Vector3d::Zero());
  ASSERT_TRUE(status != SearchStatus::kGoal || last.position == problem.goal);
  for (double t = 0.0; t < result.num_pieces * tau; t += 0.001) {
    const MotionState state = state_at(result, tau, t);
    ASSERT_LE(state.velocity.cwiseAbs().maxCoeff(), limits.v_max_mps + 1e-8) << "at " << t << " s";
    ASSERT_TRUE(limits.can_follow(state, {1.0 + 1e-8})) << state << " at " << t << " s";
  }
  Utime free_until = kNever;
  ASSERT_EQ(result.left_blocked, occupied_at(scene.blocked, problem.start.position, problem.start_utime));
  const Eigen::AlignedBox3d space = space_of(scene, limits);
  Vector3d before = problem.start.position;
  // To the end of the horizon and of the map.
  const Duration sample = options.piece / kSamples, map_end = scene.occupied.end_utime() - problem.start_utime;
  const auto samples = std::max<std::int64_t>(options.num_pieces * kSamples, (map_end + sample - 1us) / sample);
  for (int i = 1; i <= samples && free_until == kNever; ++i) {
    const Duration since = i * options.piece / kSamples;
    const Vector3d position = state_at(result, tau, i * tau / kSamples).position;
    const Eigen::Array3d moved = position - before;  // whoever is outside may only come back
    before = position;
    if (((position.array() < space.min().array() - 1e-9) && moved < -1e-9).any() ||
        ((position.array() > space.max().array() + 1e-9) && moved > 1e-9).any())
      free_until = problem.start_utime + since;
    if (result.left_blocked && since <= to_duration(options.leave_s)) continue;
    if (occupied_at(scene.blocked, position, problem.start_utime + since)) free_until = problem.start_utime + since;
  }
  // At rest the search looks when a frame begins: at most one sample earlier.
  if (free_until == kNever) {
    ASSERT_EQ(result.free_until_utime, kNever);
  } else {
    ASSERT_LE(result.free_until_utime, free_until);
    ASSERT_GT(result.free_until_utime, free_until - options.piece / kSamples - 1us);
  }
  ASSERT_EQ(status == SearchStatus::kPartial, free_until != kNever);
}

TEST(KinodynamicSearchTest, KeepsLimitsInEmptySpaceAndArrivesInTime) {
  Rng rng(4);
  const Scene scene(empty_map({32, 32, 32}, 0.5, 1, kStart, 200ms));  // nobody comes to its rim
  int arrivals = 0;
  for (int trial = 0; trial < 200; ++trial) {
    SearchLimits limits;
    limits.v_max_mps = uniform(rng, 1.0, 2.5);
    limits.a_max_mps2 = uniform(rng, 3.0, 9.0);
    SearchOptions options;
    const double tau = to_seconds(options.piece);
    KinodynamicSearch search(limits, options);
    SearchProblem problem = scene.problem(viable_state(rng, limits, tau, {5, 5, 5}), kStart, Vector3d::Zero());
    if (trial % 2 == 0) problem.start.acceleration.setZero();
    problem.goal = problem.start.position + in_cube(rng, uniform(rng, 0.0, 5.0));
    SearchResult result;
    const SearchStatus status = search.find(problem, &result);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", v_max_mps " << limits.v_max_mps << ", a_max_mps2 "
                                    << limits.a_max_mps2 << ": " << describe(problem, result, status));
    ASSERT_NO_FATAL_FAILURE(check_path(result, status, scene, problem, limits, options));
    ASSERT_NE(status, SearchStatus::kPartial);
    if (trial % 2 != 0) continue;  // the bounds below do not know accelerations
    double least_s = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      least_s = std::max(least_s, min_time_to_rest(problem.goal[axis] - problem.start.position[axis],
                                                   problem.start.velocity[axis], limits.v_max_mps, limits.a_max_mps2));
    }
    if (status == SearchStatus::kGoal) {
      ++arrivals;
      ASSERT_GE(result.num_pieces * tau, least_s - 1e-9);
      ASSERT_LE(result.num_pieces * tau, 1.5 * least_s + 2 * tau);
    } else {
      ASSERT_GT(1.5 * least_s + 2 * tau, options.num_pieces * tau) << "within reach, not reached";
      ASSERT_EQ(result.num_pieces, options.num_pieces);
    }
  }
  EXPECT_GT(arrivals, 25);
}

// From wherever its own paths lead, also between two knots, a robot whose jerk and thrust are limited finds paths that
// keep these limits, and comes to rest at the goal.
TEST(KinodynamicSearchTest, KeepsJerkAndThrust) {
  Rng rng(9);
  const Scene scene(empty_map({40, 40, 40}, 0.5, 1, kStart, 200ms));
  for (int trial = 0; trial < 60; ++trial) {
    SearchLimits limits;
    limits.v_max_mps = uniform(rng, 1.0, 2.0);
    if (trial % 3 != 0) limits.j_max_mps3 = uniform(rng, 30.0, 80.0);
    if (trial % 3 != 1) {
      limits.kind = "thrust";
      limits.thrust = {uniform(rng, 1.0, 4.0), uniform(rng, 20.0, 30.0), uniform(rng, 30.0, 50.0)};
    }
    SearchOptions options;
    const double tau = to_seconds(options.piece);
    KinodynamicSearch search(limits, options);
    SearchResult result;
    MotionState state = at_rest(in_cube(rng, 5.0));
    const Vector3d goal = state.position + in_cube(rng, 3.0);
    SearchStatus status = SearchStatus::kPartial;
    for (int plan = 0; plan < 100 && (status != SearchStatus::kGoal || result.num_pieces > 1); ++plan) {
      const SearchProblem problem = scene.problem(state, kStart, goal);
      status = search.find(problem, &result);
      SCOPED_TRACE(testing::Message() << "trial " << trial << ", plan " << plan << ": v " << limits.v_max_mps << ", j "
                                      << limits.j_max_mps3 << ", " << limits.kind << ' ' << limits.tilt_slope() << ": "
                                      << describe(problem, result, status));
      SearchLimits tolerant = limits;
      tolerant.v_max_mps *= 1.005;  // a plan may leave another one while that still accelerates
      ASSERT_NO_FATAL_FAILURE(check_path(result, status, scene, problem, tolerant, options));
      ASSERT_NE(status, SearchStatus::kPartial);
      state = state_at(result, tau, std::min(uniform(rng, 0.02, 0.3), result.num_pieces * tau));
    }
    EXPECT_EQ(status, SearchStatus::kGoal) << trial;
  }
}

// ---- random maps

// What a path keeps clear of at every millisecond follows from what is checked, kSamples times a primitive: at a sample
// the robot's voxel is free, so its centre is farther than the dilation radius from what is occupied, and the robot
// within half a voxel's diagonal of it. Between samples it travels from the nearest one in the same frame: half a
// sample's time, or a whole one next to a change of frames.
void check_clearance(const SearchResult& result, const SearchProblem& problem, const Sogm& occupied,
                     const SearchLimits& limits, const SearchOptions& options) {
  const double tau = to_seconds(options.piece), speed = std::sqrt(3.0) * limits.v_max_mps;
  const double at_samples = kBlocked_m - std::sqrt(3.0) / 2 * occupied.geometry.resolution_m;
  const Duration sample = options.piece / kSamples;
  for (Duration since{}; since <= options.num_pieces * options.piece; since += 1ms) {
    const Duration before = since / sample * sample;
    const int frame = occupied.frame_at(problem.start_utime + since);
    std::optional<Duration> away;
    for (const Duration near : {before, before + sample}) {
      const Vector3d position = state_at(result, tau, to_seconds(near)).position;
      if (!occupied.geometry.contains(occupied.geometry.voxel_of(position))) continue;  // nothing is known there
      if (occupied.frame_at(problem.start_utime + near) == frame)
        away = std::min(away.value_or(sample), std::chrono::abs(since - near));
    }
    if (!away) continue;
    const double required = at_samples - speed * to_seconds(*away) - 1e-9;
    const Vector3d position = state_at(result, tau, to_seconds(since)).position;
    ASSERT_GE(distance_to_occupied(occupied, frame, position, kBlocked_m), required)
        << since.count() << " us after the start";
  }
}

TEST(KinodynamicSearchTest, PathsThroughRandomMapsAreFreeAndWithinLimits) {
  Rng rng(5);
  const SearchLimits limits;
  const SearchOptions options;
  KinodynamicSearch search(limits, options);
  std::array<int, 3> seen{};
  int left_blocked = 0;
  for (int map = 0; map < 18; ++map) {
    const Scene scene(
        random_map(rng, uniform_int(rng, 2, 40), {5, 5, 3}, 10, kStart, Duration(uniform_int(rng, 150'000, 250'000))));
    for (int trial = 0; trial < 6; ++trial) {
      MotionState start = viable_state(rng, limits, to_seconds(options.piece), {2.4, 2.4, 1.4});
      if (trial % 2 == 0) start = at_rest(start.position);
      const SearchProblem problem = scene.problem(start, kStart + Duration(uniform_int(rng, 0, 150'000)),
                                                  in_box(rng, {-4, -4, -1.4}, {4, 4, 1.4}));
      SearchResult result;
      const SearchStatus status = search.find(problem, &result);
      SCOPED_TRACE(testing::Message() << "map " << map << " trial " << trial << ": "
                                      << describe(problem, result, status));
      ASSERT_NO_FATAL_FAILURE(check_path(result, status, scene, problem, limits, options));
      ++seen[static_cast<std::size_t>(status)];
      left_blocked += result.left_blocked;
      if (status != SearchStatus::kPartial && !result.left_blocked) {
        ASSERT_NO_FATAL_FAILURE(check_clearance(result, problem, scene.occupied, limits, options));
      }
    }
  }
  for (int count : seen) EXPECT_GT(count, 3);
  EXPECT_GT(left_blocked, 5);
}

TEST(KinodynamicSearchTest, StaysInsideTheFlightSpace) {
  Rng rng(6);
  SearchLimits limits;
  limits.space_min = {-1.0, -2.0, -0.5};
  limits.space_max = {1.5, 2.0, 0.7};
  KinodynamicSearch search(limits, SearchOptions{});
  int partial = 0, at_border = 0;
  for (int map = 0; map < 10; ++map) {
    const Scene scene(random_map(rng, uniform_int(rng, 0, 12), {5, 5, 3}, 10, kStart, 200ms));
    for (int trial = 0; trial < 8; ++trial) {
      const Vector3d position = in_box(rng, limits.space_min, limits.space_max);
      const SearchProblem problem = scene.problem(at_rest(position), kStart, in_cube(rng, 4));
      SearchResult result;
      const SearchStatus status = search.find(problem, &result);
      SCOPED_TRACE(testing::Message() << "map " << map << " trial " << trial << ": "
                                      << describe(problem, result, status));
      partial += status == SearchStatus::kPartial;
      if (status == SearchStatus::kPartial) continue;
      double reach = -INFINITY;
      for (double t = 0.0; t <= 2.0; t += 0.001) {
        const Vector3d p = state_at(result, 0.2, t).position;
        reach = std::max({reach, (limits.space_min - p).maxCoeff(), (p - limits.space_max).maxCoeff()});
      }
      // Between two samples, 25 ms apart, a position can peak by a_max_mps2 dt^2 / 8 beyond them.
      ASSERT_LE(reach, 5e-4);
      at_border += reach > -0.05;
    }
  }
  EXPECT_LT(partial, 20);
  EXPECT_GT(at_border, 15);
}

TEST(KinodynamicSearchTest, HoveringInAStaticMapAlwaysSurvivesWhateverTheBudget) {
  Rng rng(7);
  for (int map = 0; map < 20; ++map) {
    Sogm occupied = empty_map({5, 5, 3}, 0.1, 10, kStart, 200ms);
    for (int i = 0; i < 25; ++i)
      mark_moving(&occupied, in_box(rng, {-2.5, -2.5, -1.5}, {2.5, 2.5, 1.5}), Vector3d::Zero(), 0.3);
    const Scene scene(occupied);
    for (int trial = 0; trial < 10; ++trial) {
      SearchOptions options;
      options.max_expansions = 1 << uniform_int(rng, 0, 9);
      KinodynamicSearch search(SearchLimits{}, options);
      MotionState start;
      do start = at_rest(in_box(rng, {-2.5, -2.5, -1.5}, {2.5, 2.5, 1.5}));
      while (occupied_at(scene.blocked, start.position, kStart));
      const SearchProblem problem = scene.problem(start, kStart, in_cube(rng, 5));
      SearchResult result;
      const SearchStatus status = search.find(problem, &result);
      SCOPED_TRACE(testing::Message() << "map " << map << " trial " << trial << ", budget " << options.max_expansions
                                      << ": " << describe(problem, result, status));
      ASSERT_NE(status, SearchStatus::kPartial);
      ASSERT_NO_FATAL_FAILURE(check_path(result, status, scene, problem, SearchLimits{}, options));
    }
  }
}

// ---- against exhaustive search

// With cells so small that nothing is pruned and a weight that keeps the heuristic consistent, the end found is the
// best.
TEST(KinodynamicSearchTest, FindsTheBestOfAllChains) {
  Rng rng(8);
  std::array<int, 3> seen{};
  int left_blocked = 0, pruned = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const bool flat = trial % 4 == 0;  // deeper, but in a slab too thin to leave the plane
    SearchLimits limits;
    SearchOptions options;
    options.num_pieces = 3 + (flat ? 3 : 2);
    options.max_expansions = trial % 12 == 0 ? 50'000 : 5'000;
    options.heuristic_weight = trial % 3 == 0 ? 0.0 : uniform(rng, 0.0, 1.0 / 1.2);
    options.cell_m = options.cell_mps = 1e-7;
    const double tau = to_seconds(options.piece);
    const Scene scene(random_map(rng, uniform_int(rng, 2, 16), {3, 3, 2}, 6, kStart, 200ms));
    MotionState start = viable_state(rng, limits, tau, {0.5, 0.5, 0.5});
    if (trial % 2 == 0) start = at_rest(start.position);
    Vector3d goal = in_cube(rng, 1);
    goal *= 6.0 / goal.norm();  // out of reach: no shot at it
    if (flat) {
      limits.space_min.z() = start.position.z() - 0.01;
      limits.space_max.z() = start.position.z() + 0.01;
    }
    SearchProblem problem = scene.problem(start, kStart + Duration(uniform_int(rng, 0, 100'000)), goal);
    problem.fine = trial % 12 == 0;
    KinodynamicSearch search(limits, options);
    SearchResult result;
    const SearchStatus status = search.find(problem, &result);
    const ExhaustiveSearch all(scene, problem, limits, options);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", weight " << options.heuristic_weight << ", " << all.nodes
                                    << " nodes: " << describe(problem, result, status));
    ++seen[static_cast<std::size_t>(status)];
    left_blocked += result.left_blocked;
    if (all.least_total < INFINITY) {
      ASSERT_EQ(status, SearchStatus::kSurvives);
      ASSERT_NEAR(all.total(result), all.least_total, 1e-9);
      pruned += all.nodes < 4000;
    } else {
      ASSERT_EQ(status == SearchStatus::kPartial, all.longest_until != kNever);
      ASSERT_EQ(result.free_until_utime, all.longest_until);
    }
  }
  EXPECT_GT(seen[1], 20);
  EXPECT_GT(seen[2], 5);
  EXPECT_GT(left_blocked, 5);
  EXPECT_GT(pruned, 10);
}

// In a plane, from blocked space, with the goal in reach: what can leave without a touch does, but for few cases in
// which the coarse closed set has pruned the way out.
TEST(KinodynamicSearchTest, LeavesBlockedSpaceWithoutATouchWhereAChainCan) {
  Rng rng(11);
  int avoidable = 0, unavoidable = 0, touched = 0, partial = 0;
  while (avoidable < 60) {
    Sogm occupied = empty_map({4, 4, 1}, 0.1, 1, kStart, 200ms);
    for (int i = 0; i < 4; ++i)
      mark_ball(&occupied, 0, in_box(rng, {-1, -1, 0}, {1, 1, 0}), uniform(rng, 0.05, 0.3), true);
    const Scene scene(occupied);
    MotionState start = at_rest(in_box(rng, {-1, -1, 0}, {1, 1, 0}));
    start.velocity = in_box(rng, {-1.8, -1.8, 0}, {1.8, 1.8, 0});
    if (!occupied_at(scene.blocked, start.position, kStart) || occupied_at(scene.emergency, start.position, kStart))
      continue;
    SearchLimits limits;
    limits.space_min.z() = -0.01;
    limits.space_max.z() = 0.01;
    const SearchProblem problem = scene.problem(start, kStart, in_box(rng, {-1.5, -1.5, 0}, {1.5, 1.5, 0}));
    SearchOptions shorter;
    shorter.num_pieces = 6;
    SearchProblem coarse = problem;
    coarse.fine = false;
    if (!ExhaustiveSearch(scene, coarse, limits, shorter).can_avoid_collision) {
      ++unavoidable;
      continue;
    }
    ++avoidable;
    const SearchOptions options;
    KinodynamicSearch search(limits, options);
    SearchResult result;
    const SearchStatus status = search.find(problem, &result);
    SCOPED_TRACE(testing::Message() << describe(problem, result, status));
    ASSERT_NO_FATAL_FAILURE(check_path(result, status, scene, problem, limits, options));
    partial += status == SearchStatus::kPartial;
    bool touches = false;
    for (int i = 1; i <= 18; ++i) {
      touches = touches || occupied_at(scene.collision, state_at(result, 0.2, 0.025 * i).position, kStart);
    }
    touched += touches;
  }
  EXPECT_EQ(touched, 0);
  EXPECT_LE(partial, 3);
  EXPECT_GT(unavoidable, 5);
}

// ---- single scenes

TEST(KinodynamicSearchTest, FollowsAMovingGoalThroughAStaticMap) {
  Rng rng(9);
  const SearchLimits limits;
  const SearchOptions options;
  KinodynamicSearch search(limits, options);
  for (int trial = 0; trial < 5; ++trial) {
    Sogm occupied = empty_map({7, 7, 3}, 0.1, 1, kStart, 200ms);
    for (int i = 0; i < 6; ++i)
      mark_moving(&occupied, in_box(rng, {-1, -1, -1.5}, {1, 1, 1.5}), Vector3d::Zero(), 0.2, true);
    const Scene scene(occupied);
    SearchResult plan;  // the one flown
    plan.num_pieces = 0;
    plan.knots[0] = at_rest({2.2, 0, 0});
    int at_piece = 0;
    double farthest = 0.0;
    for (int step = 0; step < 60; ++step) {
      const double angle = 0.08 * std::min(step, 50);  // 0.9 m/s, then it stops
      const SearchProblem problem = scene.problem(plan.knots[static_cast<std::size_t>(at_piece)], kStart + step * 200ms,
                                                  {2.2 * std::cos(angle), 2.2 * std::sin(angle), 0.2});
      SearchResult result;
      const SearchStatus status = search.find(problem, &result);
      SCOPED_TRACE(testing::Message() << "trial " << trial << " step " << step << ": "
                                      << describe(problem, result, status));
      ASSERT_NO_FATAL_FAILURE(check_path(result, status, scene, problem, limits, options));
      ASSERT_NE(status, SearchStatus::kPartial);
      if (step > 5) farthest = std::max(farthest, (problem.goal - problem.start.position).norm());
      plan = result;
      at_piece = 1;
      ASSERT_TRUE(step < 59 || (problem.goal - problem.start.position).norm() < 1e-6);
    }
    EXPECT_LT(farthest, 1.0) << "trial " << trial;
  }
}

TEST(KinodynamicSearchTest, AGoalCountsOnlyWhenItStaysFree) {
  const SearchLimits limits;
  const SearchOptions options;
  KinodynamicSearch search(limits, options);
  SearchResult result;
  const Vector3d goal(1.2, 0.03, 0.02);
  const auto find = [&](const Sogm& occupied) {
    const Scene scene(occupied);
    const SearchProblem problem = scene.problem(at_rest({-0.31, 0.03, 0.02}), kStart, goal);
    const SearchStatus status = search.find(problem, &result);
    SCOPED_TRACE(describe(problem, result, status));
    check_path(result, status, scene, problem, limits, options);
    return status;
  };
  const Sogm empty = empty_map({5, 5, 3}, 0.1, 10, kStart, 200ms);
  EXPECT_EQ(find(empty), SearchStatus::kGoal);
  EXPECT_LE(result.num_pieces, 8);

  Sogm always = empty;
  mark_moving(&always, goal, Vector3d::Zero(), 0.2);
  EXPECT_EQ(find(always), SearchStatus::kSurvives);
  const double left = (result.knots[static_cast<std::size_t>(result.num_pieces)].position - goal).norm();
  EXPECT_GT(left, 0.4);  // free
  EXPECT_LT(left, 0.9);  // but as near as may be

  Sogm early = empty, late = empty;
  mark_box(&early, goal - Vector3d::Constant(0.2), goal + Vector3d::Constant(0.2), 0, 3);
  mark_box(&late, goal - Vector3d::Constant(0.2), goal + Vector3d::Constant(0.2), 9, 9);
  EXPECT_EQ(find(early), SearchStatus::kGoal);
  EXPECT_EQ(find(late), SearchStatus::kSurvives);
}

// Past corners of what is blocked a quintic may be free where it is sampled only: the robot would find it again and
// again, and never fly it.
TEST(KinodynamicSearchTest, GoalShotsAreFreeBetweenSamples) {
  Rng rng(12);
  const SearchLimits limits;
  const SearchOptions options;
  KinodynamicSearch search(limits, options);
  SearchResult result;
  int shots = 0, others = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    Sogm occupied = empty_map({4, 4, 2}, 0.1, 1, kStart, 200ms);
    const Vector3d goal = in_box(rng, {0.8, -0.5, -0.2}, {1.2, 0.5, 0.2});
    for (int i = 0; i < 3; ++i)
      set_voxel(&occupied, 0, occupied.geometry.voxel_of(uniform(rng, 0.2, 0.8) * goal + in_cube(rng, 0.4)));
    const Scene scene(occupied);
    const SearchProblem problem = scene.problem(at_rest(Vector3d::Zero()), kStart, goal);
    if (occupied_at(scene.blocked, Vector3d::Zero(), kStart)) continue;
    const SearchStatus status = search.find(problem, &result);
    if (status != SearchStatus::kGoal || result.expansions > 1) {
      ++others;
      continue;
    }
    ++shots;
    for (Duration since = 0ms; since < result.num_pieces * options.piece; since += 10ms) {
      const Vector3d position = state_at(result, to_seconds(options.piece), to_seconds(since)).position;
      ASSERT_FALSE(occupied_at(scene.blocked, position, kStart + since)) << trial << ", " << to_seconds(since) << " s";
    }
  }
  EXPECT_GT(shots, 100);
  EXPECT_GT(others, 200);
}

TEST(KinodynamicSearchTest, LeavesBlockedSpaceWithoutTouching) {
  const SearchLimits limits;
  SearchOptions options;
  Sogm occupied = empty_map({5, 5, 3}, 0.1, 10, kStart, 200ms);
  mark_box(&occupied, {0.2, -9, -9}, {0.3, 9, 9});  // one voxel thick, at x = 0.25; the goal lies behind it
  const Scene scene(occupied);
  MotionState start = at_rest({-0.049, 0.01, 0.02});
  start.velocity.x() = 0.8;  // able to stop before a collision
  const SearchProblem problem = scene.problem(start, kStart, {2, 0, 0});
  const auto find = [&](SearchResult* result) {
    KinodynamicSearch search(limits, options);
    const SearchStatus status = search.find(problem, result);
    SCOPED_TRACE(describe(problem, *result, status));
    check_path(*result, status, scene, problem, limits, options);
    EXPECT_NE(status, SearchStatus::kPartial);
    EXPECT_TRUE(result->left_blocked);
  };
  SearchResult result;
  find(&result);
  for (double t = 0.0; t < 2.0; t += 0.001) {
    const Vector3d p = state_at(result, 0.2, t).position;
    ASSERT_FALSE(occupied_at(scene.collision, p, kStart)) << "at " << t << " s: " << p.transpose();
    ASSERT_TRUE(t < options.leave_s || !occupied_at(scene.blocked, p, kStart)) << "at " << t << " s: " << p.transpose();
  }
  EXPECT_LT(result.knots[static_cast<std::size_t>(result.num_pieces)].position.x(), -0.05);

  options.leave_weight = 0.0;  // what keeps it from dashing through the wall
  find(&result);
  EXPECT_GT(result.knots[static_cast<std::size_t>(result.num_pieces)].position.x(), 0.55);
}

TEST(KinodynamicSearchTest, WithNoWayOutTheMotionIsFreeAsLongAsAnyCanBe) {
  const SearchLimits limits;
  const SearchOptions options;
  KinodynamicSearch search(limits, options);
  Sogm occupied = empty_map({9, 9, 9}, 0.2, 10, kStart, 200ms);
  mark_box(&occupied, Vector3d::Constant(-9), Vector3d::Constant(9), 6, 9);
  const Scene scene(occupied);
  const SearchProblem problem = scene.problem(at_rest({0.1, 0.1, 0.1}), kStart + 10ms, {1, 0.5, 0});
  SearchResult result;
  ASSERT_EQ(search.find(problem, &result), SearchStatus::kPartial);
  ASSERT_NO_FATAL_FAILURE(check_path(result, SearchStatus::kPartial, scene, problem, limits, options));
  EXPECT_EQ(result.free_until_utime, kStart + 1210ms);  // the first sample in frame 6

  // Where the goal lies the end comes while braking; elsewhere one frame later.
  Sogm split = empty_map({9, 9, 9}, 0.2, 10, kStart, 200ms);
  mark_box(&split, {0.6, -9, -9}, {9, 9, 9}, 8, 8);
  mark_box(&split, Vector3d::Constant(-9), Vector3d::Constant(9), 9, 9);
  const Scene later(split);
  ASSERT_EQ(search.find(later.problem(at_rest({0.1, 0.1, 0.1}), kStart, {3, 0, 0}), &result), SearchStatus::kPartial);
  EXPECT_EQ(result.free_until_utime, kStart + 1800ms);
}

TEST(KinodynamicSearchTest, KeepsOutOfTheInflationWhereThatCostsLittle) {
  const SearchLimits limits;
  SearchOptions options;
  options.inflation_weight = 0.8;
  Sogm occupied = empty_map({6, 6, 3}, 0.1, 10, kStart, 200ms);
  mark_moving(&occupied, {0, -0.3, 0}, Vector3d::Zero(), 0.08, true);  // beside the straight way
  const Scene scene(occupied);
  const SearchProblem problem = scene.problem(at_rest({-0.51, 0.01, 0.02}), kStart, {9, 0.01, 0.02});
  const auto samples_inflated = [&] {
    KinodynamicSearch search(limits, options);
    SearchResult result;
    const SearchStatus status = search.find(problem, &result);
    EXPECT_NE(status, SearchStatus::kPartial);
    int count = 0;
    for (double t = 0.0; t < 2.0; t += 0.005)
      count += occupied_at(scene.inflation, state_at(result, 0.2, t).position, kStart);
    return count;
  };
  const int avoiding = samples_inflated();
  options.inflation_weight = 0.0;
  EXPECT_LT(avoiding, samples_inflated());
}

// A shot at the goal would be free, but crosses where an obstacle was a moment ago and may come back to.
TEST(KinodynamicSearchTest, ShotsKeepOutOfWhatWasRecentlyOccupied) {
  Sogm occupied = empty_map({6, 6, 3}, 0.1, 10, kStart, 200ms);
  mark_box(&occupied, {-0.4, -0.2, -9}, {0.4, 0.1, 9}, 0, 0);
  const Scene avoided(occupied, 2.0), forgotten(occupied, 0.0);
  const auto samples_there = [&](const Scene& scene, SearchStatus expected) {
    KinodynamicSearch search(SearchLimits{}, SearchOptions{});
    SearchResult result;
    EXPECT_EQ(search.find(scene.problem(at_rest({-1, 0.01, 0.02}), kStart, {0.9, 0.01, 0.02}), &result), expected);
    int count = 0;
    for (double t = 0.0; t < result.num_pieces * 0.2; t += 0.005)
      count += occupied_at(avoided.recently_occupied, state_at(result, 0.2, t).position, kStart + to_duration(t));
    return count;
  };
  const int without = samples_there(forgotten, SearchStatus::kGoal);
  EXPECT_GT(without, 40);
  EXPECT_LT(samples_there(avoided, SearchStatus::kGoal), without / 4);
}

TEST(KinodynamicSearchTest, RepeatsBitForBit) {
  Rng rng(10);
  const SearchLimits limits;
  const SearchOptions options;
  KinodynamicSearch search(limits, options);
  for (int trial = 0; trial < 20; ++trial) {
    const Scene scene(random_map(rng, 25, {5, 5, 3}, 10, kStart, 200ms));
    const MotionState start = viable_state(rng, limits, 0.2, {2, 2, 1});
    const SearchProblem problem = scene.problem(start, kStart, in_cube(rng, 3));
    SearchResult first, second;
    const SearchStatus status = search.find(problem, &first);
    KinodynamicSearch fresh(limits, options);
    ASSERT_EQ(fresh.find(problem, &second), status) << describe(problem, first, status);
    ASSERT_EQ(second.expansions, first.expansions);
    ASSERT_EQ(second.num_pieces, first.num_pieces);
    ASSERT_EQ(second.free_until_utime, first.free_until_utime);
    for (int k = 0; k <= first.num_pieces; ++k) {
      const auto i = static_cast<std::size_t>(k);
      ASSERT_EQ(second.knots[i].position, first.knots[i].position) << k;
      ASSERT_EQ(second.knots[i].velocity, first.knots[i].velocity) << k;
      ASSERT_EQ(second.knots[i].acceleration, first.knots[i].acceleration) << k;
    }
  }
}

TEST(KinodynamicSearchTest, RefusesAHorizonThatCannotHoldTheBraking) {
  const auto error = [](double v_max_mps, int pieces) -> std::string {
    SearchLimits limits;
    limits.v_max_mps = v_max_mps;
    SearchOptions options;
    options.num_pieces = pieces;
    try {
      KinodynamicSearch search(limits, options);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_EQ(error(2.0, 4), "");
  EXPECT_EQ(error(2.0, Trajectory::kMaxPieces), "");
  for (int pieces : {-1, 0, 3, Trajectory::kMaxPieces + 1}) {
    EXPECT_NE(error(2.0, pieces).find("horizon: " + std::to_string(pieces) + " pieces"), std::string::npos)
        << error(2.0, pieces);
    EXPECT_NE(error(2.0, pieces).find("at least 4"), std::string::npos) << error(2.0, pieces);
  }
  EXPECT_NE(error(12.0, Trajectory::kMaxPieces), "");  // braking from 12 m/s takes 2.04 s of the 2 s
}

}  // namespace
}  // namespace swarm
