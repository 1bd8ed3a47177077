#include "planner_daemon/cost_to_go.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "map_daemon/wide.h"

namespace swarm {
namespace {

constexpr std::int16_t kLongest = 15'000;  // [ticks], any way after the last frame

// The least of each value and its neighbours `step` before and after.
SWARM_WIDE void least_of_three(const std::int16_t* __restrict in, std::size_t step, std::size_t n,
                               std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = std::min(in[i], std::min(in[i - step], in[i + step]));
}

// The least of each value and those beside it, and `added`; no more than `far` and not below `rim`.
SWARM_WIDE void least_of_rows(const std::int16_t* a, const std::int16_t* b, const std::int16_t* c,
                              const std::int16_t* __restrict added, const std::int16_t* __restrict rim,
                              std::int16_t far, std::size_t n, std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) {
    const auto sum = static_cast<std::int16_t>(std::min(a[i], std::min(b[i], c[i])) + added[i]);
    out[i] = std::max(std::min(sum, far), rim[i]);
  }
}

// The larger one of the straight way and of `steps` around what stands still, after `passed` ticks.
SWARM_WIDE void finish_column(const std::int16_t* __restrict straight, std::int16_t side,
                              const std::int16_t* __restrict steps, float ticks_per_step, std::int16_t passed,
                              std::size_t n, std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) {
    const float ticks = std::min<float>(kLongest, static_cast<float>(steps[i]) * ticks_per_step + 0.5f);
    const auto around = static_cast<std::int16_t>(static_cast<std::int32_t>(ticks));
    out[i] = static_cast<std::int16_t>(std::max(std::max(straight[i], side), around) + passed);
  }
}

// Adds the penalty to every cell whose bit is set: bit 2 k belongs to out[k].
SWARM_WIDE void add_penalty(std::uint64_t bits, std::int16_t penalty, std::int16_t far, std::int16_t* out) {
  for (; bits != 0; bits >>= 16, out += 8) {
    const auto chunk = static_cast<std::uint16_t>(bits);
    for (int k = 0; k < 8; ++k) {
      const std::int16_t added = (chunk >> (2 * k) & 1) != 0 ? penalty : 0;
      out[k] = static_cast<std::int16_t>(std::min(out[k], far) + added);
    }
  }
}

}  // namespace

int CostToGo::frame_at(std::int64_t utime) const {
  const double frames = static_cast<double>(utime - start_utime_) / static_cast<double>(frame_duration_us_);
  return std::clamp(static_cast<int>(std::lround(frames)), 0, num_frames_);
}

void CostToGo::build(const Sogm& blocked, const Guidance* guidance, const Reach& reach, const Eigen::Vector3d& goal,
                     const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max) {
  lay_out(blocked, goal, reach.speed_mps);
  const double moves_per_frame = reach.speed_mps * 1e-6 * static_cast<double>(frame_duration_us_) * inverse_cell_;
  const auto moves = [moves_per_frame](int frame) {
    return static_cast<int>(std::floor((frame + 1) * moves_per_frame + 0.5)) -
           static_cast<int>(std::floor(frame * moves_per_frame + 0.5));
  };
  const auto grown = [this](const Box& box, int cells) {
    return Box{(box.first.array() - cells).max(0), (box.last.array() + cells).min(size_.array() - 1)};
  };
  const int first = std::max(0, frame_at(reach.utime) - 1);
  for (int frame = first; frame <= num_frames_; ++frame)
    boxes_[static_cast<std::size_t>(frame)] = reached(reach, frame);
  limit_space(space_min.z(), space_max.z(), blocked.geometry.words_per_column());
  finish(guidance, reach.speed_mps);
  for (int frame = num_frames_ - 1; frame >= first; --frame) {
    const Box& box = boxes_[static_cast<std::size_t>(frame)];
    const int n = moves(frame);
    isolate(frame + 1, grown(box, n));
    if (n == 0) stay(frame + 1, frame, box);
    for (int move = 0; move < n; ++move)
      spread(move == 0 ? frame + 1 : frame, frame, grown(box, n - 1 - move), move == n - 1 ? shut_ : open_);
    close(blocked, frame);
  }
}

// Cells where the robot may be when the frame starts, to the nearest frame, and one more to each side.
CostToGo::Box CostToGo::reached(const Reach& reach, int frame) const {
  const double frame_s = 1e-6 * static_cast<double>(frame_duration_us_);
  const double since_s = 1e-6 * static_cast<double>(start_utime_ - reach.utime) + frame * frame_s;
  Box box{Eigen::Vector3i::Zero(), size_ - Eigen::Vector3i::Ones()};
  for (int axis = 0; axis < 2; ++axis) {
    const Span at = span(reach, axis, std::max(0.0, since_s - frame_s / 2), std::max(0.0, since_s + frame_s / 2));
    const auto cell = [&](double coordinate) {
      return static_cast<int>(
          std::clamp<double>(std::floor((coordinate - corner_[axis]) * inverse_cell_), -2, size_[axis] + 1));
    };
    box.first[axis] = std::max(0, cell(at.low) - 1);
    box.last[axis] = std::min(size_[axis] - 1, cell(at.high) + 1);
  }
  return box;
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
    open_.assign(static_cast<std::size_t>(size_.y()) * stride_, 0);
    rim_ = open_;
    for (std::size_t i = 0; i < rim_.size(); ++i)
      rim_[i] = i % stride_ < static_cast<std::size_t>(size_.z()) ? std::numeric_limits<Value>::min() : kFar;
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

void CostToGo::limit_space(double low_z, double high_z, int words_per_column) {
  cells_between(corner_.z(), 1.0 / inverse_cell_, size_.z(), low_z, high_z, &space_);
  in_space_.assign(static_cast<std::size_t>(words_per_column), 0);
  shut_ = open_;
  for (std::size_t z = 0; z < static_cast<std::size_t>(size_.z()); ++z) {
    if ((space_[z >> 6] >> (z & 63) & 1) != 0) {
      in_space_[z >> 5] |= std::uint64_t{1} << (2 * z & 63);
    } else {
      for (std::size_t i = z; i < shut_.size(); i += stride_) shut_[i] = kPenalty;
    }
  }
}

// After the last frame only what stands still is in the way.
void CostToGo::finish(const Guidance* guidance, double speed_mps) {
  const auto passed = static_cast<Value>(num_frames_ * kTicksPerFrame);
  const auto ticks_per_step = static_cast<float>(1.0 / (speed_mps * tick_s_ * inverse_cell_));
  around_.assign(straight_[2].size(), -1);
  const Box& box = boxes_.back();
  for (int x = box.first.x(); x <= box.last.x(); ++x) {
    for (int y = box.first.y(); y <= box.last.y(); ++y) {
      const Value side = std::max(straight_[0][static_cast<std::size_t>(x)], straight_[1][static_cast<std::size_t>(y)]);
      if (guidance != nullptr) guidance->steps(corner_, x, y, size_.z(), around_.data());
      finish_column(straight_[2].data(), side, around_.data(), ticks_per_step, passed, straight_[2].size(),
                    values_.data() + column(num_frames_, x, y));
    }
  }
}

// Far away: what the robot does not reach of `around`.
void CostToGo::isolate(int frame, const Box& around) {
  const auto columns = [](const Box& box) { return Columns{box.first.head<2>(), box.last.head<2>()}; };
  for_each_outside(columns(around), columns(boxes_[static_cast<std::size_t>(frame)]), [&](int x, int from, int to) {
    std::fill_n(values_.data() + column(frame, x, from), static_cast<std::size_t>(to - from + 1) * stride_, kFar);
  });
}

// The point stays where it is: a frame too short for one cell.
void CostToGo::stay(int from, int to, const Box& box) {
  const std::size_t n = static_cast<std::size_t>(std::max(0, box.last.y() - box.first.y() + 1)) * stride_;
  for (int x = box.first.x(); x <= box.last.x(); ++x) {
    const Value* in = values_.data() + column(from, x, box.first.y());
    least_of_rows(in, in, in, shut_.data(), rim_.data(), kFar, n, values_.data() + column(to, x, box.first.y()));
  }
}

// One move: the least value of each cell and its neighbours.
void CostToGo::spread(int from, int to, const Box& box, const std::vector<Value>& added) {
  const int first_y = box.first.y(), n_y = box.last.y() - first_y + 1;
  if (n_y <= 0) return;
  const std::size_t n = static_cast<std::size_t>(n_y) * stride_;
  const auto row = [&](int x) { return along_y_.data() + static_cast<std::size_t>((x + 3) % 3) * along_z_.size(); };
  for (int x = box.first.x() - 1; x <= box.last.x() + 1; ++x) {
    least_of_three(values_.data() + column(from, x, first_y - 1), 1, n + 2 * stride_, along_z_.data());
    least_of_three(along_z_.data() + stride_, stride_, n, row(x));
    if (x <= box.first.x()) continue;
    least_of_rows(row(x - 2), row(x - 1), row(x), added.data(), rim_.data(), kFar, n,
                  values_.data() + column(to, x - 1, first_y));
  }
}

// What a frame adds to closed cells; at the goal the time stands still.
void CostToGo::close(const Sogm& blocked, int frame) {
  const Box& box = boxes_[static_cast<std::size_t>(frame)];
  const Eigen::Vector3i& size = blocked.geometry.size;
  const int words = blocked.geometry.words_per_column(), tail = size.z() % 64;
  const std::uint64_t beyond = tail == 0 ? 0 : ~std::uint64_t{0} << tail;  // voxels above the window: never open
  for (int x = box.first.x(); x <= box.last.x(); ++x) {
    const std::uint64_t* left = blocked.column(frame, 2 * x, 0);
    const std::uint64_t* right = blocked.column(frame, std::min(2 * x + 1, size.x() - 1), 0);
    for (int y = box.first.y(); y <= box.last.y(); ++y) {
      const int near = 2 * y * words, far = std::min(2 * y + 1, size.y() - 1) * words;
      for (int w = 0; w < words; ++w) {
        std::uint64_t closed = left[near + w] & left[far + w] & right[near + w] & right[far + w];
        if (closed == 0) continue;
        if (w == words - 1) closed |= beyond;
        closed &= closed >> 1 & in_space_[static_cast<std::size_t>(w)];
        if (closed != 0) add_penalty(closed, kPenalty, kFar, values_.data() + column(frame, x, y) + 32 * w);
      }
    }
  }
  if ((goal_.array() < box.first.array()).any() || (goal_.array() > box.last.array()).any()) return;
  values_[column(frame, goal_.x(), goal_.y()) + static_cast<std::size_t>(goal_.z())] =
      static_cast<Value>(frame * kTicksPerFrame);
}

}  // namespace swarm
