// OctoMap files: .bt and .ot are read, with the checks that octomap's own reader lacks, and .bt is written.
#pragma once

#include <octomap/OcTree.h>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace swarm {

// Throws std::runtime_error, one line that names the file, when it is missing, cut short, damaged, not an OcTree,
// or of voxels whose edges are not within [0.001, 10] m.
std::unique_ptr<octomap::OcTree> read_octomap(const std::string& path);

// What is known of 8 x 8 x 8 voxels; whatever is neither occupied nor free is unknown.
struct VoxelCube {
  static constexpr int kEdge = 8;
  Eigen::Vector3i corner;  // of the lattice, a multiple of kEdge; what reaches beyond +-2^15 voxels is not written
  std::array<std::uint8_t, std::size_t{kEdge} * kEdge> occupied{}, free{};  // [kEdge x + y], bit z
};

// The bytes of an OctoMap file (.bt) that holds these, each at another place. Needs no tree, which would take twenty
// times the memory.
std::string octomap_of(std::vector<VoxelCube> cubes, double resolution_m);

}  // namespace swarm
