// What is known to stand still: of a file, of windows seen one after the other, and how much of it is kept.
#include "planner_daemon/guidance/global_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "lcmtypes/bus/temporary_directory.h"
#include "tests/support/random_map.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr double kBlocked_m = 0.3;
const Vector3d kSpaceMin(-60, -60, -0.8), kSpaceMax(60, 60, 0.8), kHere(0.05, 0.05, 0.05);

// Around the robot; 12 m wide, so that its outer parts are not near.
Sogm window_at(const Vector3i& shift = Vector3i::Zero(), const Vector3d& size_m = {12, 12, 2}) {
  Sogm sogm = empty_map(size_m, 0.1, 4, Utime(), 200ms);
  sogm.geometry.origin += shift;
  return sogm;
}

// A column as wide as the robot, in all frames or some of them.
void mark_column(Sogm* sogm, double x, double y, int first = 0, int last = 99) {
  mark_box(sogm, {x - 0.2, y - 0.2, -9}, {x + 0.2, y + 0.2, 9}, first, last);
}

Sogm standing_of(const Sogm& sogm) {
  Sogm standing = sogm;
  standing.reset(sogm.geometry, 1, sogm.start_utime, sogm.frame_duration);
  const auto words = standing.words_to_write();
  for (std::size_t i = 0; i < words.size(); ++i) {
    words[i] = ~std::uint64_t{0};
    for (int frame = 0; frame < sogm.num_frames; ++frame) words[i] &= sogm.column(frame, 0, 0)[i];
  }
  return standing;
}

bool see(const Sogm& sogm, GlobalMap* map, const Vector3d& goal = kHere) {
  return map->see(sogm, standing_of(sogm), nullptr, goal, kBlocked_m);
}

bool knows(const GlobalMap& map, const Vector3d& place) {
  const GridGeometry& grid = map.blocked().geometry;
  return grid.contains(grid.voxel_of(place));
}

bool is_blocked(const GlobalMap& map, double x, double y, double z = 0.05) {
  const Sogm& blocked = map.blocked();
  EXPECT_TRUE(knows(map, {x, y, z}));
  return blocked.occupied(0, blocked.geometry.voxel_of({x, y, z}));
}

// Everywhere in the grid: blocked where something occupied is near, or beyond the flight space.
void expect_blocked_around(const Sogm& occupied, const GlobalMap& map, const Vector3d& space_min,
                           const Vector3d& space_max) {
  const Sogm& blocked = map.blocked();
  const GridGeometry& grid = blocked.geometry;
  int inside = 0, around = 0, wrong = 0;
  for_each_column(grid, [&](int x, int y) {
    for (int z = 0; z < grid.size.z(); ++z) {
      const Vector3d center = grid.center_of({x, y, z});
      const Vector3d out = (space_min - center).cwiseMax(center - space_max);
      if (std::abs(out.maxCoeff() - 0.05) < 1e-6) continue;  // the voxel touches the rim
      const bool leaves = out.maxCoeff() > 0.05;
      EXPECT_EQ(map.in_flight_space(Vector3i(x, y, z) + grid.origin), !leaves) << center.transpose();
      const bool near = distance_to_occupied(occupied, 0, center, kBlocked_m + 0.01) < kBlocked_m + 1e-6;
      around += near;
      inside += !leaves;
      if (blocked.occupied(0, {x, y, z}) != (near || leaves) && ++wrong <= 3)
        ADD_FAILURE() << center.transpose() << (near ? " is near" : leaves ? " is outside" : " is free");
    }
  });
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(around, 500);
  EXPECT_GT(inside, 5'000);
}

TEST(GlobalMapTest, WhatTheFileHoldsIsBlocked) {
  Rng rng(1);
  const TemporaryDirectory directory;
  const std::string path = directory / "map.bt";
  octomap::OcTree tree(0.1);
  Sogm occupied = window_at({100, 0, 0}, {8, 8, 2});  // not where the robot is
  for (int i = 0; i < 60; ++i) {
    const Vector3i voxel = Vector3i(uniform_int(rng, 5, 74), uniform_int(rng, 5, 74), uniform_int(rng, 0, 19));
    const Eigen::Vector3f center = occupied.geometry.center_of(voxel).cast<float>();
    tree.updateNode(octomap::point3d(center.x(), center.y(), center.z()), true);
    set_voxel(&occupied, 0, voxel);
  }
  tree.writeBinary(path);
  const Vector3d low(-6, -6, -0.73), high(12.43, 6, 0.81);
  GlobalMap map({path}, low, high);
  EXPECT_TRUE(map.empty()) << "the voxels are not known yet";
  EXPECT_TRUE(see(window_at(), &map));
  EXPECT_FALSE(map.empty());
  expect_blocked_around(occupied, map, low, high);
  EXPECT_FALSE(see(window_at(), &map)) << "nothing is new";
  map.forget_seen();
  EXPECT_FALSE(map.empty());
  expect_blocked_around(occupied, map, low, high);
}

TEST(GlobalMapTest, RefusesWhatIsNoOctoMap) {
  EXPECT_THROW(GlobalMap({"/nowhere.bt"}, kSpaceMin, kSpaceMax), std::runtime_error);
}

TEST(GlobalMapTest, TakesInWhatStandsStill) {
  Rng rng(2);
  const Vector3d low(-6, -6.5, -0.8), high(7, 6, 0.8);
  GlobalMap map({}, low, high);
  EXPECT_TRUE(map.empty());
  Sogm sogm = window_at();
  for (int i = 0; i < 15; ++i)
    mark_moving(&sogm, in_box(rng, {-5, -5, -1}, {5, 5, 1}), Vector3d::Zero(), uniform(rng, 0.05, 0.4), i % 2 == 0);
  EXPECT_TRUE(see(sogm, &map));
  EXPECT_FALSE(map.empty());
  expect_blocked_around(sogm, map, low, high);
  EXPECT_FALSE(see(sogm, &map));
  mark_column(&sogm, 5.0, 5.0);  // one more, where only columns nearby are worked out anew
  mark_column(&sogm, -1.0, 1.0);
  EXPECT_TRUE(see(sogm, &map));
  expect_blocked_around(sogm, map, low, high);
  map.forget_seen();
  EXPECT_TRUE(map.empty());
  EXPECT_FALSE(is_blocked(map, 5.0, 5.0));
}

// What is said to be occupied only because it was not seen is not learned; what is gone is forgotten wherever it is
// seen to be.
TEST(GlobalMapTest, LearnsOfWhatWasSeen) {
  GlobalMap map({}, kSpaceMin, kSpaceMax);
  Sogm sogm = window_at();
  for (const double x : {-4.5, -1.5, 1.5, 4.5}) mark_column(&sogm, x, 4.5);
  const auto see_where = [&](const auto& was_seen) {
    Sogm seen;
    seen.reset(sogm.geometry, 1, sogm.start_utime, sogm.frame_duration);
    for_each_column(sogm.geometry, [&](int x, int y) {
      if (was_seen(sogm.geometry.center_of({x, y, 0}))) set_run(0, 99, sogm.geometry.size.z(), seen.column(0, x, y));
    });
    Sogm standing = standing_of(sogm);
    for (std::size_t i = 0; i < standing.words().size(); ++i) standing.words_to_write()[i] &= seen.words()[i];
    return map.see(sogm, standing, &seen, kHere, kBlocked_m);
  };
  EXPECT_TRUE(see_where([](const Vector3d& place) { return place.x() < 0.0; }));
  for (const double x : {-4.5, -1.5}) EXPECT_TRUE(is_blocked(map, x, 4.5));
  for (const double x : {1.5, 4.5}) EXPECT_FALSE(is_blocked(map, x, 4.5));
  sogm = window_at();
  EXPECT_TRUE(see_where([](const Vector3d& place) { return place.x() < -3.0; }));
  EXPECT_FALSE(is_blocked(map, -4.5, 4.5));
  EXPECT_TRUE(is_blocked(map, -1.5, 4.5)) << "nobody looked";
}

// As walls and furniture do, above and below where somebody looked: where nobody did, and as long as it stands.
TEST(GlobalMapTest, WhatStandsGoesOnWhereNobodyLooked) {
  const Vector3d low(-4, -4, -3.3), high(4, 4, 3.3);  // two words
  GlobalMap map({}, low, high, /*explores=*/true);
  const Vector3d size_m(6, 6, 7);
  const auto see = [&](const std::vector<std::pair<double, double>>& stands, double from_z, double to_z) {
    Sogm sogm = window_at(Vector3i::Zero(), size_m), seen = sogm;
    for (const auto& [bottom, top] : stands) mark_box(&sogm, {1, 1, bottom}, {1.4, 1.4, top});
    mark_box(&seen, {-9, -9, from_z}, {9, 9, to_z});
    Sogm standing = standing_of(sogm);
    for (std::size_t i = 0; i < standing.words().size(); ++i) standing.words_to_write()[i] &= seen.words()[i];
    return map.see(sogm, standing, &seen, kHere, kBlocked_m);
  };
  const auto closed = [&](double z) { return is_blocked(map, 1.2, 1.2, z); };

  EXPECT_TRUE(see({{-0.5, 0.0}}, -0.5, 1.0)) << "with free space above it";
  EXPECT_TRUE(closed(-3.0) && closed(-0.2)) << "down to the floor";
  EXPECT_FALSE(closed(0.6) || closed(3.0)) << "and no higher";
  EXPECT_TRUE(see({{2.0, 2.3}}, 1.9, 2.3)) << "a lintel";
  EXPECT_TRUE(closed(2.2) && closed(3.0));
  EXPECT_FALSE(closed(0.6)) << "what was seen to be free stays so";
  ASSERT_NE(map.known(), nullptr);
  EXPECT_TRUE(map.known()->occupied(0, map.known()->geometry.voxel_of({1.2, 1.2, 3.0})));
  EXPECT_FALSE(see({{2.0, 2.3}}, 1.9, 2.3)) << "nothing is new";

  EXPECT_TRUE(see({}, -0.4, -0.2)) << "it is gone";
  EXPECT_FALSE(closed(-3.0) || closed(-0.3)) << "with all of it";
  EXPECT_TRUE(closed(3.0));
  EXPECT_TRUE(map.forget_seen());
  EXPECT_TRUE(see({{-0.5, 0.0}}, -0.5, 0.0));
  EXPECT_TRUE(closed(3.0)) << "nor what was seen to be free is remembered";
}

TEST(GlobalMapTest, WhoExploresFarOutsideTheFlightSpaceKnowsNothing) {
  GlobalMap map({}, {50, 50, -1}, {60, 60, 1}, /*explores=*/true);
  Sogm sogm = window_at(), seen = sogm;
  mark_box(&seen, {-9, -9, -9}, {9, 9, 9});
  EXPECT_FALSE(map.see(sogm, standing_of(sogm), &seen, kHere, kBlocked_m));
  EXPECT_EQ(map.known(), nullptr);
}

TEST(GlobalMapTest, WhatStandsDoesNotGoOnInAKnownBuildingNorWhereNobodyExplores) {
  const TemporaryDirectory directory;
  octomap::OcTree tree(0.1);
  tree.updateNode(octomap::point3d(-1.05F, -1.05F, 0.05F), true);
  tree.writeBinary(directory / "map.bt");
  for (const bool has_file : {true, false}) {
    SCOPED_TRACE(has_file);
    GlobalMap map(has_file ? std::string(directory / "map.bt") : "", kSpaceMin, kSpaceMax, /*explores=*/has_file);
    Sogm sogm = window_at(), seen = sogm;
    mark_box(&sogm, {1, 1, -0.6}, {1.4, 1.4, -0.4});
    mark_box(&seen, {-9, -9, -0.6}, {9, 9, -0.4});
    map.see(sogm, standing_of(sogm), &seen, kHere, kBlocked_m);
    EXPECT_TRUE(is_blocked(map, 1.2, 1.2, -0.35));
    EXPECT_FALSE(is_blocked(map, 1.2, 1.2, 0.35));
    EXPECT_EQ(map.known() != nullptr, has_file);
    EXPECT_EQ(is_blocked(map, -1.05, -1.05), has_file);
  }
}

// What moves covers and uncovers what stands behind it: next to it nothing is learned.
TEST(GlobalMapTest, LeavesOutWhereSomethingMoves) {
  GlobalMap map({}, kSpaceMin, kSpaceMax);
  Sogm sogm = window_at();
  mark_column(&sogm, -4.4, -4.4);
  mark_column(&sogm, 4.4, 4.4);
  for (int frame = 0; frame < 4; ++frame) mark_ball(&sogm, frame, {4.2 + 0.05 * frame, 4.4, 0}, 0.3);
  for (int frame = 0; frame < 4; ++frame) mark_ball(&sogm, frame, {-3.0 + 0.4 * frame, 4.4, 0}, 0.3);
  see(sogm, &map);
  EXPECT_TRUE(is_blocked(map, -4.4, -4.4));
  EXPECT_FALSE(is_blocked(map, 4.4, 4.4));
  for (double x = -4; x < 0; x += 0.1) EXPECT_FALSE(is_blocked(map, x, 4.4));
  Sogm later = window_at();
  mark_column(&later, -4.4, -4.4);
  mark_column(&later, 4.4, 4.4);
  EXPECT_TRUE(see(later, &map));
  EXPECT_TRUE(is_blocked(map, 4.4, 4.4));
  EXPECT_FALSE(see(sogm, &map)) << "now it is known";
  EXPECT_TRUE(is_blocked(map, 4.4, 4.4));
}

TEST(GlobalMapTest, ForgetsWhatIsGoneWhereTheRobotIsNear) {
  GlobalMap map({}, kSpaceMin, kSpaceMax);
  Sogm sogm = window_at();
  mark_column(&sogm, 1.2, 1.2);
  mark_column(&sogm, -1.2, 1.2);
  mark_column(&sogm, 4.5, 1.2);
  see(sogm, &map);
  for (const double x : {1.2, -1.2, 4.5}) EXPECT_TRUE(is_blocked(map, x, 1.2));
  Sogm gone = window_at();
  for (int frame = 0; frame < 4; ++frame) mark_ball(&gone, frame, {-1.5 + 0.2 * frame, 1.2, 0}, 0.2);
  EXPECT_TRUE(see(gone, &map));
  EXPECT_FALSE(is_blocked(map, 1.2, 1.2));
  EXPECT_TRUE(is_blocked(map, -1.2, 1.2)) << "something moves there: it may be behind it";
  EXPECT_TRUE(is_blocked(map, 4.5, 1.2)) << "it may be out of sight";
  EXPECT_TRUE(see(window_at({40, 0, 0}), &map)) << "the robot has come near";
  EXPECT_FALSE(is_blocked(map, 4.5, 1.2));
  EXPECT_TRUE(is_blocked(map, -1.2, 1.2)) << "now that is far";
  EXPECT_FALSE(map.empty());
  EXPECT_TRUE(see(window_at(), &map));
  EXPECT_FALSE(is_blocked(map, -1.2, 1.2));
  EXPECT_TRUE(map.empty());
}

// The window has another height each time; above and below it nothing is forgotten.
TEST(GlobalMapTest, ForgetsNothingAboveAndBelowTheWindow) {
  const Vector3d low(-4, -4, -4), high(4, 4, 4);
  GlobalMap map({}, low, high);
  Sogm sogm = window_at({0, 0, 0}, {6, 6, 6.6});  // two words
  mark_box(&sogm, {0.5, 0.5, -2.5}, {0.9, 0.9, -2.0});
  mark_box(&sogm, {0.5, 0.5, 0.0}, {0.9, 0.9, 0.5});
  mark_box(&sogm, {0.5, 0.5, 2.0}, {0.9, 0.9, 2.5});
  see(sogm, &map);
  expect_blocked_around(sogm, map, low, high);
  EXPECT_TRUE(see(window_at({0, 0, 3}, {6, 6, 2}), &map));
  EXPECT_TRUE(is_blocked(map, 0.7, 0.7, -2.25));
  EXPECT_FALSE(is_blocked(map, 0.7, 0.7, 0.25));
  EXPECT_TRUE(is_blocked(map, 0.7, 0.7, 2.25));
}

TEST(GlobalMapTest, GrowingItKeepsWhatItKnows) {
  GlobalMap map({}, kSpaceMin, kSpaceMax);
  Sogm sogm = window_at();
  mark_column(&sogm, 4.5, -4.5);
  see(sogm, &map);
  EXPECT_TRUE(knows(map, kHere));
  const Vector3d goal(50, -30, 0);
  EXPECT_FALSE(knows(map, goal));
  EXPECT_TRUE(see(window_at(), &map, goal));
  EXPECT_TRUE(knows(map, goal));
  EXPECT_TRUE(is_blocked(map, 4.5, -4.5));
  EXPECT_FALSE(is_blocked(map, goal.x(), goal.y()));
  for (int step = 1; step <= 12; ++step) {
    Sogm there = window_at({-37 * step, 11 * step, 0});
    mark_column(&there, -3.7 * step + 4.5, 1.1 * step + 4.5);
    see(there, &map);
    EXPECT_TRUE(knows(map, {-3.7 * step, 1.1 * step, 0}));
  }
  EXPECT_TRUE(is_blocked(map, 4.5, -4.5));
  for (int step = 1; step <= 12; ++step) EXPECT_TRUE(is_blocked(map, -3.7 * step + 4.5, 1.1 * step + 4.5)) << step;
  EXPECT_TRUE(knows(map, goal));
}

TEST(GlobalMapTest, TheGridReachesJustBeyondTheFlightSpace) {
  const Vector3d low(-2, -3, -0.5), high(2.5, 3, 0.5);
  GlobalMap map({}, low, high);
  Sogm sogm = window_at();
  mark_column(&sogm, 0.0, 0.0);
  see(sogm, &map, {900, 0, 0});  // out of the flight space: no reason to grow
  const GridGeometry& grid = map.blocked().geometry;
  EXPECT_LT(0.1 * grid.size.x(), 4.5 + 2 * 0.7);
  EXPECT_LT(0.1 * grid.size.z(), 1.0 + 2 * 0.7);
  EXPECT_TRUE(is_blocked(map, -2.3, 1.0));
  EXPECT_TRUE(is_blocked(map, 1.0, 1.0, 0.75));
  EXPECT_FALSE(is_blocked(map, -1.9, 1.0));
  expect_blocked_around(sogm, map, low, high);
  EXPECT_FALSE(see(window_at({900, 0, 0}), &map)) << "a robot far outside sees nothing of use";
}

TEST(GlobalMapTest, NeverGrowsBeyondItsBounds) {
  const Vector3d far_away(1e5, 1e5, 3);
  GlobalMap map({}, -far_away, far_away);
  Sogm sogm = window_at();
  mark_column(&sogm, 4.5, -4.5);
  for (const Vector3d& goal : {Vector3d(1e4, 0, 0), Vector3d(7e3, -7e3, 0), Vector3d(1e30, 0, 0)}) {
    see(sogm, &map, goal);
    EXPECT_LE(map.blocked().geometry.size.cast<double>().prod(), GlobalMap::kMaxVoxels);
    EXPECT_FALSE(knows(map, goal));
    EXPECT_TRUE(is_blocked(map, 4.5, -4.5));
  }
  // Wherever the robot comes, it knows what is around it.
  see(window_at({60'000, 50'000, 0}), &map, {1e4, 0, 0});
  EXPECT_LE(map.blocked().geometry.size.cast<double>().prod(), GlobalMap::kMaxVoxels);
  EXPECT_TRUE(knows(map, {6000, 5000, 0}));
}

// Voxels of another size: what was seen in the others is gone.
TEST(GlobalMapTest, StartsAnewWithOtherVoxels) {
  GlobalMap map({}, kSpaceMin, kSpaceMax);
  Sogm sogm = window_at();
  mark_column(&sogm, 4.5, -4.5);
  see(sogm, &map);
  const Sogm coarse = empty_map({12, 12, 2}, 0.2, 4, Utime(), 200ms);
  EXPECT_TRUE(see(coarse, &map));
  EXPECT_EQ(map.blocked().geometry.resolution_m, 0.2);
  EXPECT_TRUE(map.empty());
  EXPECT_FALSE(is_blocked(map, 4.5, -4.5));
}

}  // namespace
}  // namespace swarm
