// Walls against the distance to the leaves of a tree, one by one.
#include "planner_daemon/space/walls.h"

#include <gtest/gtest.h>
#include <octomap/OcTree.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "lcmtypes/bus/temporary_directory.h"
#include "tests/support/random_map.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr double kRadius_m = 0.2;

struct Scene {
  std::vector<Vector3d> leaves;  // middles
  double edge_m;

  double distance(const Vector3d& place) const {
    double least = 1e9;
    for (const Vector3d& leaf : leaves)
      least = std::min(least, ((place - leaf).cwiseAbs().array() - edge_m / 2).max(0.0).matrix().norm());
    return least;
  }
};

Scene write_scene(double edge_m, Rng& rng, const std::string& path) {
  Scene scene{{}, edge_m};
  octomap::OcTree tree(edge_m);
  for (int i = 0; i < 40; ++i) {
    const Vector3d at = in_box(rng, {-1.5, -1.5, -1}, {1.5, 1.5, 1});
    const octomap::point3d point(static_cast<float>(at.x()), static_cast<float>(at.y()), static_cast<float>(at.z()));
    tree.updateNode(point, true);
    const octomap::point3d middle = tree.keyToCoord(tree.coordToKey(point));
    scene.leaves.emplace_back(middle.x(), middle.y(), middle.z());
  }
  EXPECT_TRUE(tree.writeBinary(path));
  return scene;
}

// Wherever a touch is possible it says so, and not where there is half a voxel of room more.
TEST(Walls, TellsWhereTheRobotMayTouch) {
  Rng rng(11);
  const TemporaryDirectory directory;
  for (const double edge_m : {0.05, 0.08, 0.1, 0.17}) {
    const std::string path = (directory.path() / "walls.bt").string();
    const Scene scene = write_scene(edge_m, rng, path);
    Walls walls(path, kRadius_m);
    EXPECT_FALSE(walls.empty());
    for (const double resolution_m : {0.1, 0.06}) {
      walls.set_resolution(resolution_m);
      int touched = 0, free = 0;
      for (int i = 0; i < 20'000; ++i) {
        const Vector3d place = in_box(rng, {-2, -2, -1.5}, {2, 2, 1.5});
        const bool meets = walls.meet(place);
        const double distance_m = scene.distance(place);
        if (distance_m < kRadius_m) {
          ASSERT_TRUE(meets) << place.transpose() << ", " << distance_m << " m";
          ++touched;
        }
        if (distance_m > kRadius_m + resolution_m) {
          ASSERT_FALSE(meets) << place.transpose() << ", " << distance_m << " m";
          ++free;
        }
      }
      EXPECT_GT(touched, 500);
      EXPECT_GT(free, 500);
    }
  }
}

// A door of 0.6 m is open in its middle, and keeps the robot 0.05 m from its posts.
TEST(Walls, ADoorIsOpenInItsMiddle) {
  const TemporaryDirectory directory;
  const std::string path = (directory.path() / "door.bt").string();
  octomap::OcTree tree(0.1);
  for (int y = -10; y < 10; ++y) {
    if (y >= -3 && y < 3) continue;
    for (int z = -10; z < 10; ++z) {
      const auto middle = [](int k) { return static_cast<float>(k + 0.5) * 0.1f; };
      tree.updateNode(octomap::point3d(0.05f, middle(y), middle(z)), true);
    }
  }
  ASSERT_TRUE(tree.writeBinary(path));
  Walls walls(path, kRadius_m);
  walls.set_resolution(0.1);
  for (double y = -0.29; y < 0.3; y += 0.02) EXPECT_EQ(walls.meet({0.05, y, 0.0}), std::abs(y) > 0.05) << y;
}

// Beside a wall along the lattice, and past its edges and corners: no voxel on the way is closed all through. And a
// door that is open in its middle remains so.
TEST(Walls, WaysLeadThroughNoVoxelThatAWallCloses) {
  const TemporaryDirectory directory;
  const std::string path = (directory.path() / "cube.bt").string();
  for (const double voxel_m : {0.08, 0.1, 0.13}) {
    octomap::OcTree tree(voxel_m);
    const auto middle = static_cast<float>(voxel_m / 2);
    tree.updateNode(octomap::point3d(middle, middle, middle), true);
    ASSERT_TRUE(tree.writeBinary(path));
    for (const double radius_m : {0.1, 0.15, 0.2, 0.3}) {
      Walls walls(path, radius_m);
      walls.set_resolution(voxel_m);
      int open = 0, closed = 0;
      const auto is_closed = [&](int x, int y, int z) {
        bool all = true;
        for (int k = 0; k < 8; ++k) all = all && walls.meet(2 * x + k % 2, 2 * y + k / 2 % 2, 2 * z + k / 4);
        return all;
      };
      for (int x = -8; x <= 8; ++x) {
        for (int y = -8; y <= 8; ++y) {
          for (int z = -8; z <= 8; ++z) {
            const bool is_way = Vector3d(x, y, z).norm() * voxel_m > walls.way_m();
            open += is_way;
            closed += !is_way;
            EXPECT_FALSE(is_way && is_closed(x, y, z)) << x << " " << y << " " << z;
          }
        }
      }
      EXPECT_GT(open, closed);
      int first = 1;  // voxel beside a wall whose middle is free
      while ((first - 0.5) * voxel_m < radius_m + std::sqrt(3.0) / 4 * voxel_m + 0.005) ++first;
      EXPECT_LT(walls.way_m(), first * voxel_m) << "a door would be closed";
    }
  }
}

// Where there is no file, what is seen counts, as it is seen last: a surface lies somewhere inside its cube.
TEST(Walls, WhatIsSeenIsAWallWithoutAFile) {
  Rng rng(12);
  Sogm seen;
  seen.reset({.resolution_m = 0.1, .origin = {-20, -20, -10}, .size = {40, 40, 20}}, 2, Utime(), 1us);
  Walls walls("", kRadius_m);
  walls.set_resolution(0.1);
  for (int look = 0; look < 3; ++look) {
    Scene scene{{}, 0.1};
    std::ranges::fill(seen.words_to_write(), 0);
    for (int i = 0; i < 40; ++i) {
      const Vector3d at = in_box(rng, {-1.5, -1.5, -0.9}, {1.5, 1.5, 0.9});
      const Vector3i voxel = seen.geometry.voxel_of(at);
      seen.column(0, voxel.x(), voxel.y())[0] |= std::uint64_t{1} << voxel.z();
      scene.leaves.push_back(seen.geometry.center_of(voxel));
      seen.column(1, voxel.y(), voxel.x())[0] |= 1;  // what was not seen is no wall
    }
    walls.see(&seen);
    ASSERT_FALSE(walls.empty());
    int touched = 0, free = 0;
    for (int i = 0; i < 20'000; ++i) {
      const Vector3d place = in_box(rng, {-2, -2, -1.5}, {2, 2, 1.5});
      const double distance_m = scene.distance(place);
      if (distance_m < kRadius_m - 0.025) {
        ASSERT_TRUE(walls.meet(place)) << place.transpose() << ", " << distance_m << " m";
        ++touched;
      }
      if (distance_m > kRadius_m + 0.065) {
        ASSERT_FALSE(walls.meet(place)) << place.transpose() << ", " << distance_m << " m";
        ++free;
      }
    }
    EXPECT_GT(touched, 500);
    EXPECT_GT(free, 500);
  }
  walls.see(nullptr);
  EXPECT_TRUE(walls.empty());
}

TEST(Walls, AFileSaysMoreThanWhatIsSeen) {
  const TemporaryDirectory directory;
  const std::string path = (directory.path() / "cube.bt").string();
  octomap::OcTree tree(0.1);
  tree.updateNode(octomap::point3d(0.05f, 0.05f, 0.05f), true);
  ASSERT_TRUE(tree.writeBinary(path));
  Walls walls(path, kRadius_m);
  walls.set_resolution(0.1);
  Sogm seen;
  seen.reset({.resolution_m = 0.1, .origin = {-20, -20, -10}, .size = {40, 40, 20}}, 2, Utime(), 1us);
  seen.column(0, 30, 20)[0] |= std::uint64_t{1} << 10;
  walls.see(&seen);
  EXPECT_TRUE(walls.meet(Vector3d(0.05, 0.05, 0.2)));
  EXPECT_FALSE(walls.meet(Vector3d(1.05, 0.05, 0.05)));
}

TEST(Walls, WithoutAFileThereAreNone) {
  EXPECT_TRUE(Walls("", kRadius_m).empty());
  EXPECT_THROW(Walls("/nonexistent.bt", kRadius_m), std::runtime_error);
}

}  // namespace
}  // namespace swarm
