// OctoMap files (.bt, .ot), read with the checks that octomap's own reader lacks.
#pragma once

#include <octomap/OcTree.h>

#include <memory>
#include <string>

namespace swarm {

// Throws std::runtime_error, one line that names the file, when it is missing, cut short, damaged, not an OcTree,
// or of voxels whose edges are not within [0.001, 10] m.
std::unique_ptr<octomap::OcTree> read_octomap(const std::string& path);

}  // namespace swarm
