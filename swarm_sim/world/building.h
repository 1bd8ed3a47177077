// A building that is known as an OctoMap: where robots can fly in it.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <vector>

#include "swarm_sim/world/world.h"

namespace swarm {

struct Building {
  Space space;                          // what its map holds, from the lower of the heights to the higher
  std::vector<Eigen::Vector3d> places;  // W [m]
};

// The map's voxels between these heights (W [m], low first) whose middles lie in what it knows to be free, with room to
// turn around, and from which a sphere gets to all others of them, with room beside it all the way: of several such
// sets the largest. Throws WorldError when there is none, and what read_octomap() throws.
Building building_in(const std::filesystem::path& map, double radius_m, const Eigen::Vector2d& heights_m);

}  // namespace swarm
