// A world's walls as an OctoMap file: daemons, judge and views know the static map by such a file alone.
#pragma once

#include <filesystem>

#include "swarm_sim/world/world.h"

namespace swarm {

inline constexpr double kWallVoxel_m = 0.1;

// The world as it is flown: where it has walls, the voxels that they overlap are written to walls.ot in `directory`,
// absolute, and that is its static map instead. Throws WorldError when the walls are of more than 10 million voxels or
// reach beyond what an OctoMap holds, std::runtime_error when the file cannot be written.
World with_walls_in_file(World world, const std::filesystem::path& directory);

}  // namespace swarm
