#include "tools/maps/map_comparison.h"

#include <cmath>

namespace swarm {

Agreement compare(const octomap::OcTree& map, const octomap::OcTree& other, double within_m) {
  const double edge_m = other.getResolution();
  const int reach = static_cast<int>(std::floor(within_m / edge_m + 1e-6));
  Agreement agreement;
  for_each_voxel(map, true, [&](const octomap::point3d& place) {
    bool stands = false, is_known = false;
    for (int x = -reach; x <= reach && !stands; ++x) {
      for (int y = -reach; y <= reach && !stands; ++y) {
        for (int z = -reach; z <= reach && !stands; ++z) {
          const octomap::point3d beside(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
          const octomap::OcTreeNode* node = other.search(place + beside * static_cast<float>(edge_m));
          if (node == nullptr) continue;
          stands = other.isNodeOccupied(*node);
          is_known = is_known || (x == 0 && y == 0 && z == 0);
        }
      }
    }
    ++(stands ? agreement.stands : is_known ? agreement.free : agreement.unknown);
  });
  return agreement;
}

}  // namespace swarm
