// What is known of the space around a robot, from where the rays of its range sensors end and what they pass: what is
// occupied, what was free for so long that whatever is there now must have come, what was not seen at all. A window of
// voxels moves with the robot; of each voxel a few bits are kept, and all 64 voxels of a column are updated at once.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "lcmtypes/bus/time.h"
#include "map_daemon/perception/range_scan.h"
#include "map_daemon/sogm.h"

namespace swarm {

// Where single rays may err: what one met is not occupied until another meets it. Alone: where rays passed, before or in
// the same scan, and where nothing else of that scan is beside it: at edges rays mix what is before them with what is
// behind.
enum class Doubt { kNowhere, kAlone, kEverywhere };

class FreeSpaceGrid {
 public:
  static constexpr int kEdge = 128;   // voxels of the window along x and y
  static constexpr int kHeight = 64;  // and along z: one word a column

  // `memory`: what was not seen for so long is unknown again (up to half as much longer).
  FreeSpaceGrid(double resolution_m, Duration memory);

  // Moves the window so that `place` (W [m]) is in its middle; of what comes into it nothing is known.
  void move_to(const Eigen::Vector3d& place);

  // One scan: whatever its rays pass and where they end, then finish(). Places outside the window are ignored.
  // `are_sparse`: there are few beams, one above the other, so that what is flat is passed from just above far more
  // often than met; it is not taken to be gone for that.
  void see_free(std::span<const RangeScan::Ray> rays, bool are_sparse = false);
  void see_free(const Eigen::Vector3d& from, const Eigen::Vector3d& to, bool are_sparse = false) {
    const RangeScan::Ray ray{from, to};
    see_free({&ray, 1}, are_sparse);
  }
  // What is so near, but no more than `half_height_m` above or below.
  void see_free_around(const Eigen::Vector3d& place, double radius_m, double half_height_m);
  // So far around, where the rays of this scan pass at the height of `place`, it is free so far above and below.
  void see_free_along(const Eigen::Vector3d& place, double radius_m, double half_height_m);
  // What is so near and known stays known.
  void keep_around(const Eigen::Vector3d& place, double radius_m);
  void see_surface(const Eigen::Vector3d& place) { see_surface_in(geometry_.voxel_of(place)); }
  void see_surface_in(const Eigen::Vector3i& voxel);  // of the window
  // Columns with surfaces in this scan.
  const std::vector<int>& surface_columns() const { return surface_columns_; }
  // A surface of what moves: it is not kept as occupied.
  void mark_moving(const Eigen::Vector3d& place) { mark_moving_in(geometry_.voxel_of(place)); }
  void mark_moving_in(const Eigen::Vector3i& voxel);
  void finish(Utime utime, Doubt doubt);
  // What was known to stand in this column, in the order of the window: where nothing else is known it stands, until it
  // is seen free.
  void recall(int column, std::uint64_t standing);
  // The clock was set by `step`.
  void shift(Duration step) { seen_since_ += step, lasting_since_ += step; }

  // The window; columns are numbered by column_of(), bit k of a word is voxel k of the window along z.
  const GridGeometry& geometry() const { return geometry_; }
  int column_of(int x, int y) const {
    return ((x + geometry_.origin.x()) & (kEdge - 1)) * kEdge + ((y + geometry_.origin.y()) & (kEdge - 1));
  }
  Eigen::Vector2i place_of(int column) const {
    return {(column / kEdge - geometry_.origin.x()) & (kEdge - 1),
            (column % kEdge - geometry_.origin.y()) & (kEdge - 1)};
  }
  // surfaces() and free() are of this scan, the others of what was known before it.
  std::uint64_t surfaces(int column) const { return turned(surfaces_[static_cast<std::size_t>(column)]); }
  std::uint64_t free(int column) const { return turned(free_[static_cast<std::size_t>(column)]); }
  std::uint64_t occupied(int column) const { return turned(occupied_[static_cast<std::size_t>(column)]); }
  // Was free in ten scans one after the other, and not occupied for four seconds since.
  std::uint64_t ever_free(int column) const { return turned(column_at(column).ever_free); }
  // Occupied for two to four seconds.
  std::uint64_t lasting(int column) const {
    const Column& known = column_at(column);
    return turned(known.lasting & known.lasting_before);
  }
  std::uint64_t seen(int column) const { return turned(seen_[static_cast<std::size_t>(column)]); }

 private:
  static constexpr std::size_t kColumns = std::size_t{kEdge} * kEdge;

  // Numbers are kept bit by bit: bit i of each of 64 numbers is in word i.
  struct Column {
    std::array<std::uint64_t, 3> certainty;   // of being occupied, 0 to 7
    std::array<std::uint64_t, 4> free_scans;  // without a break, counted up to 15
    std::uint64_t occupied;                   // of what is likely, that which was met again or not doubted
    std::uint64_t passed;                     // by rays since it was met, and not only at its rim
    std::uint64_t ever_free, lasting, lasting_before;
    std::array<std::uint64_t, 3> seen_lately;  // in this stretch of time and the two before

    std::uint64_t likely() const { return certainty[0] | certainty[1] | certainty[2]; }
    std::uint64_t seen() const { return seen_lately[0] | seen_lately[1] | seen_lately[2]; }
  };
  // A ray in the window as it lies in memory: places and steps in voxels, fixed point.
  struct Walk {
    std::uint32_t x, y, z, dx, dy, dz;
    int steps;
  };
  static Column unknown();
  // What one scan saw of a column. `passed`: by rays, and not only at its rim; `beside`: the neighbours of surfaces.
  struct Sight {
    std::uint64_t free, passed, surfaces, moving, beside;
  };
  static void learn(const Sight& seen, Doubt doubt, Column* column);

  Walk walk_along(const RangeScan::Ray& ray) const;
  void forget_column(std::size_t column);
  const Column& column_at(int column) const { return columns_[static_cast<std::size_t>(column)]; }
  // In the order of the window.
  std::uint64_t turned(std::uint64_t word) const;
  // The voxels of a column, in its own order, that are no further above or below.
  std::uint64_t layer(const Eigen::Vector3d& place, double half_height_m) const;
  void forget_old(Utime utime);
  template <class Visit>
  void for_each_column_of_ball(const Eigen::Vector3d& place, double radius_m, const Visit& visit) const;

  Duration memory_;
  GridGeometry geometry_;
  bool is_placed_ = false;
  std::vector<Column> columns_;
  std::vector<std::uint64_t> occupied_, seen_;  // by `columns_`: whoever reads them all reads so much less
  std::vector<std::uint64_t> free_, passed_, surfaces_, moving_, beside_;  // of this scan
  std::vector<int> surface_columns_;
  Utime seen_since_{}, lasting_since_{};
};

}  // namespace swarm
