#include "map_daemon/static_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "map_daemon/octomap_file.h"

namespace swarm {
namespace {

// Lattice voxels whose centres lie in [low, high]. Whole numbers, which need not fit an int.
struct VoxelBox {
  Eigen::Array3d first, last;
};
VoxelBox voxels_within(const octomap::OcTree::leaf_iterator& leaf, double resolution_m, double margin_m) {
  const Eigen::Array3d center(leaf.getX(), leaf.getY(), leaf.getZ());
  const double half = leaf.getSize() / 2 + margin_m - 1e-6;  // a wall that ends between two voxels does not grow
  // (an edge of the tree is a float)
  return {((center - half) / resolution_m - 0.5).ceil(), ((center + half) / resolution_m - 0.5).floor()};
}

}  // namespace

StaticMap::StaticMap(const std::string& path, double resolution_m, double margin_m)
    : StaticMap(*read_octomap(path), path, resolution_m, margin_m) {}

StaticMap::StaticMap(const octomap::OcTree& tree, const std::string& path, double resolution_m, double margin_m) {
  std::vector<VoxelBox> boxes;
  Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::max()), high = -low;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (!tree.isNodeOccupied(*leaf)) continue;
    const VoxelBox box = voxels_within(leaf, resolution_m, margin_m);
    if ((box.first > box.last).any()) continue;  // holds no centre
    low = low.min(box.first);
    high = high.max(box.last);
    boxes.push_back(box);
  }
  const Eigen::Array3d size = boxes.empty() ? Eigen::Array3d::Zero() : Eigen::Array3d(high - low + 1);
  const double bytes = size.x() * size.y() * 8.0 * std::ceil(size.z() / 64.0);
  if (bytes > static_cast<double>(kMaxBytes)) {
    throw std::runtime_error("'" + path + "' needs " + std::to_string(std::llround(bytes / 1e6)) +
                             " MB at a resolution of " + std::to_string(resolution_m) + " m; at most " +
                             std::to_string(kMaxBytes / 1'000'000) + " MB are allowed");
  }
  // Now all fits an int: a tree has 2^16 leaves along an axis, and a leaf 2^11 voxels at most.
  GridGeometry geometry{.resolution_m = resolution_m};
  geometry.size = size.cast<int>();
  if (!boxes.empty()) geometry.origin = low.cast<int>();
  grid_.reset(geometry, 1, Utime(), 1us);
  for (const VoxelBox& box : boxes) {
    const Eigen::Array3i first = (box.first - low).cast<int>(), last = (box.last - low).cast<int>();
    for (int x = first.x(); x <= last.x(); ++x) {
      for (int y = first.y(); y <= last.y(); ++y) {
        set_run(first.z(), last.z(), geometry.size.z(), grid_.column(0, x, y));
      }
    }
  }
}

bool cubes_meet(const Sogm& cubes, const Eigen::Vector3d& place, double radius_m) {
  const GridGeometry& grid = cubes.geometry;
  if ((grid.size.array() <= 0).any()) return false;
  const double radius = radius_m / grid.resolution_m;
  const Eigen::Vector3d at = place / grid.resolution_m - grid.origin.cast<double>();  // in voxels from the corner
  const Eigen::Vector2i low = (at.head<2>().array() - radius).floor().max(0).matrix().cast<int>();
  const Eigen::Vector2i high =
      (at.head<2>().array() + radius).floor().min(grid.size.head<2>().cast<double>().array() - 1).matrix().cast<int>();
  for (int x = low.x(); x <= high.x(); ++x) {
    const double dx = std::max({x - at.x(), at.x() - (x + 1), 0.0});
    for (int y = low.y(); y <= high.y(); ++y) {
      const double dy = std::max({y - at.y(), at.y() - (y + 1), 0.0});
      const double high2 = radius * radius - dx * dx - dy * dy;
      if (high2 <= 0.0) continue;
      // Cubes [z, z + 1] that overlap (at.z - half, at.z + half).
      const double half = std::sqrt(high2);
      const std::uint64_t* column = cubes.column(0, x, y);
      std::uint64_t any = 0;
      for_each_word_of_run(std::floor(at.z() - half), std::ceil(at.z() + half) - 1.0, grid.size.z(),
                           [&](int word, std::uint64_t bits) { any |= column[word] & bits; });
      if (any != 0) return true;
    }
  }
  return false;
}

}  // namespace swarm
