#include "swarm_sim/world/building.h"

#include <array>
#include <cstdint>

#include "lcmtypes/bus/text.h"
#include "map_daemon/dilation.h"
#include "map_daemon/octomap_file.h"
#include "map_daemon/static_map.h"

namespace swarm {
namespace {

constexpr double kBeside_m = 0.15;  // of room on the way: through doors 0.7 m wide for a robot of 0.2 m
constexpr double kAround_m = 0.3;   // where it starts and stops

// Voxels of a grid by number, x before y before z.
class Numbers {
 public:
  explicit Numbers(const Eigen::Vector3i& size) : size_(size) {}

  std::size_t count() const {
    return static_cast<std::size_t>(size_.x()) * static_cast<std::size_t>(size_.y()) *
           static_cast<std::size_t>(size_.z());
  }
  Eigen::Vector3i voxel(std::size_t number) const {
    const auto y = static_cast<std::size_t>(size_.y()), z = static_cast<std::size_t>(size_.z());
    return {static_cast<int>(number / (y * z)), static_cast<int>(number / z % y), static_cast<int>(number % z)};
  }
  std::size_t number(const Eigen::Vector3i& voxel) const {
    return (static_cast<std::size_t>(voxel.x()) * static_cast<std::size_t>(size_.y()) +
            static_cast<std::size_t>(voxel.y())) *
               static_cast<std::size_t>(size_.z()) +
           static_cast<std::size_t>(voxel.z());
  }

 private:
  Eigen::Vector3i size_;
};

// To what world files hold of it.
Eigen::Vector3d rounded(const Eigen::Vector3d& place) {
  return (place.array() * 1e6).round() / 1e6;
}

// Of the voxels that are `open`, the largest set that hangs together by their faces.
std::vector<std::size_t> largest_part(std::vector<bool> open, const GridGeometry& grid, const Numbers& numbers) {
  static const std::array<Eigen::Vector3i, 6> kSteps = {Eigen::Vector3i(1, 0, 0), Eigen::Vector3i(-1, 0, 0),
                                                        Eigen::Vector3i(0, 1, 0), Eigen::Vector3i(0, -1, 0),
                                                        Eigen::Vector3i(0, 0, 1), Eigen::Vector3i(0, 0, -1)};
  std::vector<std::size_t> largest;
  for (std::size_t seed = 0; seed < open.size(); ++seed) {
    if (!open[seed]) continue;
    open[seed] = false;
    std::vector<std::size_t> part = {seed};
    for (std::size_t i = 0; i < part.size(); ++i) {
      for (const Eigen::Vector3i& step : kSteps) {
        const Eigen::Vector3i next = numbers.voxel(part[i]) + step;
        if (!grid.contains(next) || !open[numbers.number(next)]) continue;
        open[numbers.number(next)] = false;
        part.push_back(numbers.number(next));
      }
    }
    if (part.size() > largest.size()) largest = std::move(part);
  }
  return largest;
}

}  // namespace

Building building_in(const std::filesystem::path& map, double radius_m, const Eigen::Vector2d& heights_m) {
  const auto tree = read_octomap(map.string());
  const double voxel_m = StaticMap::fitting_voxel_m(tree->getResolution());
  const StaticMap stands(*tree, map.string(), voxel_m, 0.0);
  const GridGeometry& grid = stands.geometry();
  Sogm walls, on_the_way, around;
  walls.reset(grid, 1, Utime(), 1us);
  stands.copy_into(&walls);
  // From middle to middle, so half a voxel more; so much room suffices.
  const double half_m = voxel_m / 2 - 1e-6;
  dilate(walls, radius_m + kBeside_m + half_m, &on_the_way);
  dilate(walls, radius_m + kAround_m + half_m, &around);
  const Numbers numbers(grid.size);
  std::vector<bool> open(numbers.count());
  for (std::size_t i = 0; i < open.size(); ++i) {
    const Eigen::Vector3i voxel = numbers.voxel(i);
    const Eigen::Vector3d place = grid.center_of(voxel);
    if (place.z() < heights_m[0] + radius_m || place.z() > heights_m[1] - radius_m) continue;
    if (on_the_way.occupied(0, voxel)) continue;
    const octomap::OcTreeNode* node = tree->search(place.x(), place.y(), place.z());
    open[i] = node != nullptr && !tree->isNodeOccupied(node);
  }
  std::vector<std::size_t> part = largest_part(std::move(open), grid, numbers);
  std::ranges::sort(part);
  Building building;
  building.space.min = rounded(grid.origin.cast<double>() * voxel_m);
  building.space.max = rounded((grid.origin + grid.size).cast<double>() * voxel_m);
  building.space.min.z() = heights_m[0], building.space.max.z() = heights_m[1];
  for (const std::size_t number : part) {
    const Eigen::Vector3i voxel = numbers.voxel(number);
    if (!around.occupied(0, voxel)) building.places.push_back(rounded(grid.center_of(voxel)));
  }
  if (building.places.empty())
    throw WorldError("building: " + map.string() + " must hold free space for a robot of radius " + text_of(radius_m) +
                     " m between heights " + text_of(heights_m[0]) + " and " + text_of(heights_m[1]) + " m");
  return building;
}

}  // namespace swarm
