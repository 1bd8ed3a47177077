// What a robot keeps of what it saw, against voxels kept one by one, and against OctoMap's own reader.
#include "map_daemon/perception/kept_map.h"

#include <gtest/gtest.h>
#include <octomap/OcTree.h>

#include <fstream>
#include <map>
#include <random>
#include <stdexcept>
#include <string>

#include "lcmtypes/bus/temporary_directory.h"
#include "map_daemon/octomap_file.h"
#include "map_daemon/perception/map_file.h"

namespace swarm {
namespace {

constexpr double kKept_m = 0.1;

struct Less {
  bool operator()(const Eigen::Vector3i& a, const Eigen::Vector3i& b) const {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  }
};
using PlainMap = std::map<Eigen::Vector3i, bool, Less>;  // occupied or free, by the voxels of the lattice

octomap::point3d point_of(const Eigen::Vector3i& voxel) {
  const Eigen::Vector3f middle = ((voxel.cast<double>().array() + 0.5) * kKept_m).matrix().cast<float>();
  return {middle.x(), middle.y(), middle.z()};
}

// By OctoMap's own reader, not by ours.
PlainMap read_by_octomap(const std::string& bytes) {
  const TemporaryDirectory directory("kept_map_test");
  const std::string path = (directory.path() / "map.bt").string();
  std::ofstream(path, std::ios::binary) << bytes;
  octomap::OcTree tree(1.0);
  EXPECT_TRUE(tree.readBinary(path));
  EXPECT_EQ(tree.calcNumNodes(), tree.size());
  PlainMap map;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    const int edge = 1 << (tree.getTreeDepth() - leaf.getDepth());
    const octomap::OcTreeKey key = leaf.getIndexKey();
    for (int i = 0; i < edge * edge * edge; ++i) {
      const Eigen::Vector3i voxel = Eigen::Vector3i(key[0], key[1], key[2]).array() - (1 << 15) +
                                    Eigen::Array3i(i / edge / edge, i / edge % edge, i % edge);
      map[voxel] = tree.isNodeOccupied(*leaf);
    }
  }
  return map;
}

Sogm seen_space(const Eigen::Vector3i& origin) {
  Sogm sogm;
  sogm.reset({kKept_m, origin, {FreeSpaceGrid::kEdge, FreeSpaceGrid::kEdge, FreeSpaceGrid::kHeight}}, 2, Utime(), 1us);
  for (int x = 0; x < FreeSpaceGrid::kEdge; ++x)
    for (int y = 0; y < FreeSpaceGrid::kEdge; ++y) *sogm.column(1, x, y) = ~std::uint64_t{0};  // nothing was seen
  return sogm;
}
void see(Sogm* sogm, const Eigen::Vector3i& voxel, bool occupied) {
  const Eigen::Vector3i at = voxel - sogm->geometry.origin;
  const std::uint64_t bit = std::uint64_t{1} << at.z();
  *sogm->column(1, at.x(), at.y()) &= ~bit;
  if (occupied) *sogm->column(0, at.x(), at.y()) |= bit;
}

TEST(KeptMap, KeepsTheNewestOfEachVoxelWhereverTheWindowWas) {
  std::mt19937 random(3);
  const auto number = [&](int low, int high) { return std::uniform_int_distribution(low, high)(random); };
  KeptMap kept(kKept_m);
  PlainMap plain;
  for (int step = 0; step < 30; ++step) {
    const Eigen::Vector3i origin(number(-300, 100), number(-300, 100), number(-150, 60));
    Sogm sogm = seen_space(origin);
    std::map<Eigen::Vector3i, bool, Less> now;
    for (int i = 0; i < 2'000; ++i)
      now[origin + Eigen::Vector3i(number(0, 127), number(0, 127), number(0, 63))] = number(0, 2) == 0;
    // And a whole room, so that there are leaves of many sizes.
    const Eigen::Vector3i room = origin + Eigen::Vector3i(number(0, 80), number(0, 80), number(0, 30));
    for (int i = 0; i < 32 * 32 * 32; ++i) now[room + Eigen::Vector3i(i / 1024, i / 32 % 32, i % 32)] = step % 4 == 0;
    for (const auto& [voxel, occupied] : now) see(&sogm, voxel, occupied);
    kept.learn(sogm);
    for (const auto& [voxel, occupied] : now) plain[voxel] = occupied;
  }
  EXPECT_FALSE(kept.is_full());
  const PlainMap written = read_by_octomap(kept.to_octomap());
  EXPECT_EQ(written.size(), plain.size());
  EXPECT_TRUE(written == plain);
}

TEST(KeptMap, IsTheSameAfterItWasWrittenAndRead) {
  Sogm sogm = seen_space({-40, 7, -20});
  for (int z = -20; z < 44; ++z)
    for (int i = 0; i < 100; ++i) see(&sogm, {-40 + i, 40, z}, i % 3 != 0 || z > 10);
  KeptMap kept(kKept_m);
  kept.learn(sogm);
  const TemporaryDirectory directory("kept_map_test");
  MapFile file(directory.path() / "map.bt");
  EXPECT_EQ(file.read(kKept_m).blocks(), 0u) << "there is none yet";
  file.write(kept);
  EXPECT_EQ(file.written(), 1);
  const KeptMap again = file.read(kKept_m);
  EXPECT_EQ(again.blocks(), kept.blocks());
  EXPECT_EQ(again.to_octomap(), kept.to_octomap());
}

TEST(KeptMap, AnEmptyOneIsAFileAsWell) {
  const TemporaryDirectory directory("kept_map_test");
  MapFile file(directory.path() / "map.bt");
  file.write(KeptMap(kKept_m));
  EXPECT_EQ(file.read(kKept_m).blocks(), 0u);
}

TEST(KeptMap, LeavesOfATreeAreReadWithAllTheirVoxels) {
  octomap::OcTree tree(kKept_m);
  for (int i = 0; i < 16 * 16 * 16; ++i)
    tree.updateNode(point_of({i / 256 - 16, i / 16 % 16, i % 16 + 56}), i / 256 >= 8);
  tree.toMaxLikelihood();
  tree.prune();
  ASSERT_LT(tree.getNumLeafNodes(), 100u);
  const PlainMap map = read_by_octomap(KeptMap(tree, "tree", kKept_m).to_octomap());
  ASSERT_EQ(map.size(), 4096u);
  for (const auto& [voxel, occupied] : map) EXPECT_EQ(occupied, voxel.x() >= -8) << voxel.transpose();
}

TEST(KeptMap, WhatCannotBeKeptIsNamed) {
  const auto fault_of = [](const auto& call) {
    try {
      (void)call();
      return std::string();
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
  };
  octomap::OcTree coarse(0.2);
  coarse.updateNode(octomap::point3d(0, 0, 0), true);
  EXPECT_EQ(fault_of([&] { return KeptMap(coarse, "a.bt", kKept_m); }),
            "'a.bt' has voxels of 0.2 m; a map that is kept must have voxels of 0.1 m");
  octomap::OcTree large(kKept_m);
  for (int i = 0; i < 40'000; ++i) large.updateNode(point_of({8 * (i % 200), 8 * (i / 200), 0}), true);
  EXPECT_EQ(fault_of([&] { return KeptMap(large, "b.bt", kKept_m); }),
            "'b.bt' is too large to be kept: more than 32768 blocks of 8 x 8 x 64 voxels");
  EXPECT_EQ(fault_of([&] { return MapFile("map.ot").read(kKept_m); }), "'map.ot': a map is kept in a .bt file");
  EXPECT_EQ(fault_of([&] { return MapFile("/nowhere/at/all/map.bt").read(kKept_m); }),
            "'/nowhere/at/all/map.bt' cannot be written: there is no directory /nowhere/at/all");
  const TemporaryDirectory directory("kept_map_test");
  const std::string damaged = (directory.path() / "map.bt").string();
  std::ofstream(damaged) << "# Octomap OcTree binary file\nid OcTree\nsize 9\nres 0.1\ndata\nx";
  EXPECT_EQ(fault_of([&] { return MapFile(damaged).read(kKept_m); }), "'" + damaged + "' is cut short");
}

TEST(KeptMap, HoldsNoMoreThanThereIsRoomFor) {
  KeptMap kept(kKept_m);
  int windows = 0;
  for (; windows < 200 && !kept.is_full(); ++windows) {
    Sogm sogm = seen_space({128 * windows, 0, 0});
    for (int i = 0; i < 128 * 128; ++i) see(&sogm, {128 * windows + i % 128, i / 128, 3}, false);
    kept.learn(sogm);
  }
  EXPECT_EQ(windows, 129);
  EXPECT_EQ(kept.blocks(), KeptMap::kMaxBlocks);
}

TEST(KeptMap, WhatCannotBeWrittenIsSaidAndTheOldFileStays) {
  const TemporaryDirectory directory("kept_map_test");
  const std::filesystem::path path = directory.path() / "map.bt";
  std::filesystem::create_directories(path / "it is a directory");
  MapFile file(path);
  ASSERT_TRUE(file.begin_writing(KeptMap(kKept_m)));
  file.finish();
  EXPECT_TRUE(file.has_failed());
  EXPECT_EQ(file.written(), 0);
  EXPECT_FALSE(file.is_writing());
  EXPECT_TRUE(std::filesystem::exists(path / "it is a directory"));
}

// What stood stands where the window knows nothing else, and is gone once it is seen to be free.
TEST(KeptMap, WhatStoodStandsUntilItIsSeenToBeGone) {
  const Eigen::Vector3d origin(3.05, -2.05, 1.25), wall(5.05, -2.05, 1.25), other(3.05, 1.05, 1.25);
  FreeSpaceGrid grid(kKept_m, 10s);
  grid.move_to(origin);
  const auto voxel_of = [&](const Eigen::Vector3d& place) {
    return Eigen::Vector3i(grid.geometry().voxel_of(place) + grid.geometry().origin);
  };
  Sogm sogm = seen_space(grid.geometry().origin);
  see(&sogm, voxel_of(wall), true);
  see(&sogm, voxel_of(other), true);
  KeptMap kept(kKept_m);
  kept.learn(sogm);

  const auto stands = [&](const Eigen::Vector3d& place, auto what) {
    const Eigen::Vector3i at = grid.geometry().voxel_of(place);
    return ((grid.*what)(grid.column_of(at.x(), at.y())) >> at.z() & 1) != 0;
  };
  grid.move_to(origin + Eigen::Vector3d(0.3, -0.2, 0.7));
  kept.recall(&grid);
  EXPECT_TRUE(stands(wall, &FreeSpaceGrid::occupied));
  EXPECT_TRUE(stands(other, &FreeSpaceGrid::occupied));
  EXPECT_TRUE(stands(wall, &FreeSpaceGrid::lasting)) << "it has been there for long";
  EXPECT_FALSE(stands(wall, &FreeSpaceGrid::seen));
  grid.see_free(origin, wall + Eigen::Vector3d(0.5, 0, 0));
  grid.finish(Utime(100s), Doubt::kEverywhere);
  EXPECT_FALSE(stands(wall, &FreeSpaceGrid::occupied));
  kept.recall(&grid);
  EXPECT_FALSE(stands(wall, &FreeSpaceGrid::occupied)) << "the grid knows better";
  EXPECT_TRUE(stands(other, &FreeSpaceGrid::occupied));
}

}  // namespace
}  // namespace swarm
