#include "map_daemon/perception/kept_map.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "lcmtypes/bus/text.h"
#include "map_daemon/octomap_file.h"

namespace swarm {
namespace {

constexpr std::uint64_t kWhole = ~std::uint64_t{0};
constexpr int kMiddle = 1 << 15;  // the lattice's voxel 0 among the keys of a tree

int below(int voxel, int edge) {
  return static_cast<int>(std::floor(static_cast<double>(voxel) / edge));
}

}  // namespace

KeptMap::KeptMap(const octomap::OcTree& tree, const std::string& path, double resolution_m)
    : resolution_m_(resolution_m) {
  if (std::abs(tree.getResolution() - resolution_m) > 1e-6 * resolution_m) {
    throw std::runtime_error("'" + path + "' has voxels of " + text_of(tree.getResolution()) +
                             " m; a map that is kept must have voxels of " + text_of(resolution_m) + " m");
  }
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    const int edge = 1 << (tree.getTreeDepth() - leaf.getDepth());
    const octomap::OcTreeKey key = leaf.getIndexKey();
    const Eigen::Vector3i low(key[0] - kMiddle, key[1] - kMiddle, key[2] - kMiddle);
    const Eigen::Vector3i high = low.array() + edge - 1;
    for (int x = below(low.x(), kEdge); x <= below(high.x(), kEdge); ++x) {
      for (int y = below(low.y(), kEdge); y <= below(high.y(), kEdge); ++y) {
        for (int z = below(low.z(), kHeight); z <= below(high.z(), kHeight); ++z) {
          Block* const block = block_at({x, y, z});
          if (block == nullptr) {
            throw std::runtime_error("'" + path + "' is too large to be kept: more than " + std::to_string(kMaxBlocks) +
                                     " blocks of " + std::to_string(kEdge) + " x " + std::to_string(kEdge) + " x " +
                                     std::to_string(kHeight) + " voxels");
          }
          std::uint64_t run = 0;
          set_run(low.z() - z * kHeight, high.z() - z * kHeight, kHeight, &run);
          for (int i = std::max(low.x() - x * kEdge, 0); i <= std::min(high.x() - x * kEdge, kEdge - 1); ++i) {
            for (int j = std::max(low.y() - y * kEdge, 0); j <= std::min(high.y() - y * kEdge, kEdge - 1); ++j) {
              Column& column = block->columns[static_cast<std::size_t>(i * kEdge + j)];
              (tree.isNodeOccupied(*leaf) ? column.occupied : column.free) |= run;
            }
          }
        }
      }
    }
  }
}

KeptMap::Block* KeptMap::block_at(const Place& place) {
  if (const auto block = blocks_.find(place); block != blocks_.end()) return &block->second;
  if (blocks_.size() >= kMaxBlocks) {
    is_full_ = true;
    return nullptr;
  }
  return &blocks_[place];
}

// The window is a block high, but lies across two.
template <class Visit>
void KeptMap::for_each_place(const GridGeometry& window, const Visit& visit) {
  const Eigen::Vector3i &first = window.origin, last = window.origin + window.size - Eigen::Vector3i::Ones();
  const int bottom = below(first.z(), kHeight), in_block = first.z() - bottom * kHeight;
  for (int x = below(first.x(), kEdge); x <= below(last.x(), kEdge); ++x) {
    for (int y = below(first.y(), kEdge); y <= below(last.y(), kEdge); ++y) {
      visit(Place{x, y, bottom}, kWhole << in_block);
      if (in_block > 0) visit(Place{x, y, bottom + 1}, ~(kWhole << in_block));
    }
  }
}

template <class Visit>
void KeptMap::for_each_column(const GridGeometry& window, const Place& place, const Visit& visit) {
  const int left = place[0] * kEdge - window.origin.x(), front = place[1] * kEdge - window.origin.y();
  for (int i = std::max(-left, 0); i < std::min(kEdge, window.size.x() - left); ++i)
    for (int j = std::max(-front, 0); j < std::min(kEdge, window.size.y() - front); ++j)
      visit(static_cast<std::size_t>(i * kEdge + j), left + i, front + j);
}

// A column of the window turned by where the window begins is a column of its blocks.
void KeptMap::learn(const Sogm& seen_space) {
  const GridGeometry& window = seen_space.geometry;
  const int turn = window.origin.z() & (kHeight - 1);
  for_each_place(window, [&](const Place& place, std::uint64_t inside) {
    Block* block = nullptr;
    for_each_column(window, place, [&](std::size_t at, int x, int y) {
      const std::uint64_t stands = std::rotl(*seen_space.column(0, x, y), turn) & inside;
      const std::uint64_t seen = (~std::rotl(*seen_space.column(1, x, y), turn) & inside) | stands;
      if (seen == 0) return;
      if (block == nullptr) block = block_at(place);
      if (block == nullptr) return;
      Column& column = block->columns[at];
      column.occupied = (column.occupied & ~seen) | stands;
      column.free = (column.free & ~seen) | (seen & ~stands);
    });
  });
}

void KeptMap::recall(FreeSpaceGrid* grid) const {
  const GridGeometry& window = grid->geometry();
  const int turn = window.origin.z() & (kHeight - 1);
  for_each_place(window, [&](const Place& place, std::uint64_t inside) {
    const auto block = blocks_.find(place);
    if (block == blocks_.end()) return;
    for_each_column(window, place, [&](std::size_t at, int x, int y) {
      const std::uint64_t stands = block->second.columns[at].occupied & inside;
      if (stands != 0) grid->recall(grid->column_of(x, y), std::rotr(stands, turn));
    });
  });
}

std::string KeptMap::to_octomap() const {
  std::vector<VoxelCube> cubes;
  for (const auto& [place, block] : blocks_) {
    for (int bottom = 0; bottom < kHeight; bottom += VoxelCube::kEdge) {
      VoxelCube cube{.corner = {place[0] * kEdge, place[1] * kEdge, place[2] * kHeight + bottom}};
      std::uint64_t any = 0;
      for (std::size_t i = 0; i < block.columns.size(); ++i) {
        any |= cube.occupied[i] = static_cast<std::uint8_t>(block.columns[i].occupied >> bottom);
        any |= cube.free[i] = static_cast<std::uint8_t>(block.columns[i].free >> bottom);
      }
      if (any != 0) cubes.push_back(cube);
    }
  }
  return octomap_of(std::move(cubes), resolution_m_);
}

}  // namespace swarm
