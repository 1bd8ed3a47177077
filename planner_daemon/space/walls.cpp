#include "planner_daemon/space/walls.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "map_daemon/octomap_file.h"

namespace swarm {
namespace {

constexpr double kRoom_m = 0.005;  // beyond the radius: between what is looked at of a motion
// The same of what is seen, with how far a place may be from the middle of its eighth: less than that may be, as
// surfaces end somewhere inside their cubes.
constexpr double kRoomOfSeen_m = 0.02;
constexpr std::uint64_t kNobody = std::numeric_limits<std::uint64_t>::max();

StaticMap cubes_of(const std::string& path) {
  if (path.empty()) return {};
  const auto tree = read_octomap(path);
  return {*tree, path, tree->getResolution(), 0.0};
}

}  // namespace

Walls::Walls(const std::string& static_map, double radius_m) : cubes_(cubes_of(static_map)), radius_m_(radius_m) {
  if (has_file()) known_.assign(std::size_t{1} << kKnownBits, {kNobody, 0, false});
}

void Walls::see(const Sogm* standing) {
  if (has_file()) return;
  if (standing != nullptr && known_.empty()) known_.assign(std::size_t{1} << kKnownBits, {kNobody, 0, false});
  seen_ = standing;
  ++round_;
}

void Walls::set_resolution(double resolution_m) {
  if (per_m_ * resolution_m == 2.0) return;
  per_m_ = 2.0 / resolution_m;
  known_.assign(known_.size(), {kNobody, 0, false});
}

double Walls::least_m() const {
  return radius_m_ + (has_file() ? std::sqrt(3.0) / 2 / per_m_ + kRoom_m : kRoomOfSeen_m);
}

double Walls::way_m() const {
  if (empty()) return 0.0;
  const double voxel_m = 2.0 / per_m_, least = least_m() / voxel_m;
  const int open = static_cast<int>(std::ceil(least + 0.5 - 1e-9));  // beside a wall
  int closed2 = 0;
  for (int x = 0; x < open; ++x) {
    for (int y = 0; y < open; ++y) {
      for (int z = 0; z < open; ++z) {
        const Eigen::Array3d gap = Eigen::Array3d(x, y, z) - 0.5;
        const int distance2 = x * x + y * y + z * z;
        if (distance2 < open * open && gap.max(0.0).matrix().norm() < least) closed2 = std::max(closed2, distance2);
      }
    }
  }
  return (std::sqrt(closed2) + 1e-3) * voxel_m;
}

bool Walls::work_out(std::int32_t x, std::int32_t y, std::int32_t z) const {
  const Eigen::Vector3d middle = (Eigen::Vector3d(x, y, z).array() + 0.5) / per_m_;
  return has_file() ? cubes_.meets(middle, least_m()) : cubes_meet(*seen_, middle, least_m());
}

}  // namespace swarm
