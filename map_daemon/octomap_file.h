// OctoMap files (.bt, .ot), read with the checks that octomap's own reader lacks.
#pragma once

#include <octomap/OcTree.h>

#include <memory>
#include <string>

namespace swarm {

// Throws std::runtime_error, one line that names the file, when it is missing, cut short, damaged or not an OcTree.
std::unique_ptr<octomap::OcTree> read_octomap(const std::string& path);

}  // namespace swarm
