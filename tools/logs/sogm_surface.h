// What is worth drawing of a SOGM: the voxels one can see from outside.
#pragma once

#include <cstdint>
#include <vector>

#include "map_daemon/sogm.h"

namespace swarm {

struct SurfaceVoxel {
  std::int16_t x, y, z;      // index in the map's window
  std::int16_t first_frame;  // the first in which the voxel is occupied, or the one that was asked for

  bool operator==(const SurfaceVoxel&) const = default;
};

inline constexpr int kAllFrames = -1;

// The occupied voxels of one frame, or with kAllFrames of the union of all, without those whose six neighbours are
// occupied in it, too; beyond the window nothing is. Ascending in x, then y; within a column in an order of no meaning.
// `surface` is replaced and keeps its memory; it becomes empty when there is no such frame.
void sogm_surface(const Sogm& sogm, int frame, std::vector<SurfaceVoxel>* surface);

}  // namespace swarm
