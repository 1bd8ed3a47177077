#include "swarm_sim/world/walls.h"

#include <octomap/OcTree.h>

#include <cmath>
#include <sstream>

#include "lcmtypes/bus/atomic_file.h"

namespace swarm {
namespace {

constexpr double kMaxVoxels = 1e7, kRounding = 1e-6;
constexpr double kOctoMapReach_m = 3276.0;  // an OcTree has 2^15 voxels to each side

}  // namespace

World with_walls_in_file(World world, const std::filesystem::path& directory) {
  if (world.walls.empty()) return world;
  octomap::OcTree tree(kWallVoxel_m);
  double voxels = 0.0;
  for (const Space& wall : world.walls) {
    const Eigen::Array3d first = (wall.min.array() / kWallVoxel_m + kRounding).floor();
    const Eigen::Array3d end = (wall.max.array() / kWallVoxel_m - kRounding).ceil().max(first + 1.0);
    voxels += (end - first).prod();
    if (voxels > kMaxVoxels) throw WorldError("walls: must be of at most 10 million voxels of 0.1 m in all");
    if (wall.min.minCoeff() < -kOctoMapReach_m || wall.max.maxCoeff() > kOctoMapReach_m)
      throw WorldError("walls: must be within 3276 m of the origin");
    for (double x = first.x(); x < end.x(); ++x) {
      for (double y = first.y(); y < end.y(); ++y) {
        for (double z = first.z(); z < end.z(); ++z) {
          const Eigen::Vector3d center = kWallVoxel_m * (Eigen::Vector3d(x, y, z).array() + 0.5);
          tree.updateNode(octomap::point3d(static_cast<float>(center.x()), static_cast<float>(center.y()),
                                           static_cast<float>(center.z())),
                          true, /*lazy_eval=*/true);
        }
      }
    }
  }
  tree.updateInnerOccupancy();
  tree.prune();
  std::ostringstream bytes;
  tree.write(bytes);
  world.walls.clear();
  world.static_map = std::filesystem::absolute(directory / "walls.ot").lexically_normal();
  write_file(world.static_map, bytes.str());
  return world;
}

}  // namespace swarm
