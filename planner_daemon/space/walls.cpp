#include "planner_daemon/space/walls.h"

#include <cmath>
#include <limits>

#include "map_daemon/octomap_file.h"

namespace swarm {
namespace {

constexpr double kRoom_m = 0.005;  // beyond the radius: between what is looked at of a motion
constexpr std::uint64_t kNobody = std::numeric_limits<std::uint64_t>::max();

StaticMap cubes_of(const std::string& path) {
  if (path.empty()) return {};
  const auto tree = read_octomap(path);
  return {*tree, path, tree->getResolution(), 0.0};
}

}  // namespace

Walls::Walls(const std::string& static_map, double radius_m) : cubes_(cubes_of(static_map)), radius_m_(radius_m) {
  if (!empty()) known_.assign(std::size_t{1} << kKnownBits, {kNobody, false});
}

void Walls::set_resolution(double resolution_m) {
  if (per_m_ * resolution_m == 2.0) return;
  per_m_ = 2.0 / resolution_m;
  known_.assign(known_.size(), {kNobody, false});
}

bool Walls::work_out(std::int32_t x, std::int32_t y, std::int32_t z) const {
  const Eigen::Vector3d middle = (Eigen::Vector3d(x, y, z).array() + 0.5) / per_m_;
  return cubes_.meets(middle, radius_m_ + std::sqrt(3.0) / 2 / per_m_ + kRoom_m);
}

}  // namespace swarm
