#include "planner_daemon/search/space_time_heuristic.h"

#include <bit>
#include <cmath>

#include "lcmtypes/bus/wide.h"

namespace swarm {
namespace {

constexpr std::int16_t kLongest = 26'000;  // [ticks], any way after the last frame
constexpr int kMostSteps = 200;            // however fast the robot and long the map: bounded memory

// The least of each value and its neighbours `step` before and after.
SWARM_WIDE void least_of_three(const std::int16_t* __restrict in, std::size_t step, std::size_t n,
                               std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = std::min(in[i], std::min(in[i - step], in[i + step]));
}

// The least of each value and those beside it, and `added`; no more than `far` and not below `least` after `passed`.
SWARM_WIDE void least_of_rows(const std::int16_t* a, const std::int16_t* b, const std::int16_t* c,
                              const std::int16_t* __restrict added, const std::int16_t* __restrict least,
                              std::int16_t passed, std::int16_t far, std::size_t n, std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) {
    const auto sum = static_cast<std::int16_t>(std::min(a[i], std::min(b[i], c[i])) + added[i]);
    out[i] = std::max(std::min(sum, far), static_cast<std::int16_t>(least[i] + passed));
  }
}

// The ways after `passed` ticks.
SWARM_WIDE void add_passed(const std::int16_t* __restrict ways, std::int16_t passed, std::int16_t far, std::size_t n,
                           std::int16_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = std::min(static_cast<std::int16_t>(ways[i] + passed), far);
}

SWARM_WIDE void add_to_all(std::int16_t penalty, std::int16_t far, std::size_t n, std::int16_t* out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = static_cast<std::int16_t>(std::min(out[i], far) + penalty);
}

// visit(x, first_y, last_y) for the rows of `all`, as far as they are not in `kept`.
template <class Visit>
void for_each_outside(const Columns& all, const Columns& kept, const Visit& visit) {
  for (int x = all.first.x(); x <= all.last.x(); ++x) {
    const auto row = [&](int first_y, int last_y) {
      if (first_y <= last_y) visit(x, first_y, last_y);
    };
    if (kept.empty() || x < kept.first.x() || x > kept.last.x()) {
      row(all.first.y(), all.last.y());
    } else {
      row(all.first.y(), std::min(all.last.y(), kept.first.y() - 1));
      row(std::max(all.first.y(), kept.last.y() + 1), all.last.y());
    }
  }
}

}  // namespace

int SpaceTimeHeuristic::step_at(Utime utime) const {
  const double steps = to_seconds(utime - start_utime_) / step_s_;
  return static_cast<int>(std::clamp<double>(std::round(steps), 0, num_steps_));
}

void SpaceTimeHeuristic::build(const Occupancy& occupancy, double blocked_m, const StaticHeuristic* static_heuristic,
                               const ReachableSet& reachable, const Eigen::Vector3d& goal,
                               const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max) {
  const GridGeometry& grid = occupancy.sogm->geometry;
  target_ = goal;
  rest_ = 0;
  if (static_heuristic != nullptr) {
    if (const auto subgoal = static_heuristic->subgoal(reachable.center)) {
      target_ = subgoal->position;
      rest_ = StaticHeuristic::ticks_of(subgoal->cost, kTicksPerStep);
    }
  }
  lay_out(*occupancy.sogm, goal, reachable.speed_mps);
  limit_space(space_min.z(), space_max.z(), grid);
  dilator_.set(grid, blocked_m);
  const int first = std::max(0, step_at(reachable.utime) - 1);
  std::fill_n(boxes_.begin(), first, Box());  // nothing is known of what is over
  for (int step = first; step <= num_steps_; ++step)
    boxes_[static_cast<std::size_t>(step)] = reachable_cells(reachable, step);
  finish(static_heuristic);
  for (int step = num_steps_ - 1; step >= first; --step) {
    const Columns columns = boxes_[static_cast<std::size_t>(step)].columns();
    if (columns.empty()) continue;
    isolate(step + 1, {columns.first.array() - 1, columns.last.array() + 1});
    spread(step);
    leave(step);
    close(step, occupancy);
  }
}

// Cells where the robot may be when the step starts, give or take half a step, and one more to each side.
SpaceTimeHeuristic::Box SpaceTimeHeuristic::reachable_cells(const ReachableSet& reachable, int step) const {
  const double since_s = to_seconds(start_utime_ - reachable.utime) + step * step_s_;
  Box box{Eigen::Vector3i::Zero(), size_ - Eigen::Vector3i::Ones()};
  for (int axis = 0; axis < 2; ++axis) {
    const Interval at =
        extent(reachable, axis, std::max(0.0, since_s - step_s_ / 2), std::max(0.0, since_s + step_s_ / 2));
    const auto cell = [&](double coordinate) {
      return static_cast<int>(
          std::clamp<double>(std::floor((coordinate - corner_[axis]) * inverse_cell_), -2, size_[axis] + 1));
    };
    box.first[axis] = std::max(0, cell(at.low) - 1);
    box.last[axis] = std::min(size_[axis] - 1, cell(at.high) + 1);
  }
  return box;
}

void SpaceTimeHeuristic::lay_out(const Sogm& sogm, const Eigen::Vector3d& goal, double speed_mps) {
  const GridGeometry& grid = sogm.geometry;
  const Eigen::Vector3i size = cells_in(grid);
  cell_m_ = kCellVoxels * grid.resolution_m;
  inverse_cell_ = 1.0 / cell_m_;
  step_s_ = cell_m_ / speed_mps;
  tick_s_ = step_s_ / kTicksPerStep;
  start_utime_ = sogm.start_utime;
  origin_ = grid.origin;
  corner_ = grid.origin.cast<double>() * grid.resolution_m;
  edge_ = grid.size.cast<double>() / kCellVoxels;
  const double horizon_s = to_seconds(sogm.num_frames * sogm.frame_duration);
  const int num_steps = static_cast<int>(std::clamp<double>(std::ceil(horizon_s / step_s_ - 0.1), 1, kMostSteps));
  if (size != size_ || num_steps_ != num_steps) {
    size_ = size;
    num_steps_ = num_steps;
    stride_ = (static_cast<std::size_t>(size_.z()) + 8) / 8 * 8;  // at least one more, so that columns do not mix
    boxes_.resize(static_cast<std::size_t>(num_steps_) + 1);
    values_.assign(column(num_steps_, size_.x(), size_.y()) + 2 * stride_, kFar);
    along_z_.resize((static_cast<std::size_t>(size_.y()) + 2) * stride_);
    along_y_.resize(3 * along_z_.size());
    around_.assign(around_of(size_.x(), 0), kFar);
  }
  for (int axis = 0; axis < 3; ++axis) {
    auto& straight = straight_[static_cast<std::size_t>(axis)];
    straight.resize(static_cast<std::size_t>(size_[axis]));
    for (int i = 0; i < size_[axis]; ++i) {
      const double way_m = std::abs(target_[axis] - corner_[axis] - cell_m_ * (i + 0.5));
      straight[static_cast<std::size_t>(i)] =
          static_cast<Value>(std::min<double>(kLongest, std::round(way_m * inverse_cell_ * kTicksPerStep)));
    }
  }
  goal_ = ((goal - corner_) * inverse_cell_).array().floor().matrix().cast<int>();
}

void SpaceTimeHeuristic::limit_space(double low_z, double high_z, const GridGeometry& grid) {
  space_ = cells_between(corner_.z(), cell_m_, size_.z(), low_z, high_z);
  space_middles_.assign(static_cast<std::size_t>(grid.words_per_column()), 0);
  open_middles_.resize(middles_of(size_.x(), 0));
  shut_.assign(around_of(1, 0), 0);
  for (int z = 0; z < size_.z(); ++z) {
    if (space_.holds(z)) {
      const int voxel = middle_of(z);
      space_middles_[static_cast<std::size_t>(voxel >> 6)] |= std::uint64_t{1} << (voxel & 63);
    } else {
      for (std::size_t i = static_cast<std::size_t>(z); i < shut_.size(); i += stride_) shut_[i] = kPenalty;
    }
  }
}

// What stands still is in the way at all times; after the last frame there is nothing else.
void SpaceTimeHeuristic::finish(const StaticHeuristic* static_heuristic) {
  const auto passed = static_cast<Value>(num_steps_ * kTicksPerStep);
  Columns columns{size_.head<2>(), Eigen::Vector2i::Constant(-1)};  // of all steps
  for (const Box& box : boxes_) {
    if (box.columns().empty()) continue;
    columns.first = columns.first.cwiseMin(box.first.head<2>());
    columns.last = columns.last.cwiseMax(box.last.head<2>());
  }
  if (columns.empty()) return;
  const std::size_t n = static_cast<std::size_t>(columns.width()) * stride_;
  const bool has_ways = static_heuristic != nullptr && !static_heuristic->empty() && !static_heuristic->is_cut_off();
  for (int x = columns.first.x(); x <= columns.last.x(); ++x) {
    Value *around = around_.data() + around_of(x, columns.first.y()),
          *out = values_.data() + column(num_steps_, x, columns.first.y());
    if (has_ways) {
      static_heuristic->ticks(origin_, x, columns.first.y(), columns.width(), size_.z(), stride_, kTicksPerStep, kFar,
                              around);
    } else {
      std::fill_n(around, n, kFar);
      for (int y = columns.first.y(); y <= columns.last.y(); ++y) {
        Value* way = around + static_cast<std::size_t>(y - columns.first.y()) * stride_;
        for (int z = 0; z < size_.z(); ++z) way[z] = straight(x, y, z);
      }
    }
    add_passed(around, passed, kFar, n, out);
    for (int y = columns.first.y(); y <= columns.last.y(); ++y) {
      for (std::size_t w = 0; w < space_middles_.size(); ++w) {
        std::uint64_t& open = open_middles_[middles_of(x, y) + w];
        open = space_middles_[w];
        if (!has_ways) continue;
        open &= ~static_heuristic->blocked(origin_.x() + middle_of(x), origin_.y() + middle_of(y), origin_.z(),
                                           static_cast<int>(w));
      }
    }
  }
}

// Far away: what the robot does not come to of `around`.
void SpaceTimeHeuristic::isolate(int step, const Columns& around) {
  const Columns window{Eigen::Vector2i::Zero(), size_.head<2>() - Eigen::Vector2i::Ones()};
  const Columns inside{around.first.cwiseMax(window.first), around.last.cwiseMin(window.last)};
  for_each_outside(inside, boxes_[static_cast<std::size_t>(step)].columns(), [&](int x, int from, int to) {
    std::fill_n(values_.data() + column(step, x, from), static_cast<std::size_t>(to - from + 1) * stride_, kFar);
  });
}

// The least value of each cell and its neighbours at the end of the step.
void SpaceTimeHeuristic::spread(int step) {
  const Box& box = boxes_[static_cast<std::size_t>(step)];
  const int first_y = box.first.y();
  const std::size_t n = static_cast<std::size_t>(box.last.y() - first_y + 1) * stride_;
  const auto row = [&](int x) { return along_y_.data() + static_cast<std::size_t>((x + 3) % 3) * along_z_.size(); };
  for (int x = box.first.x() - 1; x <= box.last.x() + 1; ++x) {
    least_of_three(values_.data() + column(step + 1, x, first_y - 1), 1, n + 2 * stride_, along_z_.data());
    least_of_three(along_z_.data() + stride_, stride_, n, row(x));
    if (x <= box.first.x()) continue;
    least_of_rows(row(x - 2), row(x - 1), row(x), shut_.data(), around_.data() + around_of(x - 1, first_y),
                  static_cast<Value>(step * kTicksPerStep), kFar, n, values_.data() + column(step, x - 1, first_y));
  }
}

// From the sides of the window the way goes on as if nothing moved.
void SpaceTimeHeuristic::leave(int step) {
  const Box& box = boxes_[static_cast<std::size_t>(step)];
  const auto passed = static_cast<Value>(step * kTicksPerStep);
  const auto go_on = [&](int x, int first_y, int last_y) {
    if (x < box.first.x() || x > box.last.x()) return;
    first_y = std::max(first_y, box.first.y());
    last_y = std::min(last_y, box.last.y());
    if (first_y > last_y) return;
    add_passed(around_.data() + around_of(x, first_y), passed, kFar,
               static_cast<std::size_t>(last_y - first_y + 1) * stride_, values_.data() + column(step, x, first_y));
  };
  go_on(0, 0, size_.y() - 1);
  go_on(size_.x() - 1, 0, size_.y() - 1);
  for (int x = 1; x < size_.x() - 1; ++x) {
    go_on(x, 0, 0);
    go_on(x, size_.y() - 1, size_.y() - 1);
  }
}

// What a step adds to cells that something moving closes: what stands still is counted already. At the goal the time
// stands still.
void SpaceTimeHeuristic::close(int step, const Occupancy& occupancy) {
  const Sogm& sogm = *occupancy.sogm;
  const Box& box = boxes_[static_cast<std::size_t>(step)];
  const Columns columns = box.columns();
  const int frame = sogm.frame_at(start_utime_ + to_duration((step + 0.5) * step_s_));
  const Eigen::Vector2i margin = Eigen::Vector2i::Constant(dilator_.radius_voxels());
  layers_.clear();
  occupancy.append_layers(frame,
                          {kCellVoxels * columns.first - margin,
                           kCellVoxels * columns.last + margin + Eigen::Vector2i::Constant(kCellVoxels)},
                          &layers_);
  const auto words = static_cast<std::size_t>(sogm.geometry.words_per_column());
  closed_.resize(static_cast<std::size_t>((columns.last.x() - columns.first.x() + 1) * columns.width()) * words);
  dilator_.sample(layers_, kCellVoxels, columns, closed_.data(), static_cast<std::size_t>(columns.width()) * words);
  const std::uint64_t* closed = closed_.data();
  for (int x = columns.first.x(); x <= columns.last.x(); ++x) {
    Value* out = values_.data() + column(step, x, columns.first.y());
    const std::uint64_t* open = open_middles_.data() + middles_of(x, columns.first.y());
    for (int y = columns.first.y(); y <= columns.last.y(); ++y, out += stride_) {
      for (std::size_t w = 0; w < words; ++w) {
        std::uint64_t bits = *closed++ & *open++;
        if (words == 1 && bits != 0 && bits == space_middles_[0]) {
          add_to_all(kPenalty, kFar, static_cast<std::size_t>(space_.last - space_.first + 1), out + space_.first);
          continue;
        }
        for (; bits != 0; bits &= bits - 1) {
          Value& value = out[(64 * w + static_cast<std::size_t>(std::countr_zero(bits))) / kCellVoxels];
          value = static_cast<Value>(std::min(value, kFar) + kPenalty);
        }
      }
    }
  }
  if ((goal_.array() < box.first.array()).any() || (goal_.array() > box.last.array()).any()) return;
  values_[column(step, goal_.x(), goal_.y()) + static_cast<std::size_t>(goal_.z())] =
      static_cast<Value>(step * kTicksPerStep);
}

}  // namespace swarm
