// What stands still, wherever it was seen: an OctoMap and what the SOGMs showed since.
#pragma once

#include <octomap/OcTree.h>

#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "map_daemon/dilation.h"
#include "map_daemon/static_map.h"

namespace swarm {

// A grid that grows with what it is told to hold, but never beyond kMaxVoxels: then it holds less, and at the least
// what lies around the robot.
class GlobalMap {
 public:
  static constexpr double kMaxVoxels =
      1 << 28;  // 32 MB for each of two grids, or three with sensors that do not see all

  // `static_map`: OctoMap file; empty: none. The robot's centre stays within [space_min, space_max], W [m]. `explores`:
  // without a file, what is seen to stand is a building, whose walls and furniture go on above and below where nobody
  // looked yet. Throws what read_octomap() throws.
  GlobalMap(const std::string& static_map, const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max,
            bool explores = false);

  // Takes in what stands still in the window of `sogm`: tiles of it in which nothing changes from frame to frame.
  // `standing`, of the same window, is what is occupied in all frames and was seen; `seen` what was seen at all: of the
  // rest nothing is learned, but where walls go on there, as long as what they go on from stands; and what is gone is
  // forgotten wherever it is seen. Null: all is seen, but certainly only near the robot, in the middle of the window,
  // and only there it is forgotten. True: the map is another one now.
  // Throws what StaticMap throws when the first SOGM comes, or one of other voxels: then nothing but the file is kept.
  bool see(const Sogm& sogm, const Sogm& standing, const Sogm* seen, const Eigen::Vector3d& goal, double blocked_m);
  // All that was seen, but not the file. True: there was something.
  bool forget_seen();

  // Nothing stands anywhere.
  bool empty() const { return empty_; }
  // Whether the robot's centre may be in a voxel of the lattice, as far as the flight space goes.
  bool in_flight_space(const Eigen::Vector3i& voxel) const {
    return in_flight_space(0, voxel.x()) && in_flight_space(1, voxel.y()) && in_flight_space(2, voxel.z());
  }
  // What stands in a building: by the file, and by what was seen since. Null: there is no file and nobody explores, or
  // nothing was seen yet.
  const Sogm* known() const { return file_ || free_.num_frames > 0 ? &occupied_ : nullptr; }
  // Where the robot's centre may not be, or beyond the flight space: one frame. Bits above the grid are set.
  const Sogm& blocked() const { return blocked_; }

 private:
  // Voxels of the lattice: [first, last].
  struct Box {
    Eigen::Vector3i first, last;

    GridGeometry geometry(double resolution_m) const {
      return {resolution_m, first, last - first + Eigen::Vector3i::Ones()};
    }
    double voxels() const { return (last - first + Eigen::Vector3i::Ones()).cast<double>().prod(); }
    Box united(const Box& other) const { return {first.cwiseMin(other.first), last.cwiseMax(other.last)}; }
    Box grown(int voxels) const { return {first.array() - voxels, last.array() + voxels}; }
    Box cut(const Box& other) const { return {first.cwiseMax(other.first), last.cwiseMin(other.last)}; }
    bool holds(const Box& other) const { return united(other).first == first && united(other).last == last; }
  };
  static Box box_of(const GridGeometry& geometry) {
    return {geometry.origin, geometry.origin + geometry.size - Eigen::Vector3i::Ones()};
  }

  bool in_flight_space(int axis, int voxel) const {
    const double low = voxel * occupied_.geometry.resolution_m;
    return low + occupied_.geometry.resolution_m >= space_min_[axis] && low <= space_max_[axis];
  }
  // Of this column look_ was seen to be free, stands_ to stand. True: the map is another one now.
  bool learn_column(int x, int y);
  bool cover(const GridGeometry& window, const Eigen::Vector3d& goal);
  void lay_out(const Box& box, double resolution_m);
  void block(const Columns& columns);
  void block_all();

  std::string static_map_;
  double blocked_m_ = 0.0;
  Eigen::Vector3d space_min_, space_max_;
  bool explores_;
  std::unique_ptr<octomap::OcTree> tree_;
  std::optional<StaticMap> file_;  // its voxels
  Sogm occupied_, blocked_;        // one frame each, the same geometry
  Sogm free_;  // the same: was seen free, and not to stand since; none: all is seen, or a file tells
  bool empty_ = true;
  Dilator dilator_;
  std::vector<std::uint64_t> column_, inside_, standing_, known_;  // scratch
  std::vector<std::uint64_t> look_, stands_, gone_, through_;      // of a column, as well
};

}  // namespace swarm
