// The static heuristic against a plain Dijkstra search over the same voxels. Long because all that is asked of it
// (costs, places beside the goal, what is blocked, subgoals, refuges) comes from the one field that is compared here.
#include "planner_daemon/search/static_heuristic.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/support/plain_static_heuristic.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr double kClearance_m = 0.25;
constexpr double kLow = -0.84, kHigh = 0.84;  // above and below a window of 2 m there is nowhere to fly
const Eigen::AlignedBox3d kSpace(Vector3d(-9, -9, kLow), Vector3d(9, 9, kHigh));
const Eigen::AlignedBox3d kEverywhere(Vector3d::Constant(-99), Vector3d::Constant(99));
constexpr int kPerCell = 16;
constexpr std::int16_t kTooFar = 30'000;

struct StaticScene {
  Sogm standing;
  Vector3d goal;
  Eigen::AlignedBox3d space;
  std::unique_ptr<Guidance> guidance;  // of what stands farther away as well
};

// Some of them walled, some with a goal outside the window or too deep in something, some guided.
StaticScene random_scene(int trial, const Vector3d& size_m, Rng& rng) {
  StaticScene scene;
  scene.standing = empty_map(size_m, 0.1, 1, Utime(), 100ms);
  scene.standing.geometry.origin += Vector3i(uniform_int(rng, -9, 9), uniform_int(rng, -9, 9), 0);
  const Vector3d half = size_m / 2;
  for (int i = 0; i < 10; ++i)
    mark_ball(&scene.standing, 0, in_box(rng, -half, half), uniform(rng, 0.1, 0.6), i % 3 == 0);
  if (trial % 2 == 0) mark_box(&scene.standing, {0.3, -9, -99}, {0.6, uniform(rng, 0, 1), 99}, 0, 0);
  scene.goal = trial % 5 < 2 ? in_box(rng, -3 * half, 3 * half) : in_box(rng, -half, half);
  const double far = trial % 2 == 0 ? 9.0 : 0.6;  // some end within the window sideways, too
  scene.space = {in_box(rng, {-far, -far, -0.7}, {-far / 2, -far / 2, -0.4}).cwiseProduct(size_m),
                 in_box(rng, {far / 2, far / 2, 0.3}, {far, far, 0.7}).cwiseProduct(size_m)};
  if (trial % 3 == 0) {
    Sogm wide = empty_map(3 * size_m, 0.1, 1, Utime(), 100ms);
    for (int i = 0; i < 20; ++i) mark_ball(&wide, 0, in_box(rng, -3 * half, 3 * half), uniform(rng, 0.3, 1.2), true);
    scene.guidance = std::make_unique<Guidance>("", scene.space.min(), scene.space.max());
    scene.guidance->update(wide, wide, nullptr, scene.goal, kClearance_m);
  }
  return scene;
}

struct Comparison {
  int cells = 0, unreached = 0, detours = 0, cut_off = 0, coarse = 0;
};

// Looked up from its own window, and from one that has moved since.
void compare(const StaticScene& scene, const StaticHeuristic& heuristic, const PlainStaticHeuristic& plain, Rng& rng,
             Comparison* sum) {
  ASSERT_EQ(heuristic.empty(), plain.nothing_stands && (scene.guidance == nullptr || scene.guidance->empty()));
  if (heuristic.empty()) return;
  ASSERT_EQ(heuristic.is_cut_off(), plain.is_cut_off());
  sum->cut_off += plain.is_cut_off();
  const Vector3i cells = cells_in(plain.grid);
  const int num_z = cells.z() + 2, stride = num_z + 3;
  for (int move = 0; move < 3; ++move) {
    const Vector3i moved = move == 0
                               ? Vector3i::Zero().eval()
                               : Vector3i(uniform_int(rng, -7, 7), uniform_int(rng, -7, 7), uniform_int(rng, -4, 4));
    const Vector3i origin = plain.grid.origin + moved;
    for (int x = -1; x <= cells.x(); ++x) {
      const int first_y = uniform_int(rng, -1, 2), num_y = uniform_int(rng, 1, cells.y());
      std::vector<std::int16_t> out(static_cast<std::size_t>(num_y * stride), 7);
      heuristic.ticks(origin, x, first_y, num_y, num_z, static_cast<std::size_t>(stride), kPerCell, kTooFar,
                      out.data());
      for (int i = 0; i < num_y * stride; ++i) {
        const Vector3i cell(x, first_y + i / stride, i % stride);
        const int expected = cell.z() < num_z ? plain.ticks(origin, cell, kPerCell, kTooFar) : kTooFar;
        ASSERT_EQ(out[static_cast<std::size_t>(i)], expected)
            << "cell " << cell.transpose() << " of a window moved by " << moved.transpose();
        ++sum->cells;
        sum->unreached += expected == kTooFar;
        const Vector3i middle = moved + Vector3i::Ones() + kCellVoxels * cell;
        sum->detours += expected != kTooFar &&
                        expected > kPerCell * (plain.goal_voxel - middle).cwiseAbs().maxCoeff() / kCellVoxels + 40;
      }
    }
  }
}

void compare_random(int trial, const Vector3d& size_m, Rng& rng, StaticHeuristic* heuristic, Comparison* sum) {
  const StaticScene scene = random_scene(trial, size_m, rng);
  SCOPED_TRACE(testing::Message() << "trial " << trial << ", goal " << scene.goal.transpose());
  const Guidance* guidance = scene.guidance.get();
  const auto detail = trial % 4 == 3 ? StaticHeuristic::Detail::kVoxels : StaticHeuristic::Detail::kCells;
  const double blocked_m = trial % 4 == 1 ? 0.2 : kClearance_m;  // walls of four voxels are too thin for cells
  heuristic->build({&scene.standing}, blocked_m, scene.goal, scene.space, guidance, detail);
  const PlainStaticHeuristic plain(scene.standing, blocked_m, scene.goal, scene.space, guidance, detail);
  sum->coarse += plain.edge == 2;
  ASSERT_NO_FATAL_FAILURE(compare(scene, *heuristic, plain, rng, sum));
}

TEST(StaticHeuristicTest, EqualsAPlainDijkstraSearch) {
  Rng rng(3);
  StaticHeuristic heuristic;
  Comparison sum;
  for (int trial = 0; trial < 24; ++trial)  // whole cells and rests
    compare_random(trial, {2.7 + 0.1 * (trial % 3), 2.5, 1.3 + 0.1 * (trial % 4)}, rng, &heuristic, &sum);
  EXPECT_GT(sum.cells, 20'000);
  EXPECT_GT(sum.unreached, sum.cells / 10);
  EXPECT_LT(sum.unreached, sum.cells - 5'000);
  EXPECT_GT(sum.detours, 300);
  EXPECT_GT(sum.cut_off, 1);
  EXPECT_LT(sum.cut_off, 16);
  EXPECT_EQ(sum.coarse, 12);
}

// Columns of several words.
TEST(StaticHeuristicTest, EqualsAPlainDijkstraSearchInHighWindows) {
  Rng rng(4);
  StaticHeuristic heuristic;
  Comparison sum;
  for (int trial = 0; trial < 6; ++trial)
    compare_random(trial, {1.1, 1.3, 6.4 + 3.1 * (trial % 3)}, rng, &heuristic, &sum);
  EXPECT_GT(sum.cells, 3'000);
}

// Nothing comes in from the edge: the window is a world of its own.
std::unique_ptr<Guidance> to_nowhere(double half_m) {
  auto nowhere = std::make_unique<Guidance>("", Vector3d::Constant(-9), Vector3d::Constant(9));
  Sogm cage = empty_map(Vector3d::Constant(2 * half_m), 0.1, 1, Utime(), 100ms);
  mark_box(&cage, {-9, -9, -9}, {9, 9, 9});
  nowhere->update(cage, cage, nullptr, {1.0, 0.0, 0.0}, kClearance_m);
  return nowhere;
}

// In a wall the way ends beside the goal when it lies at most 0.8 m deep; deeper, nowhere.
TEST(StaticHeuristicTest, AGoalInAWallIsReachedBesideIt) {
  Sogm standing = empty_map({5, 3, 3}, 0.1, 1, Utime(), 100ms);
  mark_box(&standing, {0.7, -9, -9}, {2.9, 9, 9});  // blocked from 0.5 m on
  const auto nowhere = to_nowhere(2.5);
  ASSERT_FALSE(nowhere->empty());
  for (const auto& [depth_m, is_reached] : {std::pair{0.05, true}, {0.45, true}, {0.75, true}, {0.85, false}}) {
    StaticHeuristic heuristic;
    const Vector3d goal(0.5 + depth_m, 0.05, 0.05);
    heuristic.build({&standing}, kClearance_m, goal, kEverywhere, nowhere.get());
    EXPECT_EQ(heuristic.is_cut_off(), !is_reached) << depth_m;
    const auto beside = heuristic.beside_goal({-0.3, 0.4, 0.2});
    ASSERT_EQ(beside.has_value(), is_reached) << depth_m;
    const Vector3d face(0.45, 0.05, 0.05);
    EXPECT_LT((beside.value_or(face) - face).norm(), 1e-9) << beside.value_or(face).transpose();
  }
}

// No place that is free is nearer to the goal.
TEST(StaticHeuristicTest, BesideTheGoalIsTheNearestPlace) {
  Rng rng(8);
  StaticHeuristic heuristic;
  int found = 0, others = 0;
  for (int trial = 0; trial < 160; ++trial) {
    const StaticScene scene = random_scene(trial, {2.5, 2.7, 1.5}, rng);
    const Guidance* guidance = scene.guidance.get();
    heuristic.build({&scene.standing}, kClearance_m, scene.goal, scene.space, guidance);
    const auto beside = heuristic.beside_goal(scene.standing.geometry.center_of(scene.standing.geometry.size / 2));
    others += !beside.has_value();
    if (!beside) continue;
    ++found;
    const PlainStaticHeuristic plain(scene.standing, kClearance_m, scene.goal, scene.space, guidance);
    const Vector3i end = plain.grid.voxel_of(*beside);
    ASSERT_TRUE(plain.grid.contains(end) && !plain.is_too_close(end)) << "trial " << trial;
    const int away2 = (end - plain.goal_voxel).squaredNorm();
    ASSERT_GT(away2, 0) << "trial " << trial << ": the goal itself is free";
    plain.voxels.for_each_voxel([&](const Vector3i& v) {
      const Vector3d middle = plain.grid.center_of(v);
      if (scene.space.exteriorDistance(middle) > 0.05 - 1e-6 || plain.is_too_close(v)) return;
      ASSERT_GE((v - plain.goal_voxel).squaredNorm(), away2) << "trial " << trial << ", voxel " << v.transpose();
    });
  }
  EXPECT_GT(found, 10);
  EXPECT_GT(others, 10);
}

// Walls of a single voxel, however they stand: cells of two voxels have no holes where voxels have none.
TEST(StaticHeuristicTest, TheThinnestWallsAreClosed) {
  const auto nowhere = to_nowhere(2.5);
  ASSERT_FALSE(nowhere->empty());
  Rng rng(7);
  StaticHeuristic heuristic;
  for (int trial = 0; trial < 300; ++trial) {
    Vector3d normal = in_box(rng, -Vector3d::Ones(), Vector3d::Ones()).normalized();
    if (trial % 3 == 0) normal = Vector3d(normal.x(), trial % 2 == 0 ? 0.0 : normal.x(), 0.0).normalized();
    const double distance_m = uniform(rng, 0.45, 0.8);
    Sogm standing = empty_map({3, 3, 3}, 0.1, 1, Utime(), 100ms);
    PlainWays(standing.geometry.size).for_each_voxel([&](const Vector3i& v) {
      const double away_m = std::abs(normal.dot(standing.geometry.center_of(v)) - distance_m);
      if (away_m <= 0.05 * normal.cwiseAbs().maxCoeff() + 1e-9) set_voxel(&standing, 0, v);
    });
    const Vector3d goal = std::min(2.0 * distance_m, 1.4) * normal;
    for (const double blocked_m : {0.1 * StaticHeuristic::kThickEnough, 0.31}) {
      heuristic.build({&standing}, blocked_m, goal, kEverywhere, nowhere.get());
      ASSERT_TRUE(heuristic.is_cut_off()) << "normal " << normal.transpose() << ", " << distance_m << " m away";
      heuristic.build({&standing}, blocked_m, -goal, kEverywhere, nowhere.get());
      ASSERT_FALSE(heuristic.is_cut_off());
    }
  }
}

TEST(StaticHeuristicTest, AnEnclosedRobotIsCutOff) {
  Sogm standing = empty_map({4, 4, 2}, 0.1, 1, Utime(), 100ms);
  for (const double side : {-1.2, 1.1}) {
    mark_box(&standing, {side, -1.2, -9}, {side + 0.1, 1.2, 9});
    mark_box(&standing, {-1.2, side, -9}, {1.2, side + 0.1, 9});
  }
  StaticHeuristic heuristic;
  heuristic.build({&standing}, kClearance_m, {1.8, 0, 0}, kSpace, nullptr);
  EXPECT_FALSE(heuristic.empty());
  EXPECT_TRUE(heuristic.is_cut_off());
  EXPECT_FALSE(heuristic.subgoal({0, 0, 0}).has_value());
  EXPECT_EQ(heuristic.blocked(11, 0, -10, 0), 0u);
  heuristic.build({&standing}, kClearance_m, {0.5, 0.5, 0}, kSpace, nullptr);  // the goal is inside as well
  EXPECT_FALSE(heuristic.is_cut_off());
  EXPECT_NE(heuristic.blocked(11, 0, -10, 0), 0u);
}

TEST(StaticHeuristicTest, KnowsWhatIsBlocked) {
  Rng rng(5);
  StaticHeuristic heuristic;
  for (const double height_m : {2.1, 9.7}) {
    const StaticScene scene = random_scene(1, {2, 2, height_m}, rng);
    heuristic.build({&scene.standing}, kClearance_m, {9, 9, 0}, kEverywhere, nullptr);
    ASSERT_FALSE(heuristic.empty() || heuristic.is_cut_off());
    const PlainStaticHeuristic plain(scene.standing, kClearance_m, {9, 9, 0}, kEverywhere, nullptr);
    for (int i = 0; i < 3000; ++i) {
      const Vector3i at(uniform_int(rng, -3, 22), uniform_int(rng, -3, 22), uniform_int(rng, -70, 100));
      const int w = uniform_int(rng, 0, 1);
      const Vector3i place = at + plain.grid.origin;
      const std::uint64_t bits = heuristic.blocked(place.x(), place.y(), place.z(), w);
      for (int k = 0; k < 64; ++k) {
        const Vector3i voxel = at + Vector3i(0, 0, 64 * w + k);
        ASSERT_EQ(bits >> k & 1, plain.is_too_close(voxel)) << voxel.transpose();
      }
    }
  }
}

// Out of a dead end, whatever else stands around.
TEST(StaticHeuristicTest, SubgoalsLeadAroundWhatStandsStill) {
  Rng rng(6);
  StaticHeuristic heuristic;
  int found = 0, straight = 0, missing = 0;
  for (int trial = 0; trial < 6; ++trial) {
    StaticScene scene;
    scene.standing = empty_map({7.2, 7.2, 1.1}, 0.1, 1, Utime(), 100ms);
    const double half_m = uniform(rng, 1.2, 1.8);
    mark_box(&scene.standing, {0.8, -half_m, -9}, {1.0, half_m, 9});
    for (const double side : {-1.0, 1.0})
      mark_box(&scene.standing, {-0.5, side * half_m - 0.1, -9}, {1.0, side * half_m + 0.1, 9});
    for (int i = 0; i < 5; ++i) mark_ball(&scene.standing, 0, in_box(rng, {-3, -3, 0}, {3, 3, 0}), 0.15, true);
    scene.goal = in_box(rng, {2, -1, -0.3}, {5, 1, 0.3});
    scene.space = {Vector3d(-9, -9, -0.34), Vector3d(9, 9, 0.34)};
    heuristic.build({&scene.standing}, kClearance_m, scene.goal, scene.space, nullptr);
    if (heuristic.is_cut_off()) continue;
    const PlainStaticHeuristic plain(scene.standing, kClearance_m, scene.goal, scene.space, nullptr);
    const double cell_m = 0.1 * plain.edge;
    const auto cell_of = [&](const Vector3d& place) -> Vector3i {
      return (place / cell_m).array().floor().matrix().cast<int>() - plain.first_cell;
    };
    for (int i = 0; i < 60; ++i) {
      const Vector3d place =
          i % 3 == 0 ? in_box(rng, {-3, -3, -0.3}, {3, 3, 0.3}) : in_box(rng, {-1, -1, -0.3}, {1, 1, 0.3});
      SCOPED_TRACE(testing::Message() << "trial " << trial << " from " << place.transpose() << " to "
                                      << scene.goal.transpose());
      const int cost = plain.cost_from(place);
      if (cost == PlainWays::kNone) continue;
      const bool is_detour = cost - Wavefront::straight_cost(plain.goal_voxel - plain.grid.voxel_of(place)) >= 50;
      const auto subgoal = heuristic.subgoal(place);
      if (!is_detour) {
        ++straight;
        ASSERT_FALSE(subgoal.has_value());
        continue;
      }
      missing += !subgoal.has_value();
      if (!subgoal) continue;
      ++found;
      ASSERT_LT(subgoal->cost, cost);
      ASSERT_EQ(subgoal->cost, plain.cost(cell_of(subgoal->position)));
      if (plain.cost(cell_of(place)) == PlainWays::kNone) continue;  // it begins beside
      // Seen from there: nowhere on the line a cell that is reached is farther than a quarter of its edge away.
      for (double s = 0.0; s <= 1.0; s += 0.01) {
        const Vector3d at = place + s * (subgoal->position - place);
        bool is_reached = false;
        for (int k = 0; k < 8; ++k) {
          const Vector3d beside = at + 0.26 * cell_m * (Vector3d(k & 1, k >> 1 & 1, k >> 2).array() * 2 - 1).matrix();
          const Vector3i cell = cell_of(beside).cwiseMax(0).cwiseMin(plain.ways.size - Vector3i::Ones());
          is_reached = is_reached || plain.cost(cell) != PlainWays::kNone;
        }
        ASSERT_TRUE(is_reached) << at.transpose();
      }
    }
  }
  EXPECT_GT(found, 60);
  EXPECT_GT(straight, 60);
  EXPECT_LT(missing, found / 10);
}

// A wall across the way, but for its end: there the way leads first, and behind it there is no detour left.
TEST(StaticHeuristicTest, TheSubgoalLiesBesideTheEndOfAWall) {
  Sogm standing = empty_map({8, 8, 2}, 0.1, 1, Utime(), 100ms);
  mark_box(&standing, {1.0, -2.0, -9}, {1.2, 99, 9});
  StaticHeuristic heuristic;
  heuristic.build({&standing}, kClearance_m, {3, 0, 0}, kSpace, nullptr);
  const auto subgoal = heuristic.subgoal({0.05, 0.05, 0.05});
  ASSERT_TRUE(subgoal.has_value());
  EXPECT_NEAR(subgoal->position.x(), 0.8, 0.4);
  EXPECT_NEAR(subgoal->position.y(), -2.0, 0.5);
  EXPECT_NEAR(subgoal->position.z(), 0.0, 0.4);
  EXPECT_FALSE(heuristic.subgoal({1.6, -2.2, 0.0}).has_value());
  EXPECT_FALSE(heuristic.subgoal({2.0, 0.0, 0.0}).has_value());
  EXPECT_FALSE(heuristic.subgoal({99.0, 0.0, 0.0}).has_value()) << "outside the window";
}

// A tube along x, from `low_x` to `high_x` [m], with room for one, neither beside nor above another.
const Eigen::AlignedBox3d kFlat(Vector3d(-9, -9, -0.25), Vector3d(9, 9, 0.25));
Sogm tube(double low_x, double high_x) {
  Sogm standing = empty_map({8, 8, 2}, 0.1, 1, Utime(), 100ms);
  mark_box(&standing, {low_x, -9, -9}, {high_x, -0.4, 9});
  mark_box(&standing, {low_x, 0.4, -9}, {high_x, 9, 9});
  return standing;
}

// Behind a wall through the whole window nothing is reached, though ways may lead around it outside.
TEST(StaticHeuristicTest, WaysWithinTheWindowDoNotLeaveIt) {
  Sogm standing = empty_map({8, 8, 2}, 0.1, 1, Utime(), 100ms);
  mark_box(&standing, {1.0, -9, -9}, {1.2, 9, 9});
  StaticHeuristic heuristic;
  heuristic.build({&standing}, kClearance_m, {0, 0, 0}, kSpace, nullptr);
  EXPECT_LT(heuristic.cost({3, 0, 0}), int{Wavefront::kUnreached});
  heuristic.build_within({&standing}, kClearance_m, {0, 0, 0}, kSpace);
  EXPECT_EQ(heuristic.cost({3, 0, 0}), int{Wavefront::kUnreached});
  EXPECT_LT(heuristic.cost({-3, 0, 0}), int{Wavefront::kUnreached});
}

TEST(StaticHeuristicTest, TheFlightSpaceEndsSideways) {
  Sogm standing = empty_map({8, 8, 2}, 0.1, 1, Utime(), 100ms);
  mark_box(&standing, {1.0, -2.0, -9}, {1.2, 2.0, 9});
  StaticHeuristic heuristic;
  for (const double low_y : {-4.0, -1.9}) {  // round the lower end, or there is none
    const Eigen::AlignedBox3d space(Vector3d(-4, low_y, kLow), Vector3d(4, 1.9, kHigh));
    heuristic.build_within({&standing}, kClearance_m, {3, 0, 0}, space);
    EXPECT_EQ(heuristic.is_cut_off(), low_y > -2.0);
  }
}

// Somebody comes along the tube: out of its other end and beside it.
TEST(StaticHeuristicTest, TheRefugeLiesBesideTheEndOfATube) {
  constexpr double kApart_m = 0.8;
  Sogm standing = tube(-1.5, 9);
  mark_box(&standing, {0.9, -9, -9}, {1.1, 9, 9});  // itself
  StaticHeuristic heuristic;
  heuristic.build_within({&standing}, kClearance_m, {0.05, 0.05, 0.05}, kFlat);
  const Vector3d other(1.0, 0, 0);
  const auto refuge = heuristic.refuge(kFlat, other, kApart_m);
  ASSERT_TRUE(refuge.has_value());
  EXPECT_TRUE(refuge->is_apart);
  EXPECT_LT(refuge->place.x(), -1.5);
  EXPECT_GT(refuge->place.x(), -3.0) << "no farther than it must";
  EXPECT_LT((refuge->way.front() - other).norm(), 1e-9);
  for (std::size_t i = 0; i + 1 < refuge->way.size(); ++i) {
    EXPECT_GE((refuge->way[i] - refuge->place).norm(), kApart_m);
    EXPECT_LT((refuge->way[i] - refuge->way[i + 1]).norm(), 0.5) << "from cell to cell";
  }
}

TEST(StaticHeuristicTest, WithoutARefugeItIsTheEndOfTheWay) {
  Sogm closed = tube(-9, 9);
  StaticHeuristic heuristic;
  mark_box(&closed, {0.3, -9, -9}, {0.6, 9, 9});  // whom it meets
  heuristic.build_within({&closed}, kClearance_m, {-0.45, 0.05, 0.05}, kFlat);
  const auto refuge = heuristic.refuge(kFlat, {0.45, 0, 0}, 0.8);
  ASSERT_TRUE(refuge.has_value());
  EXPECT_FALSE(refuge->is_apart);
  EXPECT_LT(refuge->place.x(), -3.5);
}

// Nothing stands in the window, but a wall behind its edge: the guidance knows.
TEST(StaticHeuristicTest, GoesOnAsTheGuidanceKnows) {
  const Sogm standing = empty_map({4, 4, 2}, 0.1, 1, Utime(), 100ms);
  Sogm wide = empty_map({16, 16, 2}, 0.1, 1, Utime(), 100ms);
  mark_box(&wide, {3.0, -4.5, -9}, {3.2, 99, 9});
  const Vector3d goal(5, 2, 0);
  Guidance guidance({}, {-6, -6, kLow}, {6, 6, kHigh});
  guidance.update(wide, wide, nullptr, goal, kClearance_m);
  ASSERT_FALSE(guidance.empty());
  StaticHeuristic heuristic;
  heuristic.build({&standing}, kClearance_m, goal, kSpace, &guidance);
  ASSERT_FALSE(heuristic.empty());
  const auto subgoal = heuristic.subgoal({0.05, 0.05, 0.05});
  ASSERT_TRUE(subgoal.has_value());
  EXPECT_LT(subgoal->position.y(), -1.6) << "down to the wall's end";
  heuristic.build({&standing}, kClearance_m, goal, kSpace, nullptr);
  EXPECT_TRUE(heuristic.empty());
}

TEST(StaticHeuristicTest, SaysNothingWhereNothingStands) {
  StaticHeuristic heuristic;
  const Guidance guidance({}, {-9, -9, -9}, {9, 9, 9});
  const Sogm standing = empty_map({2, 2, 2}, 0.1, 1, Utime(), 100ms);
  for (const Guidance* none : {static_cast<const Guidance*>(nullptr), &guidance}) {
    heuristic.build({&standing}, kClearance_m, Vector3d::Zero(), kEverywhere, none);
    EXPECT_TRUE(heuristic.empty());
    EXPECT_FALSE(heuristic.is_cut_off());
    EXPECT_FALSE(heuristic.subgoal({0, 0, 0}).has_value());
    EXPECT_EQ(heuristic.blocked(0, 0, 0, 0), 0u);
  }
  Sogm small = empty_map({0.1, 2, 2}, 0.1, 1, Utime(), 100ms);  // less than half a cell
  mark_box(&small, {-1, -1, -1}, {1, 1, 1});
  heuristic.build({&small}, kClearance_m, Vector3d::Zero(), kEverywhere, nullptr);
  EXPECT_TRUE(heuristic.empty());
}

}  // namespace
}  // namespace swarm
