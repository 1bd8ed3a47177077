#include "planner_daemon/cost_to_go.h"

#include <algorithm>
#include <cmath>

#include "map_daemon/wide.h"

namespace swarm {
namespace {

constexpr std::int16_t kFar = 30'000;      // [ticks], beside the window
constexpr std::int16_t kLongest = 15'000;  // [ticks], any way after the last frame: more is not told apart
constexpr int kTicksPerFrame = 16;

// The least of each value and its neighbours `step` before and after.
SWARM_WIDE void least_of_three(const std::int16_t* __restrict in, std::size_t step, std::size_t n,
                               std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = std::min(in[i], std::min(in[i - step], in[i + step]));
}

SWARM_WIDE void least_of_rows(const std::int16_t* __restrict a, const std::int16_t* __restrict b,
                              const std::int16_t* __restrict c, std::size_t n, std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = std::min(a[i], std::min(b[i], c[i]));
}

void greatest_of(const std::int16_t* __restrict in, std::int16_t least, std::size_t n, std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = std::max(in[i], least);
}

// By the bits of eight cells: what each of them costs when its bit is set [ticks].
struct PenaltyTable {
  explicit PenaltyTable(std::int16_t penalty) {
    for (std::size_t bits = 0; bits < 256; ++bits) {
      for (std::size_t k = 0; k < 8; ++k) of[bits][k] = (bits >> k & 1) != 0 ? penalty : 0;
    }
  }
  std::array<std::array<std::int16_t, 8>, 256> of;
};

}  // namespace

int CostToGo::frame_at(std::int64_t utime) const {
  const double frames = static_cast<double>(utime - start_utime_) / static_cast<double>(frame_duration_us_);
  return std::clamp(static_cast<int>(std::lround(frames)), 0, num_frames_);
}

void CostToGo::build(const Sogm& blocked, const Sogm& standing, const Reach& reach, const Eigen::Vector3d& goal,
                     const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max) {
  lay_out(blocked, goal, reach.speed_mps);
  const double moves_per_frame = reach.speed_mps * 1e-6 * static_cast<double>(frame_duration_us_) * inverse_cell_;
  const auto moves = [moves_per_frame](int frame) {
    return static_cast<int>(std::floor((frame + 1) * moves_per_frame + 0.5)) -
           static_cast<int>(std::floor(frame * moves_per_frame + 0.5));
  };
  // Where the robot is, three cells to each side for rounding, then as many more per frame as it may move.
  const auto grown = [this](const Box& box, int cells) {
    Box out{(box.first.array() - cells).max(0), (box.last.array() + cells).min(size_.array() - 1)};
    out.first.z() = 0;
    out.last.z() = size_.z() - 1;
    return out;
  };
  const Eigen::Vector3i at = ((reach.center - corner_) * inverse_cell_).array().floor().matrix().cast<int>();
  const int first = std::max(0, frame_at(reach.utime) - 1);
  Box box = grown({at, at}, 3);
  for (int frame = 0; frame <= num_frames_; ++frame) {
    if (frame > first) box = grown(box, moves(frame - 1));
    boxes_[static_cast<std::size_t>(frame)] = box;
  }
  finish(standing, goal, 1.0 / (reach.speed_mps * tick_s_), space_min, space_max);
  for (int frame = num_frames_ - 1; frame >= first; --frame) {
    const int n = moves(frame);
    if (n == 0) copy(frame + 1, frame);
    for (int move = 0; move < n; ++move)
      spread(move == 0 ? frame + 1 : frame, frame, grown(boxes_[static_cast<std::size_t>(frame)], n - 1 - move));
    pass_time(blocked, frame);
  }
}

void CostToGo::lay_out(const Sogm& blocked, const Eigen::Vector3d& goal, double speed_mps) {
  const GridGeometry& grid = blocked.geometry;
  const Eigen::Vector3i size = (grid.size + Eigen::Vector3i::Ones()) / 2;
  const double cell_m = 2 * grid.resolution_m;
  inverse_cell_ = 1.0 / cell_m;
  start_utime_ = blocked.start_utime;
  frame_duration_us_ = blocked.frame_duration_us;
  tick_s_ = 1e-6 * static_cast<double>(frame_duration_us_) / kTicksPerFrame;
  corner_ = grid.origin.cast<double>() * grid.resolution_m;
  if (size != size_ || num_frames_ != blocked.num_frames) {
    size_ = size;
    num_frames_ = blocked.num_frames;
    stride_ = (static_cast<std::size_t>(size_.z()) + 8) / 8 * 8;  // at least one more, so that columns do not mix
    boxes_.resize(static_cast<std::size_t>(num_frames_) + 1);
    values_.assign(column(num_frames_, size_.x(), size_.y()) + 2 * stride_, kFar);
    along_z_.resize((static_cast<std::size_t>(size_.y()) + 2) * stride_);
    along_y_.resize(3 * along_z_.size());
    open_.resize((static_cast<std::size_t>(size_.z()) + 63) / 64);
  }
  for (int axis = 0; axis < 3; ++axis) {
    auto& straight = straight_[static_cast<std::size_t>(axis)];
    straight.resize(static_cast<std::size_t>(size_[axis]));
    for (int i = 0; i < size_[axis]; ++i) {
      const double way_m = std::abs(goal[axis] - corner_[axis] - cell_m * (i + 0.5));
      straight[static_cast<std::size_t>(i)] =
          static_cast<Value>(std::min<double>(kLongest, std::round(way_m / speed_mps / tick_s_)));
    }
  }
  goal_ = ((goal - corner_) * inverse_cell_).array().floor().matrix().cast<int>();
}

// After the last frame only what stands still is in the way.
void CostToGo::finish(const Sogm& standing, const Eigen::Vector3d& goal, double ticks_per_m,
                      const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max) {
  const bool guided = guidance_.build(standing, goal, space_min.z(), space_max.z());
  space_ = cells_between(corner_.z(), 1.0 / inverse_cell_, size_.z(), space_min.z(), space_max.z());
  const Box& box = boxes_.back();
  for (int x = box.first.x(); x <= box.last.x(); ++x) {
    for (int y = box.first.y(); y <= box.last.y(); ++y) {
      Value* out = values_.data() + column(num_frames_, x, y);
      const Value side = std::max(straight_[0][static_cast<std::size_t>(x)], straight_[1][static_cast<std::size_t>(y)]);
      greatest_of(straight_[2].data(), side, straight_[2].size(), out);
      for (int z = 0; guided && z < size_.z(); ++z) {
        const double way_ticks = std::min<double>(kLongest, guidance_.way_m(x, y, z) * ticks_per_m);
        out[z] = std::max(out[z], static_cast<Value>(way_ticks));
      }
    }
  }
}

// Keeps columns from mixing: far cells on top of each.
void CostToGo::separate(Value* columns, std::size_t n) const {
  for (std::size_t i = 0; i < n; i += stride_) std::fill(columns + i + size_.z(), columns + i + stride_, kFar);
}

// The point stays: a frame too short for one cell.
void CostToGo::copy(int from, int to) {
  const Box& box = boxes_[static_cast<std::size_t>(to)];
  const std::size_t n = static_cast<std::size_t>(std::max(0, box.last.y() - box.first.y() + 1)) * stride_;
  for (int x = box.first.x(); x <= box.last.x(); ++x) {
    Value* out = values_.data() + column(to, x, box.first.y());
    std::copy_n(values_.data() + column(from, x, box.first.y()), n, out);
    separate(out, n);
  }
}

// One move: the least value of each cell and its neighbours.
void CostToGo::spread(int from, int to, const Box& box) {
  const int first_y = box.first.y(), n_y = box.last.y() - first_y + 1;
  if (n_y <= 0) return;
  const std::size_t n = static_cast<std::size_t>(n_y) * stride_;
  const auto row = [&](int x) { return along_y_.data() + static_cast<std::size_t>((x + 3) % 3) * along_z_.size(); };
  for (int x = box.first.x() - 1; x <= box.last.x() + 1; ++x) {
    least_of_three(values_.data() + column(from, x, first_y - 1), 1, n + 2 * stride_, along_z_.data());
    least_of_three(along_z_.data() + stride_, stride_, n, row(x));
    if (x <= box.first.x()) continue;
    Value* out = values_.data() + column(to, x - 1, first_y);
    least_of_rows(row(x - 2), row(x - 1), row(x), n, out);
    separate(out, n);
  }
}

// A frame goes by in each cell; at the goal it is over.
void CostToGo::pass_time(const Sogm& blocked, int frame) {
  static const PenaltyTable kPenalties(static_cast<Value>(kClosedFrames * kTicksPerFrame));
  const Box& box = boxes_[static_cast<std::size_t>(frame)];
  for (int x = box.first.x(); x <= box.last.x(); ++x) {
    for (int y = box.first.y(); y <= box.last.y(); ++y) {
      open_cells(blocked, frame, x, y, open_.data());
      Value* out = values_.data() + column(frame, x, y);
      for (std::size_t z = 0; z < straight_[2].size(); z += 8) {
        const std::uint64_t open = open_[z >> 6] & space_[z >> 6];
        const auto& penalty = kPenalties.of[~open >> (z & 63) & 0xff];
        for (std::size_t k = 0; k < 8; ++k) {
          out[z + k] = static_cast<Value>(out[z + k] + penalty[k] + kTicksPerFrame);
        }
      }
    }
  }
  if ((goal_.array() < box.first.array()).any() || (goal_.array() > box.last.array()).any()) return;
  values_[column(frame, goal_.x(), goal_.y()) + static_cast<std::size_t>(goal_.z())] = 0;
}

}  // namespace swarm
