#include "map_daemon/static_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "map_daemon/octomap_file.h"

namespace swarm {
namespace {

// Lattice voxels whose centres lie in [low, high]. Whole numbers, which need not fit an int.
struct VoxelBox {
  Eigen::Array3d first, last;
};
VoxelBox voxels_within(const octomap::OcTree::leaf_iterator& leaf, double resolution_m, double margin_m) {
  const Eigen::Array3d center(leaf.getX(), leaf.getY(), leaf.getZ());
  const double half = leaf.getSize() / 2 + margin_m + 1e-9;  // rounding keeps exact contact inside
  return {((center - half) / resolution_m - 0.5).ceil(), ((center + half) / resolution_m - 0.5).floor()};
}

// Word `w` of `column` (`n` words, zeros around) shifted down by `shift` bits, of either sign.
std::uint64_t shifted_word(const std::uint64_t* column, int n, int w, int shift) {
  const int bit = 64 * w + shift, word = bit >> 6, offset = bit & 63;
  const std::uint64_t low = word >= 0 && word < n ? column[word] >> offset : 0;
  const std::uint64_t high = offset != 0 && word + 1 >= 0 && word + 1 < n ? column[word + 1] << (64 - offset) : 0;
  return low | high;
}

}  // namespace

StaticMap::StaticMap(const std::string& path, double resolution_m, double margin_m) {
  const std::unique_ptr<octomap::OcTree> tree = read_octomap(path);
  std::vector<VoxelBox> boxes;
  Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::max()), high = -low;
  for (auto leaf = tree->begin_leafs(); leaf != tree->end_leafs(); ++leaf) {
    if (!tree->isNodeOccupied(*leaf)) continue;
    const VoxelBox box = voxels_within(leaf, resolution_m, margin_m);
    if ((box.first > box.last).any()) continue;  // holds no centre
    low = low.min(box.first);
    high = high.max(box.last);
    boxes.push_back(box);
  }
  const Eigen::Array3d size = boxes.empty() ? Eigen::Array3d::Zero() : Eigen::Array3d(high - low + 1);
  const double bytes = size.x() * size.y() * 8.0 * std::ceil(size.z() / 64.0);
  if (bytes > static_cast<double>(kMaxBytes)) {
    throw std::runtime_error("'" + path + "' needs " + std::to_string(std::llround(bytes / 1e6)) +
                             " MB at a resolution of " + std::to_string(resolution_m) + " m; at most " +
                             std::to_string(kMaxBytes / 1'000'000) + " MB are allowed");
  }
  // Now all fits an int: a tree has 2^16 leaves along an axis, and a leaf 2^11 voxels at most.
  GridGeometry geometry{.resolution_m = resolution_m};
  geometry.size = size.cast<int>();
  if (!boxes.empty()) geometry.origin = low.cast<int>();
  grid_.reset(geometry, 1, Utime(), 1us);
  for (const VoxelBox& box : boxes) {
    const Eigen::Array3i first = (box.first - low).cast<int>(), last = (box.last - low).cast<int>();
    for (int x = first.x(); x <= last.x(); ++x) {
      for (int y = first.y(); y <= last.y(); ++y) {
        std::uint64_t* column = grid_.column(0, x, y);
        for (int z = first.z(); z <= last.z(); ++z) column[z >> 6] |= std::uint64_t{1} << (z & 63);
      }
    }
  }
}

void StaticMap::copy_into(Sogm* sogm) const {
  const GridGeometry &from = grid_.geometry, &to = sogm->geometry;
  if (sogm->num_frames == 0) return;
  const Eigen::Vector3i shift = to.origin - from.origin;  // window index + shift = index here
  const int tail = to.size.z() % 64, words = to.words_per_column();
  const std::uint64_t top_mask = tail == 0 ? ~std::uint64_t{0} : (std::uint64_t{1} << tail) - 1;
  const int y_end = std::min(to.size.y(), from.size.y() - shift.y());
  for (int x = std::max(0, -shift.x()); x < std::min(to.size.x(), from.size.x() - shift.x()); ++x) {
    for (int y = std::max(0, -shift.y()); y < y_end; ++y) {
      const std::uint64_t* source = grid_.column(0, x + shift.x(), y + shift.y());
      for (int w = 0; w < words; ++w) {
        std::uint64_t bits = shifted_word(source, from.words_per_column(), w, shift.z());
        if (w == words - 1) bits &= top_mask;
        if (bits == 0) continue;
        for (int frame = 0; frame < sogm->num_frames; ++frame) sogm->column(frame, x, y)[w] |= bits;
      }
    }
  }
}

}  // namespace swarm
