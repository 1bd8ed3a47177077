#include "swarm_sim/world/occupied_cubes.h"

#include <gtest/gtest.h>
#include <octomap/OcTree.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <random>

namespace swarm {
namespace {

namespace fs = std::filesystem;

// A file that is gone afterwards.
struct TemporaryFile {
  explicit TemporaryFile(const std::string& suffix)
      : path(fs::temp_directory_path() / ("swarm_cubes_" + std::to_string(::getpid()) + suffix)) {}
  ~TemporaryFile() { fs::remove(path); }
  fs::path path;
};

// Straight from the tree's leaves.
double brute_force(const octomap::OcTree& tree, const Eigen::Vector3d& p, double max_m) {
  double best = max_m;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (!tree.isNodeOccupied(*leaf)) continue;
    const Eigen::Vector3d center(leaf.getX(), leaf.getY(), leaf.getZ());
    best = std::min(best, ((p - center).cwiseAbs().array() - 0.5 * leaf.getSize()).max(0.0).matrix().norm());
  }
  return best;
}

octomap::OcTree small_tree() {
  octomap::OcTree tree(0.1);
  std::mt19937 random(5);
  std::uniform_real_distribution<float> unit(-1.0f, 1.0f);
  for (int i = 0; i < 300; ++i)
    tree.updateNode(octomap::point3d(2 * unit(random), 2 * unit(random), unit(random)), i % 3 != 0);
  for (float x = 0.05f; x < 0.8f; x += 0.1f) {  // a solid block, pruned to one large cube
    for (float y = 0.05f; y < 0.8f; y += 0.1f) {
      for (float z = 0.05f; z < 0.8f; z += 0.1f) tree.updateNode(octomap::point3d(x, y, z), true);
    }
  }
  tree.updateInnerOccupancy();
  tree.toMaxLikelihood();
  tree.prune();
  return tree;
}

void expect_equal(const OccupiedCubes& cubes, const octomap::OcTree& tree, const Eigen::Vector3d& half_window,
                  int samples) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int i = 0; i < samples; ++i) {
    const Eigen::Vector3d p = half_window.cwiseProduct(Eigen::Vector3d(unit(random), unit(random), unit(random)));
    const double max_m = 1.0 + unit(random);
    ASSERT_NEAR(cubes.distance(p, max_m), brute_force(tree, p, max_m), 1e-9) << p.transpose() << " up to " << max_m;
  }
}

TEST(OccupiedCubes, EqualsAllLeavesInBothFormats) {
  octomap::OcTree tree = small_tree();
  const TemporaryFile bt(".bt"), ot(".ot");
  ASSERT_TRUE(tree.writeBinary(bt.path.string()));
  ASSERT_TRUE(tree.write(ot.path.string()));
  for (const fs::path& path : {bt.path, ot.path}) {
    SCOPED_TRACE(path);
    const OccupiedCubes cubes = OccupiedCubes::load(path);
    EXPECT_TRUE(std::ranges::any_of(cubes.cubes(), [](const auto& cube) { return cube.half_edge_m > 0.3; }))
        << "a pruned cube is expected";
    expect_equal(cubes, tree, {3, 3, 2}, 2000);
  }
}

TEST(OccupiedCubes, RealBuildingEqualsAllLeaves) {
  const fs::path path = fs::path(SWARM_TEST_DATA) / "geb079.bt";
  if (!fs::exists(path)) GTEST_SKIP() << "no map at " << path;
  const OccupiedCubes cubes = OccupiedCubes::load(path);
  octomap::OcTree tree(path.string());
  std::size_t occupied = 0;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) occupied += tree.isNodeOccupied(*leaf) ? 1 : 0;
  EXPECT_EQ(cubes.cubes().size(), occupied);
  EXPECT_GT(occupied, 10000u);
  expect_equal(cubes, tree, {12, 12, 2}, 50);
}

TEST(OccupiedCubes, EmptyMapsHaveNothingNear) {
  EXPECT_EQ(OccupiedCubes({}).distance({0, 0, 0}, 3.0), 3.0);
  octomap::OcTree tree(0.1);
  const TemporaryFile file(".bt");
  ASSERT_TRUE(tree.writeBinary(file.path.string()));
  EXPECT_TRUE(OccupiedCubes::load(file.path).cubes().empty());
}

TEST(OccupiedCubes, RefusesWhatIsNoWholeOctoMap) {
  const TemporaryFile file(".bt");
  const auto expect_refused = [&](const char* what) {
    try {
      OccupiedCubes::load(file.path);
      ADD_FAILURE() << what;
    } catch (const std::runtime_error& error) {
      const std::string text = error.what();
      EXPECT_NE(text.find(file.path.string()), std::string::npos) << text;
      EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    }
  };
  expect_refused("missing");
  std::ofstream(file.path) << "{\"name\": 1}";
  expect_refused("no OctoMap");
  octomap::OcTree tree = small_tree();
  ASSERT_TRUE(tree.writeBinary(file.path.string()));
  fs::resize_file(file.path, fs::file_size(file.path) - 1);
  expect_refused("cut short");
}

}  // namespace
}  // namespace swarm
