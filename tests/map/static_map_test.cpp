// OctoMap files into bit grids, against brute force over the leaves of small random trees.
#include "map_daemon/static_map.h"

#include <gtest/gtest.h>
#include <octomap/ColorOcTree.h>
#include <octomap/OcTree.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>

#include "map_daemon/octomap_file.h"

namespace swarm {
namespace {

namespace fs = std::filesystem;

class StaticMapTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string name = ::testing::UnitTest::GetInstance()->current_test_info()->name();
    directory_ = fs::temp_directory_path() / ("static_map_test_" + name + "_" + std::to_string(::getpid()));
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }

  std::string path(const std::string& name) const { return (directory_ / name).string(); }

  std::string write(const std::string& name, const std::string& content) const {
    std::ofstream(path(name), std::ios::binary) << content;
    return path(name);
  }

  fs::path directory_;
};

// Single voxels and a block that prunes to larger leaves, with free space around.
octomap::OcTree random_tree(double leaf_m, std::mt19937* rng) {
  octomap::OcTree tree(leaf_m);
  std::uniform_int_distribution<int> index(-9, 9);
  for (int i = 0; i < 60; ++i) {
    const bool occupied = i % 3 != 0;
    tree.updateNode(octomap::point3d(static_cast<float>((index(*rng) + 0.5) * leaf_m),
                                     static_cast<float>((index(*rng) + 0.5) * leaf_m),
                                     static_cast<float>((index(*rng) + 0.5) * leaf_m)),
                    occupied);
  }
  for (int x = 0; x < 8; ++x) {
    for (int y = 0; y < 8; ++y) {
      for (int z = 8; z < 16; ++z) {
        tree.updateNode(octomap::point3d(static_cast<float>((x + 0.5) * leaf_m), static_cast<float>((y + 0.5) * leaf_m),
                                         static_cast<float>((z + 0.5) * leaf_m)),
                        true);
      }
    }
  }
  tree.prune();
  return tree;
}

struct Leaf {
  Eigen::Vector3d center;
  double size_m;
};
std::vector<Leaf> occupied_leaves(const octomap::OcTree& tree) {
  std::vector<Leaf> leaves;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (tree.isNodeOccupied(*leaf)) leaves.push_back({{leaf.getX(), leaf.getY(), leaf.getZ()}, leaf.getSize()});
  }
  return leaves;
}

// Exact contact is not near: a wall that ends between two voxels does not grow.
bool near(const std::vector<Leaf>& leaves, const Eigen::Vector3d& point, double margin_m) {
  return std::any_of(leaves.begin(), leaves.end(), [&](const Leaf& leaf) {
    return (point - leaf.center).cwiseAbs().maxCoeff() < leaf.size_m / 2 + margin_m - 1e-7;
  });
}

TEST_F(StaticMapTest, EqualsBruteForceOverLeaves) {
  std::mt19937 rng(21);
  for (double leaf_m : {0.08, 0.2}) {
    for (double margin_m : {0.0, 0.05, 0.23}) {
      octomap::OcTree tree = random_tree(leaf_m, &rng);
      ASSERT_TRUE(tree.write(path("map.ot")));
      ASSERT_TRUE(tree.writeBinary(path("map.bt")));
      const double resolution_m = 0.1;
      const std::vector<Leaf> leaves = occupied_leaves(tree);
      const StaticMap map(path("map.ot"), resolution_m, margin_m), binary(path("map.bt"), resolution_m, margin_m);
      EXPECT_EQ(map.geometry(), binary.geometry());
      GridGeometry around = map.geometry();  // three voxels more on each side: nothing may be missing there
      around.origin.array() -= 3;
      around.size.array() += 6;
      int occupied = 0;
      for (int x = 0; x < around.size.x(); ++x) {
        for (int y = 0; y < around.size.y(); ++y) {
          for (int z = 0; z < around.size.z(); ++z) {
            const Eigen::Vector3i voxel(x, y, z);
            const Eigen::Vector3i inner = voxel.array() - 3;
            const bool expected = near(leaves, around.center_of(voxel), margin_m);
            occupied += expected;
            ASSERT_EQ(map.occupied(inner), expected)
                << "leaf " << leaf_m << " margin " << margin_m << " at " << around.center_of(voxel).transpose();
            ASSERT_EQ(binary.occupied(inner), expected);
          }
        }
      }
      EXPECT_GT(occupied, 50);
    }
  }
}

// Leaves are whole voxels, or voxels whole leaves.
TEST(StaticMap, VoxelsFitItsLeaves) {
  for (const double leaf_m : {0.01, 0.02, 0.04, 0.05, 0.08, 0.1, 0.12, 0.16, 0.2, 0.25, 0.5, 1.0}) {
    const double voxel_m = StaticMap::fitting_voxel_m(leaf_m);
    const double ratio = std::max(voxel_m / leaf_m, leaf_m / voxel_m);
    EXPECT_NEAR(ratio, std::round(ratio), 1e-9) << leaf_m;
    EXPECT_GT(voxel_m, 0.067) << leaf_m;
    EXPECT_LT(voxel_m, 0.15) << leaf_m;
  }
  EXPECT_EQ(StaticMap::fitting_voxel_m(0.05), 0.1);
  EXPECT_EQ(StaticMap::fitting_voxel_m(0.08), 0.08);
}

TEST_F(StaticMapTest, CopyEqualsLookUpsAndKeepsWhatIsThere) {
  std::mt19937 rng(22);
  const octomap::OcTree tree = random_tree(0.5, &rng);  // 120 voxels and more along each axis: several words
  ASSERT_TRUE(tree.write(path("map.ot")));
  const StaticMap map(path("map.ot"), 0.1, 0.05);
  ASSERT_GT(map.geometry().words_per_column(), 1);
  std::uniform_int_distribution<int> offset(-90, 160), extent(1, 100);
  for (int trial = 0; trial < 60; ++trial) {
    GridGeometry window{.resolution_m = 0.1};
    for (int axis = 0; axis < 3; ++axis) {
      window.origin[axis] = map.geometry().origin[axis] + offset(rng);
      window.size[axis] = axis == 2 ? 2 * extent(rng) : extent(rng) / 4 + 1;
    }
    Sogm sogm;
    sogm.reset(window, 2, Utime(), 100ms);
    sogm.column(1, 0, 0)[0] = 1;
    map.copy_into(&sogm);
    for (int x = 0; x < window.size.x(); ++x) {
      for (int y = 0; y < window.size.y(); ++y) {
        for (int z = 0; z < window.size.z(); ++z) {
          const Eigen::Vector3i voxel(x, y, z);
          const bool expected = map.occupied(voxel + window.origin - map.geometry().origin);
          ASSERT_EQ(sogm.occupied(0, voxel), expected)
              << voxel.transpose() << " in window " << window.origin.transpose() << " + " << window.size.transpose();
          ASSERT_EQ(sogm.occupied(1, voxel), expected || voxel.isZero());
        }
        const int tail = window.size.z() % 64;
        if (tail != 0) {
          ASSERT_EQ(sogm.column(0, x, y)[window.words_per_column() - 1] >> tail, 0u);
        }
      }
    }
  }
}

TEST_F(StaticMapTest, MapWithoutOccupiedSpaceIsEmpty) {
  octomap::OcTree tree(0.1);
  tree.updateNode(octomap::point3d(0.05f, 0.05f, 0.05f), false);
  ASSERT_TRUE(tree.write(path("free.ot")));
  octomap::OcTree nothing(0.1);
  ASSERT_TRUE(nothing.write(path("nothing.ot")));
  for (const char* name : {"free.ot", "nothing.ot"}) {
    const StaticMap map(path(name), 0.1, 0.05);
    Sogm sogm;
    sogm.reset({.resolution_m = 0.1, .origin = {-5, -5, -5}, .size = {10, 10, 10}}, 2, Utime(), 100ms);
    map.copy_into(&sogm);
    EXPECT_EQ(sogm.words(), std::vector<std::uint64_t>(200, 0)) << name;
  }
}

// What the file is refused for; empty if it is not.
std::string complaint(const std::string& path, double resolution_m = 0.1) {
  try {
    StaticMap(path, resolution_m, 0.05);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST_F(StaticMapTest, RefusesBadFilesInOneLineThatNamesThem) {
  std::mt19937 rng(23);
  const octomap::OcTree tree = random_tree(0.1, &rng);
  octomap::ColorOcTree colored(0.1);
  colored.updateNode(octomap::point3d(0, 0, 0), true);
  ASSERT_TRUE(colored.write(path("colored.ot")));
  octomap::OcTree apart(0.1);
  apart.updateNode(octomap::point3d(-3000, -3000, -3000), true);
  apart.updateNode(octomap::point3d(3000, 3000, 3000), true);
  ASSERT_TRUE(apart.write(path("apart.ot")));
  const std::string head = "# Octomap OcTree binary file\nid OcTree\nsize 9\nres 0.1\ndata\n";
  const std::pair<std::string, const char*> cases[] = {
      {path("missing.bt"), "cannot be opened"},
      {directory_.string(), "cannot be opened"},
      {write("empty.bt", ""), "not an OctoMap file"},
      {write("text.bt", "hello\nworld\n"), "not an OctoMap file"},
      {write("head.bt", "# Octomap OcTree binary file\nid OcTree\n"), "cut short"},
      {write("data.bt", head), "cut short"},
      {write("deep.bt", head + std::string(1000, '\xff')), "too deep"},
      {write("resolution.bt", "# Octomap OcTree binary file\nid OcTree\nsize 9\nres -1\ndata\n12"), "resolution"},
      {write("coarse.bt", "# Octomap OcTree binary file\nid OcTree\nsize 9\nres 1000\ndata\n12"),
       "voxels of 1000 m; they must be within [0.001, 10] m"},
      {write("fine.bt", "# Octomap OcTree binary file\nid OcTree\nsize 9\nres 1e-9\ndata\n12"), "must be within"},
      {path("colored.ot"), "ColorOcTree"},
      {path("apart.ot"), "MB"},
  };
  for (const auto& [file, expected] : cases) {
    const std::string message = complaint(file);
    EXPECT_NE(message.find(expected), std::string::npos) << file << ": " << message;
    EXPECT_NE(message.find(file), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
}

// Counted in voxels, neither place nor size fits an int: as such they were one voxel somewhere.
TEST_F(StaticMapTest, RefusesWhatNoIntCanCount) {
  octomap::OcTree tree(10.0);
  tree.updateNode(octomap::point3d(3e5f, 3e5f, 3e5f), true);
  ASSERT_TRUE(tree.write(path("far.ot")));
  EXPECT_NE(complaint(path("far.ot"), 1e-4).find("MB"), std::string::npos);
  tree.updateNode(octomap::point3d(-3e5f, 3e5f, 3e5f), true);
  ASSERT_TRUE(tree.write(path("wide.ot")));
  EXPECT_NE(complaint(path("wide.ot"), 1e-4).find("MB"), std::string::npos);
}

TEST_F(StaticMapTest, EveryTruncationIsNoticed) {
  std::mt19937 rng(24);
  octomap::OcTree tree = random_tree(0.1, &rng);
  for (const std::string name : {"map.ot", "map.bt"}) {
    ASSERT_TRUE(name == "map.ot" ? tree.write(path(name)) : tree.writeBinary(path(name)));
    ASSERT_EQ(complaint(path(name)), "");
    std::ifstream file(path(name), std::ios::binary);
    const std::string content{std::istreambuf_iterator<char>(file), {}};
    for (std::size_t size = 0; size < content.size(); size += 1 + content.size() / 40) {
      EXPECT_NE(complaint(write("cut", content.substr(0, size))), "") << name << " cut to " << size;
    }
    // Damage anywhere is refused or gives some map, but does no harm.
    for (int trial = 0; trial < 40; ++trial) {
      std::string damaged = content;
      damaged[rng() % damaged.size()] ^= static_cast<char>(1u << rng() % 8);
      (void)complaint(write("damaged", damaged));
    }
  }
}

TEST(StaticMapRealFile, BuildingLoads) {
  const std::string path = SWARM_TEST_DATA "/geb079.bt";
  if (!fs::exists(path)) GTEST_SKIP() << path << " is not here";
  const StaticMap map(path, 0.1, 0.05);
  const auto tree = read_octomap(path);
  const std::vector<Leaf> leaves = occupied_leaves(*tree);
  EXPECT_GT(leaves.size(), 10'000u);
  for (const Leaf& leaf : leaves) ASSERT_TRUE(map.occupied(map.geometry().voxel_of(leaf.center)));
}

}  // namespace
}  // namespace swarm
