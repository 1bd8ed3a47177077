// What an OctoMap file holds or, without one, what is seen to stand, by exact distance: a voxel of configuration space
// that is free may have a corner that is too close to a wall, and through a door of little more than the robot's width
// it has to know which.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "map_daemon/static_map.h"

namespace swarm {

// Asked by halves of the SOGM's voxels along each axis; what was worked out is kept, as far as a fixed memory goes.
class Walls {
 public:
  // `static_map`: OctoMap file; empty: no walls. Throws what StaticMap throws.
  Walls(const std::string& static_map, double radius_m);

  // What is seen to stand, in its first frame: those are the walls where there is no file. Null: none. Kept by
  // reference until the next call.
  void see(const Sogm* standing);

  bool empty() const { return !has_file() && seen_ == nullptr; }
  // For voxels of this edge from now on.
  void set_resolution(double resolution_m);

  // What leads through voxels farther than this from the middles of those that a wall along the lattice fills leads
  // past the wall. 0: there are no walls.
  double way_m() const;

  // Whether a sphere of the radius with its centre anywhere in such an eighth of a voxel may touch a wall: index along
  // each axis of W, in halves of voxels.
  bool meet(std::int32_t x, std::int32_t y, std::int32_t z) {
    const std::uint64_t key = key_of(x, y, z);
    Known& known = known_[static_cast<std::size_t>(key * 0x9e3779b97f4a7c15u >> (64 - kKnownBits))];
    if (known.key != key || known.round != round_) known = {key, round_, work_out(x, y, z)};
    return known.meets;
  }
  bool meet(const Eigen::Vector3d& place) {
    return meet(floor_of(place.x() * per_m_), floor_of(place.y() * per_m_), floor_of(place.z() * per_m_));
  }

 private:
  struct Known {
    std::uint64_t key;
    std::uint32_t round;
    bool meets;
  };
  static constexpr int kKnownBits = 16;

  static std::uint64_t key_of(std::int32_t x, std::int32_t y, std::int32_t z) {
    constexpr std::uint64_t kMask = (std::uint64_t{1} << 21) - 1;
    const auto part = [](std::int32_t value) { return static_cast<std::uint64_t>(std::int64_t{value}) & kMask; };
    return part(x) << 42 | part(y) << 21 | part(z);
  }
  bool has_file() const { return cubes_.geometry().size.x() > 0; }
  bool work_out(std::int32_t x, std::int32_t y, std::int32_t z) const;
  // Between the middle of an eighth of a voxel and a wall.
  double least_m() const;

  StaticMap cubes_;             // of the file
  const Sogm* seen_ = nullptr;  // where there is none
  std::uint32_t round_ = 0;     // of what is seen
  double radius_m_, per_m_ = 20.0;
  std::vector<Known> known_;  // by hash: the newest
};

}  // namespace swarm
