// How far two OctoMaps agree about what stands.
#pragma once

#include <octomap/OcTree.h>

#include <cstdint>

namespace swarm {

// What one map says of the voxels that are occupied in another.
struct Agreement {
  std::int64_t stands = 0, free = 0, unknown = 0;

  std::int64_t known() const { return stands + free; }
  double share() const { return known() > 0 ? static_cast<double>(stands) / static_cast<double>(known()) : 1.0; }
};

// Of each voxel of `map` that is occupied, by its centre: it stands where `other` has an occupied voxel whose centre is
// within `within_m` along each axis, or that holds it. Maps may have voxels of different edges.
Agreement compare(const octomap::OcTree& map, const octomap::OcTree& other, double within_m);

// Calls visit(centre) for each voxel of the tree's resolution that is occupied (or free).
template <class Visit>
void for_each_voxel(const octomap::OcTree& map, bool occupied, const Visit& visit) {
  const double edge = map.getResolution();
  for (auto leaf = map.begin_leafs(); leaf != map.end_leafs(); ++leaf) {
    if (map.isNodeOccupied(*leaf) != occupied) continue;
    const int count = 1 << (map.getTreeDepth() - leaf.getDepth());
    const octomap::point3d first = leaf.getCoordinate() - octomap::point3d(1, 1, 1) * (0.5f * static_cast<float>(edge) *
                                                                                       static_cast<float>(count - 1));
    for (int x = 0; x < count; ++x)
      for (int y = 0; y < count; ++y)
        for (int z = 0; z < count; ++z)
          visit(first + octomap::point3d(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)) *
                            static_cast<float>(edge));
  }
}

}  // namespace swarm
