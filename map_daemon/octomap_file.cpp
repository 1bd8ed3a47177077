#include "map_daemon/octomap_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string_view>

#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr std::string_view kBinaryMagic = "# Octomap OcTree binary file", kFullMagic = "# Octomap OcTree file";
constexpr int kTreeDepth = 16;
constexpr double kMinEdge_m = 0.001, kMaxEdge_m = 10.0;  // of a voxel

struct Fault : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Checks the stream of nodes, depth first, that octomap would read without looking: on a file that is cut short or
// damaged it recurses on uninitialised bytes.
void check_nodes(std::string_view bytes, bool binary) {
  std::array<int, kTreeDepth + 1> pending{};  // nodes still to come per depth
  std::size_t at = 0;
  pending[0] = 1;
  for (int depth = 0; depth >= 0;) {
    int& left = pending[static_cast<std::size_t>(depth)];
    if (left == 0) {
      --depth;
      continue;
    }
    --left;
    const std::size_t record = binary ? 2 : 5;  // two bits a child; or a float and one bit a child
    if (bytes.size() - at < record) throw Fault("is cut short");
    unsigned children = 0;  // that have a record of their own
    if (binary) {
      const auto byte = [&](std::size_t i) { return unsigned{static_cast<unsigned char>(bytes[at + i])}; };
      const unsigned bits = byte(0) | byte(1) << 8;
      children = bits & bits >> 1 & 0x5555u;
    } else {
      children = static_cast<unsigned char>(bytes[at + 4]);
      if (!std::isfinite(std::bit_cast<float>(std::array{bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]}))) {
        throw Fault("is damaged: a node's value is not finite");
      }
    }
    at += record;
    // A binary record describes its node's children, so it cannot stand at the last depth.
    if (depth + 1 + (binary ? 1 : 0) > kTreeDepth && children != 0) throw Fault("is damaged: its tree is too deep");
    if (children != 0) pending[static_cast<std::size_t>(++depth)] = std::popcount(children);
  }
}

// Checks the text in front of the nodes, too: octomap complains in several lines and goes on.
std::unique_ptr<octomap::OcTree> read_checked(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || !std::filesystem::is_regular_file(path)) throw Fault("cannot be opened as a file");
  const std::string content{std::istreambuf_iterator<char>(file), {}};
  const std::string_view first_line = std::string_view(content).substr(0, content.find('\n'));
  const bool binary = first_line == kBinaryMagic;
  if (!binary && first_line != kFullMagic) throw Fault("is not an OctoMap file (.bt or .ot)");

  std::istringstream stream(content);
  std::string key, id;
  double size = -1.0, resolution = 0.0;
  for (std::string line; key != "data" && std::getline(stream, line);) {
    std::istringstream words(line);
    if (!(words >> key)) continue;
    if (key == "id") words >> id;
    if (key == "size") words >> size;
    if (key == "res") words >> resolution;
  }
  if (key != "data" || stream.eof()) throw Fault("is cut short");
  if (id != "OcTree") throw Fault("holds a tree of type '" + id + "'; only OcTree is understood");
  if (!(size >= 0.0) || !(resolution > 0.0)) throw Fault("is damaged: bad size or resolution");
  if (resolution < kMinEdge_m || resolution > kMaxEdge_m) {
    throw Fault("has voxels of " + text_of(resolution) + " m; they must be within [" + text_of(kMinEdge_m) + ", " +
                text_of(kMaxEdge_m) + "] m");
  }
  auto tree = std::make_unique<octomap::OcTree>(resolution);
  if (size == 0.0) return tree;
  check_nodes(std::string_view(content).substr(static_cast<std::size_t>(stream.tellg())), binary);
  if (binary) {
    tree->readBinaryData(stream);
  } else {
    tree->readData(stream);
  }
  return tree;
}

// As they are written: two bits a child.
enum class Kind : unsigned { kUnknown = 0, kFree = 1, kOccupied = 2, kInner = 3 };

constexpr int kCubeLevel = 3;                   // of a cube's node: its edge is 2^3 voxels
constexpr int kMiddle = 1 << (kTreeDepth - 1);  // key of the lattice's voxel 0

class TreeWriter {
 public:
  // Cubes in the order of a file.
  explicit TreeWriter(std::span<const VoxelCube> cubes) { write_tree(cubes, kTreeDepth); }

  std::int64_t num_nodes() const { return num_nodes_; }
  const std::string& nodes() const { return nodes_; }

 private:
  // The child's number among eight of the node of this level that holds the voxel: 2^level voxels are its edge.
  static unsigned child_of(const Eigen::Vector3i& voxel, int level) {
    unsigned child = 0;
    for (int axis = 0; axis < 3; ++axis)
      child |= (static_cast<unsigned>(voxel[axis] + kMiddle) >> (level - 1) & 1) << axis;
    return child;
  }

  static Kind kind_of(const VoxelCube& cube, const Eigen::Vector3i& low, int edge) {
    const auto layer = static_cast<std::uint8_t>(((1 << edge) - 1) << low.z());
    unsigned occupied = 0, free = 0, all_occupied = layer, all_free = layer;
    for (int x = low.x(); x < low.x() + edge; ++x) {
      for (int y = low.y(); y < low.y() + edge; ++y) {
        const auto at = static_cast<std::size_t>(VoxelCube::kEdge * x + y);
        const unsigned stands = cube.occupied[at], open = cube.free[at] & ~stands;
        occupied |= stands, all_occupied &= stands;
        free |= open, all_free &= open;
      }
    }
    if (all_occupied == layer) return Kind::kOccupied;
    if (all_free == layer) return Kind::kFree;
    return ((occupied | free) & layer) == 0 ? Kind::kUnknown : Kind::kInner;
  }

  // Of all that is known in a node of this level.
  static Kind kind_of(std::span<const VoxelCube> cubes, int level) {
    if (cubes.empty()) return Kind::kUnknown;
    const Kind first = kind_of(cubes[0], {0, 0, 0}, VoxelCube::kEdge);
    const bool is_whole = std::ssize(cubes) == std::int64_t{1} << (3 * (level - kCubeLevel));
    const bool is_one = is_whole && std::ranges::all_of(cubes, [first](const VoxelCube& cube) {
                          return kind_of(cube, {0, 0, 0}, VoxelCube::kEdge) == first;
                        });
    return is_one ? first : Kind::kInner;
  }

  void write_node(const std::array<Kind, 8>& children) {
    unsigned bits = 0;
    for (std::size_t i = 0; i < children.size(); ++i) {
      bits |= static_cast<unsigned>(children[i]) << (2 * i);
      if (children[i] != Kind::kUnknown) ++num_nodes_;
    }
    nodes_ += static_cast<char>(bits & 0xff);
    nodes_ += static_cast<char>(bits >> 8);
  }

  void write_tree(std::span<const VoxelCube> cubes, int level) {
    if (level == kCubeLevel) return write_cube(cubes[0], {0, 0, 0}, VoxelCube::kEdge);
    std::array<std::span<const VoxelCube>, 8> parts;
    std::array<Kind, 8> kinds{};
    for (unsigned i = 0; i < 8; ++i) {
      const auto end =
          std::ranges::partition_point(cubes, [&](const VoxelCube& cube) { return child_of(cube.corner, level) <= i; });
      parts[i] = cubes.first(static_cast<std::size_t>(end - cubes.begin()));
      cubes = cubes.subspan(parts[i].size());
      kinds[i] = kind_of(parts[i], level - 1);
    }
    write_node(kinds);
    for (std::size_t i = 0; i < 8; ++i)
      if (kinds[i] == Kind::kInner) write_tree(parts[i], level - 1);
  }

  void write_cube(const VoxelCube& cube, const Eigen::Vector3i& low, int edge) {
    std::array<Kind, 8> kinds{};
    const int half = edge / 2;
    const auto corner = [&](int i) { return Eigen::Vector3i(low + half * Eigen::Vector3i(i & 1, i >> 1 & 1, i >> 2)); };
    for (int i = 0; i < 8; ++i) kinds[static_cast<std::size_t>(i)] = kind_of(cube, corner(i), half);
    write_node(kinds);
    for (int i = 0; i < 8; ++i)
      if (kinds[static_cast<std::size_t>(i)] == Kind::kInner) write_cube(cube, corner(i), half);
  }

  std::int64_t num_nodes_ = 1;
  std::string nodes_;
};

// Whether one comes before the other in a file: by the children of the first node that has both in different ones.
bool is_before(const VoxelCube& a, const VoxelCube& b) {
  Eigen::Vector3i differ;
  for (int axis = 0; axis < 3; ++axis) differ[axis] = (a.corner[axis] + kMiddle) ^ (b.corner[axis] + kMiddle);
  int axis = 2;  // decides where more than one differs in the highest bit
  for (int other = 1; other >= 0; --other)
    if (differ[other] > differ[axis] && differ[axis] < (differ[axis] ^ differ[other])) axis = other;
  return a.corner[axis] < b.corner[axis];
}

}  // namespace

std::string octomap_of(std::vector<VoxelCube> cubes, double resolution_m) {
  std::erase_if(cubes, [](const VoxelCube& cube) {
    const Eigen::Array3i corner = cube.corner.array();
    return (corner < -kMiddle).any() || (corner >= kMiddle).any();
  });
  std::ranges::sort(cubes, is_before);
  std::string file = std::string(kBinaryMagic) + "\nid OcTree\nsize ";
  if (cubes.empty()) return file + "0\nres " + text_of(resolution_m) + "\ndata\n";
  const TreeWriter tree(cubes);
  file += std::to_string(tree.num_nodes()) + "\nres " + text_of(resolution_m) + "\ndata\n";
  return file += tree.nodes();
}

std::unique_ptr<octomap::OcTree> read_octomap(const std::string& path) {
  try {
    return read_checked(path);
  } catch (const Fault& fault) {
    throw std::runtime_error("'" + path + "' " + fault.what());
  }
}

}  // namespace swarm
