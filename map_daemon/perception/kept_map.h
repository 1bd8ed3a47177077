// What stands and what is free wherever a robot has looked: what FreeSpaceGrid forgets when the window moves on. Read
// from OctoMaps, and written as one.
#pragma once

#include <octomap/OcTree.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

#include "map_daemon/octomap_file.h"
#include "map_daemon/perception/free_space_grid.h"
#include "map_daemon/sogm.h"

namespace swarm {

class KeptMap {
 public:
  static constexpr int kEdge = VoxelCube::kEdge;          // columns of a block along x and y
  static constexpr int kHeight = FreeSpaceGrid::kHeight;  // and its voxels along z
  // 1 kB each; at 0.1 m one layer of them holds 20,000 m2. What there is no room for is not kept.
  static constexpr std::size_t kMaxBlocks = std::size_t{1} << 15;

  explicit KeptMap(double resolution_m) : resolution_m_(resolution_m) {}
  // Throws std::runtime_error, one line that names `path`, where the tree has other voxels or holds too much.
  KeptMap(const octomap::OcTree& tree, const std::string& path, double resolution_m);

  // What was seen replaces what was known there. `seen_space`: Perception's. Voxels that are occupied and not seen stay
  // what they were.
  void learn(const Sogm& seen_space);
  // What stood where the window knows nothing stands there until it is seen to be gone.
  void recall(FreeSpaceGrid* grid) const;

  // Bytes of an OctoMap file (.bt).
  std::string to_octomap() const;

  std::size_t blocks() const { return blocks_.size(); }
  // There was no room for something.
  bool is_full() const { return is_full_; }

 private:
  struct Column {
    std::uint64_t occupied = 0, free = 0;  // bit k: voxel k of the block along z
  };
  using Place = std::array<int, 3>;  // of a block: x, y, z by its edges
  struct Block {
    std::array<Column, std::size_t{kEdge} * kEdge> columns{};
  };

  // Of each block that the window meets; `visit`(place, which voxels of its columns are in the window).
  template <class Visit>
  static void for_each_place(const GridGeometry& window, const Visit& visit);
  // Of each column of the block in the window: visit(its place in the block, x and y in the window).
  template <class Visit>
  static void for_each_column(const GridGeometry& window, const Place& place, const Visit& visit);
  Block* block_at(const Place& place);  // null: there is no room for it

  double resolution_m_;
  std::map<Place, Block> blocks_;
  bool is_full_ = false;
};

}  // namespace swarm
