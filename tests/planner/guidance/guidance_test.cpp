// The ways it knows against a plain Dijkstra search through what is blocked.
#include "planner_daemon/guidance/guidance.h"

#include <gtest/gtest.h>

#include <string>

#include "lcmtypes/bus/temporary_directory.h"
#include "tests/support/plain_ways.h"
#include "tests/support/random_map.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr double kApart_m = 0.5, kVoxel_m = 0.4;  // large voxels: the plain search is slow
constexpr int kUnreached = Wavefront::kUnreached;
const Vector3d kLowest(-30, -30, -0.9), kHighest(30, 30, 0.9), kGoal(5.1, 0.1, 0.1);

Sogm window() {
  return empty_map({14.4, 14.4, 2}, kVoxel_m, 1, Utime(), 200ms);
}

// Across the window at x = 0; with a door beside the straight way.
Sogm walled(bool has_door) {
  Sogm sogm = window();
  mark_box(&sogm, {-0.3, -9, -9}, {0.3, has_door ? 3.0 : 9, 9});
  if (has_door) mark_box(&sogm, {-0.3, 5.4, -9}, {0.3, 9, 9});
  return sogm;
}

// And the map by itself: what is blocked is tested elsewhere.
struct Guide {
  Guide(const Vector3d& low, const Vector3d& high, const std::string& file = "")
      : guidance({file}, low, high), map({file}, low, high) {}

  void update(const Sogm& sogm, const Vector3d& goal) {
    guidance.update(sogm, sogm, nullptr, goal, kApart_m);
    map.see(sogm, sogm, nullptr, goal, kApart_m);
  }
  void work(int times) {
    for (int i = 0; i < times; ++i) guidance.work();
  }
  int cost_at(const Vector3d& place) const {
    return guidance.cost((place / kVoxel_m).array().floor().matrix().cast<int>());
  }

  Guidance guidance;
  GlobalMap map;
};

// From everywhere in the grid: the least of the cell of two voxels' edge, to the goal, or where that is not in the
// grid, to its edge and straight on. How many voxels are reached.
int expect_plain_ways(const Guide& guide, const Vector3d& goal) {
  const Sogm& blocked = guide.map.blocked();
  const GridGeometry& grid = blocked.geometry;
  PlainWays ways(grid.size);
  ways.for_each_voxel([&](const Vector3i& v) { ways.open[ways.index(v)] = !blocked.occupied(0, v); });
  const Vector3i goal_voxel = grid.voxel_of(goal);
  ways.seed_goal(goal_voxel, 0.8 / grid.resolution_m);
  if (!grid.contains(goal_voxel))
    ways.seed_edge([&](const Vector3i& v) { return Wavefront::straight_cost(v - goal_voxel); });
  ways.search();
  int reached = 0, wrong = 0;
  ways.for_each_voxel([&](const Vector3i& v) {
    const int expected = ways.cell_cost(v / 2, 2), found = guide.guidance.cost(v + grid.origin);
    reached += expected != kUnreached;
    if (found != expected && ++wrong <= 3) ADD_FAILURE() << v.transpose() << ": " << found << ", not " << expected;
  });
  EXPECT_EQ(wrong, 0);
  return reached;
}

TEST(GuidanceTest, TheWayIsStraightWhereNothingStands) {
  Guide guide(kLowest, kHighest);
  EXPECT_TRUE(guide.guidance.empty());
  guide.update(window(), kGoal);
  EXPECT_TRUE(guide.guidance.empty());
  EXPECT_EQ(guide.guidance.straight_cost({12, 0, 0}), 0);
  EXPECT_EQ(guide.guidance.straight_cost({2, 4, 1}), 6 * 10 + 4 * 11);
  guide.work(10);
  EXPECT_TRUE(guide.guidance.empty());
}

TEST(GuidanceTest, LeadsThroughTheDoor) {
  Guide guide(kLowest, kHighest);
  guide.update(walled(true), kGoal);
  ASSERT_FALSE(guide.guidance.empty());
  EXPECT_GT(expect_plain_ways(guide, kGoal), 10'000);
  // Around the wall's ends it is longer, for nothing is known to stand there.
  EXPECT_GT(guide.cost_at({-3, 0, 0}), guide.guidance.straight_cost({-8, 0, 0}) + 10);
  EXPECT_EQ(guide.cost_at({2, 0, 0}), guide.guidance.straight_cost({5, 0, 0}));
}

// Of goals inside the wall too: the way ends beside it.
TEST(GuidanceTest, EqualsAPlainDijkstraSearch) {
  Rng rng(1);
  for (int trial = 0; trial < 6; ++trial) {
    Guide guide({-9, -9, -0.9}, {9, 9, 0.9});
    Sogm sogm = window();
    for (int i = 0; i < 25; ++i)
      mark_ball(&sogm, 0, in_box(rng, {-7, -7, -1}, {7, 7, 1}), uniform(rng, 0.1, 0.9), i % 2 == 0);
    const Vector3d goal = in_box(rng, {-7, -7, -0.9}, {7, 7, 0.9});
    guide.update(sogm, goal);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", goal " << goal.transpose());
    EXPECT_GT(expect_plain_ways(guide, goal), 0);
  }
}

TEST(GuidanceTest, AnotherGoalIsServedAtOnce) {
  Guide guide(kLowest, kHighest);
  guide.update(walled(true), kGoal);
  for (const Vector3d& goal : {Vector3d(-5.1, -2.1, 0.1), Vector3d(25.1, 11.1, 0.1), kGoal}) {
    guide.update(walled(true), goal);
    expect_plain_ways(guide, goal);
  }
  // Also while it works on what changed.
  guide.update(walled(false), kGoal);
  guide.work(1);
  guide.update(walled(false), {-5.1, -2.1, 0.1});
  expect_plain_ways(guide, {-5.1, -2.1, 0.1});
  guide.work(1000);
  expect_plain_ways(guide, {-5.1, -2.1, 0.1});
}

TEST(GuidanceTest, AnotherMapIsServedAfterSomeWork) {
  Guide guide(kLowest, kHighest);
  guide.update(walled(true), kGoal);
  const Vector3d there(-3, 3.9, 0);
  const int through = guide.cost_at(there);
  guide.update(walled(false), kGoal);
  EXPECT_EQ(guide.cost_at(there), through) << "what there is serves on";
  int portions = 0;
  for (; portions < 1000 && guide.cost_at(there) == through; ++portions) guide.work(1);
  EXPECT_GT(portions, 1);
  EXPECT_LT(portions, 1000);
  EXPECT_GT(guide.cost_at(there), through);
  expect_plain_ways(guide, kGoal);
  // What changes while it works comes next.
  Guide busy(kLowest, kHighest);
  busy.update(walled(true), kGoal);
  busy.update(walled(false), kGoal);
  busy.work(1);
  Sogm more = walled(false);
  mark_box(&more, {2, -1, -9}, {2.8, 1, 9});
  for (int i = 0; i < 3; ++i) {
    busy.update(more, kGoal);
    busy.work(1000);
  }
  expect_plain_ways(busy, kGoal);
}

// The first thing that is known to stand anywhere.
TEST(GuidanceTest, TheWayIsStraightUntilItIsKnown) {
  Guide guide(kLowest, kHighest);
  guide.update(window(), kGoal);
  guide.update(walled(true), kGoal);
  EXPECT_TRUE(guide.guidance.empty());
  guide.work(1000);
  EXPECT_FALSE(guide.guidance.empty());
  expect_plain_ways(guide, kGoal);
}

// It may be gone since.
TEST(GuidanceTest, ForgetsWhatItSawWhereThatClosesTheWay) {
  Guide guide({-30, -5, -0.9}, {30, 5, 0.9});
  const Vector3d place(-4.1, 0.1, 0.1);
  guide.update(walled(false), kGoal);
  guide.work(1000);
  ASSERT_EQ(guide.cost_at(place), kUnreached);
  Sogm away = window();  // beside the wall: it is not seen any more
  away.geometry.origin.x() -= 36;
  for (const bool is_cut_off : {false, true}) {
    guide.guidance.reconsider(is_cut_off ? place : kGoal);
    guide.update(away, kGoal);
    guide.work(1000);
    EXPECT_EQ(guide.guidance.empty(), is_cut_off);
  }
}

// Too far for the map to hold it: in at the edge, and straight on from there.
TEST(GuidanceTest, AGoalOutsideTheMapIsReachedFromItsEdge) {
  Guide guide({-9e3, -9e3, -0.9}, {9e3, 9e3, 0.9});
  const Vector3d goal(1600, 1100, 0);
  guide.update(walled(true), goal);
  ASSERT_FALSE(guide.guidance.empty());
  EXPECT_GT(expect_plain_ways(guide, goal), 10'000);
  EXPECT_EQ(guide.guidance.cost({7000, 5000, 0}), guide.guidance.straight_cost({7000, 5000, 0}))
      << "beyond what is known";
  EXPECT_EQ(guide.guidance.cost({7000, 5000, 9}), kUnreached) << "above the flight space";
}

TEST(GuidanceTest, FromOutsideAnEnclosureThereIsNoWay) {
  Guide guide(kLowest, kHighest);
  Sogm sogm = window();
  for (const double side : {-2.2, 2.2}) {
    mark_box(&sogm, {3.0 + side - 0.3, -2.5, -9}, {3.0 + side + 0.3, 2.5, 9});
    mark_box(&sogm, {0.5, side - 0.3, -9}, {5.5, side + 0.3, 9});
  }
  const Vector3d goal(3.1, 0.1, 0.1);
  guide.update(sogm, goal);
  EXPECT_EQ(guide.cost_at({-3, 0, 0}), kUnreached);
  EXPECT_EQ(guide.cost_at({3, 4, 0}), kUnreached);
  EXPECT_EQ(guide.cost_at(goal), 0);
  EXPECT_GT(expect_plain_ways(guide, goal), 0);
  EXPECT_TRUE(guide.guidance.is_unreachable({-3, 0, 0}));
  EXPECT_FALSE(guide.guidance.is_unreachable({2.1, 0.1, 0.1})) << "in there with it";
}

TEST(GuidanceTest, SaysWhichGoalsCannotBeReached) {
  Guide guide({-9, -9, -0.9}, {9, 9, 0.9});
  const auto is_unreachable = [&](const Vector3d& goal) {
    guide.update(walled(true), goal);
    return guide.guidance.is_unreachable({-5.1, 0.1, 0.1});
  };
  EXPECT_FALSE(guide.guidance.is_unreachable({-5.1, 0.1, 0.1})) << "there is no goal yet";
  EXPECT_FALSE(is_unreachable(kGoal));
  EXPECT_TRUE(is_unreachable({0.1, 0.1, 0.1})) << "inside the wall";
  EXPECT_FALSE(is_unreachable({0.9, 0.1, 0.1})) << "beside it";
  EXPECT_TRUE(is_unreachable({5.1, 0.1, 2.1})) << "above the flight space";
  EXPECT_TRUE(is_unreachable({5.1, 11.1, 0.1})) << "beside the flight space";
  EXPECT_FALSE(is_unreachable({5.1, 0.1, 0.1}));
}

// What stands still far away is known from the file before it comes into sight.
TEST(GuidanceTest, KnowsTheWayThroughTheFile) {
  const TemporaryDirectory directory;
  const std::string path = directory / "map.bt";
  octomap::OcTree tree(0.4);
  for (float y = -7.8f; y < 4; y += 0.4f) {
    for (float z = -1.8f; z < 2; z += 0.4f) tree.updateNode(octomap::point3d(13.0f, y, z), true);
  }
  tree.writeBinary(path);
  Guide guide({-9, -8, -0.9}, {30, 8, 0.9}, path);
  const Vector3d goal(20.1, 0.1, 0.1);
  guide.update(window(), goal);
  EXPECT_GT(expect_plain_ways(guide, goal), 5'000);
  EXPECT_GT(guide.cost_at({10.1, 0.1, 0.1}), guide.guidance.straight_cost({25, 0, 0}) + 30);
}

}  // namespace
}  // namespace swarm
