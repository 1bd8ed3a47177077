// The space-time heuristic: the cost to go among what moves, that is how much longer the way to the goal takes than the
// straight one, from every cell of the window at every step of time, for a point that turns at once but is never faster
// than the robot. The search's heuristic knows by it where the gaps will be, which the paper names as its weakness
// (section VI: deadlock for want of guidance).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "planner_daemon/search/static_heuristic.h"
#include "planner_daemon/space/occupancy.h"
#include "planner_daemon/space/reachability.h"

namespace swarm {

class SpaceTimeHeuristic {
 public:
  // Dynamic programming, backwards through the time of the map, over cells of kCellVoxels' edge, only where `reachable`
  // comes to (and a cell beyond). A step lasts as long as the point takes for one cell along an axis; in a step it
  // moves to any of the 26 neighbours or waits. A cell is closed in a step when nearly all of it is: when its middle
  // voxel lies within `blocked_m` of something occupied in the frame in force at the middle of the step;
  // it may be passed at the price of kClosedSteps. After the map's last frame only what stands still is left:
  // `static_heuristic`; null or empty: nothing.
  void build(const Occupancy& occupancy, double blocked_m, const StaticHeuristic* static_heuristic,
             const ReachableSet& reachable, const Eigen::Vector3d& goal, const Eigen::Vector3d& space_min,
             const Eigen::Vector3d& space_max);

  static constexpr int kClosedSteps = 7;

  int num_steps() const { return num_steps_; }
  int step_at(Utime utime) const;  // nearest start of a step; num_steps(): after the last
  // Index along an axis of the cell that holds a coordinate [m]; -1 where nothing is known in this step. A rest of the
  // window that is less than a cell counts as the last cell.
  int cell_of(int step, int axis, double coordinate) const {
    const double cell = (coordinate - corner_[axis]) * inverse_cell_;
    if (!(cell >= 0.0 && cell < edge_[axis])) return -1;
    const int index = std::min(static_cast<int>(cell), size_[axis] - 1);
    const Box& box = boxes_[static_cast<std::size_t>(step)];
    return index >= box.first[axis] && index <= box.last[axis] ? index : -1;
  }
  // Detour or wait ahead of a point in that cell at the start of that step [s], compared with the straight way to the
  // target and on from there; below 0 for one that need not go to the target. 0 for indices of -1, kNoWay_s where no
  // way is known.
  static constexpr double kNoWay_s = 3.0;
  double delay_s(int step, int x, int y, int z) const {
    if ((x | y | z) < 0) return 0.0;
    const Value value = values_[column(step, x, y) + static_cast<std::size_t>(z)];
    return value < kFar ? (value - step * kTicksPerStep - straight(x, y, z)) * tick_s_ : kNoWay_s;
  }
  // Where the straight way leads: the goal, or a place on the way there; and how long it takes from there on [s].
  const Eigen::Vector3d& target() const { return target_; }
  double rest_s() const { return rest_ * tick_s_; }

 private:
  using Value = std::int16_t;  // [ticks]
  static constexpr int kTicksPerStep = 16;
  // Beyond what is known, and the most that is told apart; all steps and their penalties more still fit.
  static constexpr Value kFar = 29'000;
  static constexpr Value kPenalty = kClosedSteps * kTicksPerStep;
  struct Box {  // cells; the last ones included
    Eigen::Vector3i first = Eigen::Vector3i::Zero(), last = Eigen::Vector3i::Constant(-1);

    Columns columns() const { return {first.head<2>(), last.head<2>()}; }
  };

  std::size_t column(int step, int x, int y) const {  // a rim of far cells around each step
    return static_cast<std::size_t>((Eigen::Index{step} * (size_.x() + 2) + x + 1) * (size_.y() + 2) + y + 2) * stride_;
  }
  std::size_t around_of(int x, int y) const {
    return static_cast<std::size_t>(Eigen::Index{x} * size_.y() + y) * stride_;
  }
  std::size_t middles_of(int x, int y) const {
    return static_cast<std::size_t>(Eigen::Index{x} * size_.y() + y) * space_middles_.size();
  }
  Value straight(int x, int y, int z) const {  // without anything in the way
    return static_cast<Value>(
        rest_ + std::max({straight_[0][static_cast<std::size_t>(x)], straight_[1][static_cast<std::size_t>(y)],
                          straight_[2][static_cast<std::size_t>(z)]}));
  }
  void lay_out(const Sogm& sogm, const Eigen::Vector3d& goal, double speed_mps);
  void limit_space(double low_z, double high_z, const GridGeometry& grid);
  void finish(const StaticHeuristic* static_heuristic);
  Box reachable_cells(const ReachableSet& reachable, int step) const;
  void isolate(int step, const Columns& around);
  void spread(int step);
  void leave(int step);
  void close(int step, const Occupancy& occupancy);

  double cell_m_ = 0.3, inverse_cell_ = 1 / 0.3, step_s_ = 0.15, tick_s_ = 0.01;
  Utime start_utime_{};
  int num_steps_ = 0;
  Eigen::Vector3i origin_ = Eigen::Vector3i::Zero();  // of the window, in the lattice
  Eigen::Vector3d corner_ = Eigen::Vector3d::Zero();  // W [m]
  Eigen::Vector3d edge_ = Eigen::Vector3d::Zero();    // of the window [cells]
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();    // cells
  Eigen::Vector3i goal_ = Eigen::Vector3i::Zero();    // cell
  Eigen::Vector3d target_ = Eigen::Vector3d::Zero();
  int rest_ = 0;                                // [ticks]
  std::size_t stride_ = 0;                      // cells of a column, padded
  std::vector<Box> boxes_;                      // by step: what is known
  std::array<std::vector<Value>, 3> straight_;  // by axis and cell
  CellSpan space_;                              // of one column: inside the flight space
  std::vector<std::uint64_t> space_middles_;    // of one column: bits of the cells' middle voxels inside it
  std::vector<std::uint64_t> open_middles_;     // x, y: those of them that nothing that stands still is close to
  std::vector<Value> shut_;                     // what a step adds to a row of cells outside the flight space
  std::vector<Value> around_;  // x, y, z: least time to the goal around what stands still; kFar between the columns
  std::vector<Value> values_;  // step, x, y, z: when the goal is reached, after the first step
  std::vector<Value> along_z_, along_y_;  // rows of a step
  Dilator dilator_;
  std::vector<Layer> layers_;
  std::vector<std::uint64_t> closed_;  // columns of a step
};

}  // namespace swarm
