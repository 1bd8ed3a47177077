// OctoMap files: they are read or refused with one line that names the file, and never take more memory than is
// allowed.
#include <stdexcept>

#include "map_daemon/octomap_file.h"
#include "map_daemon/static_map.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {

void try_input(FuzzInput input) {
  const double margin_m = input.real(0.0, 0.5);
  const bool at_own_resolution = input.flag();
  const MemoryFile file(input.rest());
  try {
    const auto tree = read_octomap(file.path());
    expect(tree != nullptr && tree->getResolution() >= 0.001 && tree->getResolution() <= 10.0, "voxels have a size");
    const double voxel_m =
        at_own_resolution ? tree->getResolution() : StaticMap::fitting_voxel_m(tree->getResolution());
    const StaticMap map(*tree, file.path(), voxel_m, at_own_resolution ? 0.0 : margin_m);
    const GridGeometry& grid = map.geometry();
    const std::int64_t bytes = 8 * std::int64_t{grid.size.x()} * grid.size.y() * grid.words_per_column();
    expect(bytes >= 0 && bytes <= StaticMap::kMaxBytes, "it keeps to its memory");
    // Every occupied leaf's middle is occupied, and far away nothing is.
    for (auto leaf = tree->begin_leafs(); leaf != tree->end_leafs(); ++leaf) {
      if (!tree->isNodeOccupied(*leaf) || leaf.getSize() < voxel_m) continue;  // smaller ones may hold no centre
      const Eigen::Vector3d middle(leaf.getX(), leaf.getY(), leaf.getZ());
      expect(map.occupied(grid.voxel_of(middle)), "a leaf's middle is occupied");
      expect(map.meets(middle, 0.5 * leaf.getSize() + voxel_m + margin_m), "something is near it");
    }
    expect(!map.meets(Eigen::Vector3d::Constant(1e6), 1.0), "nothing is far away");
  } catch (const std::runtime_error& error) {
    const std::string_view line = error.what();
    expect(line.find(file.path()) != line.npos && line.find('\n') == line.npos, "one line names the file");
  }
}

}  // namespace swarm::fuzz
