#include "map_daemon/octomap_file.h"

#include <array>
#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
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

}  // namespace

std::unique_ptr<octomap::OcTree> read_octomap(const std::string& path) {
  try {
    return read_checked(path);
  } catch (const Fault& fault) {
    throw std::runtime_error("'" + path + "' " + fault.what());
  }
}

}  // namespace swarm
