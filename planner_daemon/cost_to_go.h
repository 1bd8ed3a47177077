// Cost to go among what moves: how much longer the way to the goal takes than the straight one, from every cell of the
// window and every frame of the SOGM, for a point that turns at once but is never faster than the robot. The search's
// heuristic knows by it where the gaps will be, which the paper names as its weakness (section VI: deadlock for want of
// guidance).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "map_daemon/partial_sogm.h"
#include "planner_daemon/guidance.h"

namespace swarm {

class CostToGo {
 public:
  // Dynamic programming, backwards through the frames of `blocked` (configuration space), over cells of two voxels'
  // edge (closed when all their voxels are occupied) and only where `reach` comes to (and a cell beyond). In a frame
  // the point moves as many cells as the speed allows, along all axes at once; a closed cell may be passed at the price
  // of kClosedFrames per frame. After the last frame only what stands still is left: `guidance`; null: nothing.
  void build(const Sogm& blocked, const Guidance* guidance, const Reach& reach, const Eigen::Vector3d& goal,
             const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max);

  static constexpr int kClosedFrames = 10;

  int frame_at(std::int64_t utime) const;  // nearest start of a frame; num_frames: after the last
  // Index along an axis of the cell that holds a coordinate [m]; -1 where nothing is known in this frame.
  int cell_of(int frame, int axis, double coordinate) const {
    const double cell = (coordinate - corner_[axis]) * inverse_cell_;
    const Box& box = boxes_[static_cast<std::size_t>(frame)];
    return cell >= box.first[axis] && cell < box.last[axis] + 1 ? static_cast<int>(cell) : -1;
  }
  // Detour or wait ahead of a point in that cell at the start of that frame [s]; 0 for indices of -1 and where all that
  // can follow is unknown.
  double delay_s(int frame, int x, int y, int z) const {
    if ((x | y | z) < 0) return 0.0;
    const Value value = values_[column(frame, x, y) + static_cast<std::size_t>(z)];
    return value < kFar ? std::max(0, value - frame * kTicksPerFrame - straight(x, y, z)) * tick_s_ : 0.0;
  }

 private:
  using Value = std::int16_t;  // [ticks]
  static constexpr int kTicksPerFrame = 16;
  static constexpr Value kFar = 30'000;  // beyond what is known, and the most that is told apart
  static constexpr Value kPenalty = kClosedFrames * kTicksPerFrame;
  struct Box {  // cells; the last ones included
    Eigen::Vector3i first = Eigen::Vector3i::Zero(), last = Eigen::Vector3i::Constant(-1);
  };

  std::size_t column(int frame, int x, int y) const {  // a rim of far cells around each frame
    return ((static_cast<std::size_t>(frame) * (size_.x() + 2) + x + 1) * (size_.y() + 2) + y + 2) * stride_;
  }
  Value straight(int x, int y, int z) const {  // without anything in the way
    return std::max({straight_[0][static_cast<std::size_t>(x)], straight_[1][static_cast<std::size_t>(y)],
                     straight_[2][static_cast<std::size_t>(z)]});
  }
  void lay_out(const Sogm& blocked, const Eigen::Vector3d& goal, double speed_mps);
  void finish(const Guidance* guidance, double speed_mps);
  void limit_space(double low_z, double high_z, int words_per_column);
  Box reached(const Reach& reach, int frame) const;
  void isolate(int frame, const Box& around);
  void stay(int from, int to, const Box& box);
  void spread(int from, int to, const Box& box, const std::vector<Value>& added);
  void close(const Sogm& blocked, int frame);

  double inverse_cell_ = 5.0, tick_s_ = 0.01;
  std::int64_t start_utime_ = 0, frame_duration_us_ = 100'000;
  int num_frames_ = 0;
  Eigen::Vector3d corner_ = Eigen::Vector3d::Zero();  // of the window, W [m]
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();    // cells
  Eigen::Vector3i goal_ = Eigen::Vector3i::Zero();    // cell
  std::size_t stride_ = 0;                            // cells of a column, padded
  std::vector<Box> boxes_;                            // by frame: what is known
  std::array<std::vector<Value>, 3> straight_;        // by axis and cell
  std::vector<std::uint64_t> space_;                  // of one column: cells inside the flight space
  std::vector<std::uint64_t> in_space_;               // of one column: bit 2 z of a cell inside the flight space
  std::vector<Value> open_, shut_;                    // what a frame adds to a row of cells: nothing; outside the space
  std::vector<Value> rim_;                            // of a row: kFar between the columns
  std::vector<Value> values_;                         // frame, x, y, z: when the goal is reached, after the first frame
  std::vector<Value> along_z_, along_y_;              // rows of a frame
  std::vector<Value> around_;                         // steps of the guidance, one column
};

}  // namespace swarm
