#include "planner_daemon/guidance.h"

#include <algorithm>
#include <cmath>

namespace swarm {
namespace {

constexpr std::int16_t kUnknown = -1, kClosed = -2;
constexpr int kMaxSteps = 4000;

}  // namespace

void Guidance::close_standing_cells(const Sogm& blocked, double space_min_z, double space_max_z) {
  const GridGeometry& grid = blocked.geometry;
  const std::size_t frame_words = static_cast<std::size_t>(grid.words_per_frame());
  standing_words_.assign(blocked.words.begin(), blocked.words.begin() + static_cast<std::ptrdiff_t>(frame_words));
  for (int frame = 1; frame < blocked.num_frames; ++frame) {
    const std::uint64_t* words = blocked.column(frame, 0, 0);
    for (std::size_t i = 0; i < frame_words; ++i) standing_words_[i] &= words[i];
  }
  standing_ = std::any_of(standing_words_.begin(), standing_words_.end(), [](std::uint64_t word) { return word != 0; });
  if (!standing_) return;

  const int words = grid.words_per_column();
  const auto standing = [&](int x, int y, int z) {
    if (x >= grid.size.x() || y >= grid.size.y() || z >= grid.size.z()) return true;
    const std::size_t column = (static_cast<std::size_t>(x) * grid.size.y() + y) * words;
    return (standing_words_[column + (z >> 6)] >> (z & 63) & 1u) != 0;
  };
  for (int x = 0; x < size_.x(); ++x) {
    for (int y = 0; y < size_.y(); ++y) {
      for (int z = 0; z < size_.z(); ++z) {
        const double bottom = corner_.z() + z * cell_m_;
        bool open = bottom + cell_m_ > space_min_z && bottom < space_max_z;
        if (open) {
          open = false;
          for (int k = 0; k < 8 && !open; ++k)
            open = !standing(2 * x + (k & 1), 2 * y + (k >> 1 & 1), 2 * z + (k >> 2));
        }
        steps_[index(x, y, z)] = open ? kUnknown : kClosed;
      }
    }
  }
}

// A source of the search: a cell from which the way to the goal is straight.
void Guidance::seed(int x, int y, int z, const Eigen::Vector3d& goal) {
  if (steps_[index(x, y, z)] == kClosed) return;
  const Eigen::Vector3d center = corner_ + cell_m_ * Eigen::Vector3d(x + 0.5, y + 0.5, z + 0.5);
  const int steps = std::min(kMaxSteps, static_cast<int>((goal - center).cwiseAbs().maxCoeff() / cell_m_));
  if (static_cast<std::size_t>(steps) >= buckets_.size()) buckets_.resize(static_cast<std::size_t>(steps) + 1);
  buckets_[static_cast<std::size_t>(steps)].push_back(static_cast<std::uint32_t>(index(x, y, z)));
}

bool Guidance::build(const Sogm& blocked, const Eigen::Vector3d& goal, double space_min_z, double space_max_z) {
  const GridGeometry& grid = blocked.geometry;
  cell_m_ = 2 * grid.resolution_m;
  corner_ = grid.origin.cast<double>() * grid.resolution_m;
  size_ = (grid.size + Eigen::Vector3i::Ones()) / 2;
  steps_.resize(index(size_.x() - 1, size_.y() - 1, size_.z() - 1) + 1);
  close_standing_cells(blocked, space_min_z, space_max_z);
  if (!standing_) return false;

  for (auto& bucket : buckets_) bucket.clear();
  const Eigen::Vector3i goal_cell = ((goal - corner_) / cell_m_).array().floor().matrix().cast<int>();
  if ((goal_cell.array() >= 0).all() && (goal_cell.array() < size_.array()).all()) {
    std::int16_t& steps = steps_[index(goal_cell.x(), goal_cell.y(), goal_cell.z())];
    steps = kUnknown;  // an occupied goal is still where to go
    seed(goal_cell.x(), goal_cell.y(), goal_cell.z(), goal);
  }
  for (int x = 0; x < size_.x(); ++x) {
    for (int y = 0; y < size_.y(); ++y) {
      const bool side = x == 0 || y == 0 || x == size_.x() - 1 || y == size_.y() - 1;
      for (int z = 0; z < size_.z(); z += side ? 1 : std::max(1, size_.z() - 1)) seed(x, y, z, goal);
    }
  }
  for (std::size_t steps = 0; steps < buckets_.size(); ++steps) {
    for (std::size_t i = 0; i < buckets_[steps].size(); ++i) {
      const std::uint32_t cell = buckets_[steps][i];
      if (steps_[cell] != kUnknown) continue;
      steps_[cell] = static_cast<std::int16_t>(steps);
      if (steps + 1 == buckets_.size()) buckets_.emplace_back();
      const int z = static_cast<int>(cell) % size_.z(), y = static_cast<int>(cell) / size_.z() % size_.y();
      const int x = static_cast<int>(cell) / (size_.z() * size_.y());
      for (int nx = std::max(0, x - 1); nx <= std::min(size_.x() - 1, x + 1); ++nx) {
        for (int ny = std::max(0, y - 1); ny <= std::min(size_.y() - 1, y + 1); ++ny) {
          for (int nz = std::max(0, z - 1); nz <= std::min(size_.z() - 1, z + 1); ++nz) {
            const std::size_t next = index(nx, ny, nz);
            if (steps_[next] == kUnknown) buckets_[steps + 1].push_back(static_cast<std::uint32_t>(next));
          }
        }
      }
    }
  }
  return true;
}

double Guidance::time_to_goal(const Eigen::Vector3d& position, double v_max) const {
  const Eigen::Vector3i cell = ((position - corner_) / cell_m_).array().floor().matrix().cast<int>();
  if ((cell.array() < 0).any() || (cell.array() >= size_.array()).any()) return 0.0;
  return std::max<int>(0, steps_[index(cell.x(), cell.y(), cell.z())]) * cell_m_ / v_max;
}

}  // namespace swarm
