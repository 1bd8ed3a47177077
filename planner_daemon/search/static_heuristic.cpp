#include "planner_daemon/search/static_heuristic.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace swarm {
namespace {

constexpr int kMaxSteps = 900;  // longer ways are not told apart: their ticks would not fit the space-time heuristic

}  // namespace

CellSpan cells_between(double bottom_m, double cell_m, int num_cells, double low_m, double high_m) {
  CellSpan span{num_cells, -1};
  for (int z = 0; z < num_cells; ++z) {
    const double bottom = bottom_m + z * cell_m;
    if (bottom + cell_m > low_m && bottom < high_m) span = {std::min(span.first, z), z};
  }
  return span;
}

// False: nothing is closed.
bool StaticHeuristic::open_space(const Occupancy& standing, double blocked_m, const CellSpan& space) {
  const GridGeometry& grid = standing.sogm->geometry;
  const auto words = static_cast<std::size_t>(grid.words_per_column());
  const Columns all{Eigen::Vector2i::Zero(), size_.head<2>() - Eigen::Vector2i::Ones()};
  layers_.clear();
  standing.append_layers(0, all_columns(grid), &layers_);
  closed_.resize(static_cast<std::size_t>(size_.x() * size_.y()) * words);
  dilator_.set(grid, blocked_m);
  dilator_.sample(layers_, kCellVoxels, all, closed_.data(), static_cast<std::size_t>(size_.y()) * words);
  std::uint64_t any = 0;
  std::fill(open_.begin(), open_.end(), 0);
  for (std::size_t i = 0; i < closed_.size() / words; ++i) {
    const std::uint64_t* closed = closed_.data() + i * words;
    for (std::size_t w = 0; w < words; ++w) any |= closed[w];
    std::uint64_t* open = open_.data() + i * static_cast<std::size_t>(words_);
    for (int z = space.first; z <= space.last; ++z) {
      const int voxel = middle_of(z);
      open[z >> 6] |= (~closed[voxel >> 6] >> (voxel & 63) & 1) << (z & 63);
    }
  }
  return any != 0;
}

// Sources of the search: cells from which the way to the goal is straight.
void StaticHeuristic::seed(int x, int y, int w, std::uint64_t bits, const Eigen::Vector3d& goal) {
  const auto word = static_cast<std::uint32_t>(this->word(x, y, w));
  for (bits &= open_[word]; bits != 0; bits &= bits - 1) {
    const int z = 64 * w + std::countr_zero(bits);
    const auto way = [&](int axis, int cell) { return std::abs(goal[axis] - corner_[axis] - cell_m_ * (cell + 0.5)); };
    const double way_m = std::max({way(0, x), way(1, y), way(2, z)});
    const auto steps = static_cast<std::size_t>(std::min<double>(kMaxSteps, way_m * inverse_cell_));
    if (steps >= seeds_.size()) seeds_.resize(steps + 1);
    seeds_[steps].push_back({word, bits & -bits});
  }
}

void StaticHeuristic::settle(std::uint32_t word, std::uint64_t bits, int steps) {
  bits &= open_[word];
  if (bits == 0) return;
  open_[word] &= ~bits;
  front_.push_back({word, bits});
  std::int16_t* out = steps_.data() + word / static_cast<std::uint32_t>(words_) * static_cast<std::size_t>(size_.z()) +
                      word % static_cast<std::uint32_t>(words_) * 64;
  while (bits != 0) {  // a run of ones at a time
    const int first = std::countr_zero(bits), last = first + std::countr_one(bits >> first);
    std::fill(out + first, out + last, static_cast<std::int16_t>(std::min(steps, kMaxSteps)));
    bits = last == 64 ? 0 : bits >> last << last;
  }
}

// To the 26 neighbours of each cell.
void StaticHeuristic::spread(const Cells& cells) {
  const int w = static_cast<int>(cells.word % static_cast<std::uint32_t>(words_));
  const int at = static_cast<int>(cells.word / static_cast<std::uint32_t>(words_));
  const int x = at / size_.y(), y = at % size_.y();
  for (int nw = std::max(0, w - 1); nw <= std::min(words_ - 1, w + 1); ++nw) {
    std::uint64_t bits = cells.bits | cells.bits << 1 | cells.bits >> 1;
    if (nw < w) bits = cells.bits << 63;
    if (nw > w) bits = cells.bits >> 63;
    if (bits == 0) continue;
    for (int nx = std::max(0, x - 1); nx <= std::min(size_.x() - 1, x + 1); ++nx) {
      for (int ny = std::max(0, y - 1); ny <= std::min(size_.y() - 1, y + 1); ++ny) {
        const std::size_t word = this->word(nx, ny, nw);
        const std::uint64_t added = bits & open_[word];
        if (added == 0) continue;
        if (pending_[word] == 0) next_.push_back(static_cast<std::uint32_t>(word));
        pending_[word] |= added;
      }
    }
  }
}

void StaticHeuristic::steps(const Eigen::Vector3d& corner, int x, int first_y, int num_y, int num_z, std::size_t stride,
                            std::int16_t* out) const {
  const Eigen::Vector3i moved = ((corner - corner_) * inverse_cell_).array().round().matrix().cast<int>();
  const int first = std::max(0, -moved.z()), last = std::min(num_z, size_.z() - moved.z());
  x += moved.x();
  for (int y = first_y + moved.y(); y < first_y + moved.y() + num_y; ++y, out += stride) {
    std::fill_n(out, num_z, std::int16_t{-1});
    if (x < 0 || x >= size_.x() || y < 0 || y >= size_.y()) continue;
    const std::int16_t* in = steps_.data() + column(x, y) * static_cast<std::size_t>(size_.z());
    for (int z = first; z < last; ++z) out[z] = in[z + moved.z()];
  }
}

void StaticHeuristic::build(const Occupancy& standing, double blocked_m, const Eigen::Vector3d& goal,
                            double space_min_z, double space_max_z) {
  const GridGeometry& grid = standing.sogm->geometry;
  cell_m_ = kCellVoxels * grid.resolution_m;
  inverse_cell_ = 1.0 / cell_m_;
  corner_ = grid.origin.cast<double>() * grid.resolution_m;
  size_ = cells_in(grid);
  empty_ = true;
  if ((size_.array() <= 0).any()) return;
  words_ = (size_.z() + 63) / 64;
  const std::size_t columns = column(size_.x() - 1, size_.y() - 1) + 1;
  open_.resize(columns * static_cast<std::size_t>(words_));
  pending_.assign(open_.size(), 0);
  steps_.assign(columns * static_cast<std::size_t>(size_.z()), -1);
  const CellSpan space = cells_between(corner_.z(), cell_m_, size_.z(), space_min_z, space_max_z);
  if (!open_space(standing, blocked_m, space)) return;
  empty_ = false;

  for (auto& seeds : seeds_) seeds.clear();
  const Eigen::Vector3i goal_cell = ((goal - corner_) * inverse_cell_).array().floor().matrix().cast<int>();
  if ((goal_cell.array() >= 0).all() && (goal_cell.array() < size_.array()).all()) {
    const int w = goal_cell.z() >> 6;
    const std::uint64_t bit = std::uint64_t{1} << (goal_cell.z() & 63);
    // An occupied goal is still where to go.
    open_[word(goal_cell.x(), goal_cell.y(), w)] |= bit;
    seed(goal_cell.x(), goal_cell.y(), w, bit, goal);
  }
  // Beyond the floor and the ceiling the flight space may end.
  const bool below = space_min_z<corner_.z(), above = space_max_z> corner_.z() + cell_m_ * size_.z();
  for (int x = 0; x < size_.x(); ++x) {
    for (int y = 0; y < size_.y(); ++y) {
      const bool side = x == 0 || y == 0 || x == size_.x() - 1 || y == size_.y() - 1;
      for (int w = 0; w < words_; ++w) {
        std::uint64_t bits = side ? ~std::uint64_t{0} : 0;
        if (w == 0 && below) bits |= 1;
        if (w == words_ - 1 && above) bits |= std::uint64_t{1} << ((size_.z() - 1) & 63);
        if (bits != 0) seed(x, y, w, bits, goal);
      }
    }
  }
  next_.clear();
  for (std::size_t steps = 0; steps < seeds_.size() || !next_.empty(); ++steps) {
    front_.clear();
    for (const std::uint32_t word : next_) {
      settle(word, pending_[word], static_cast<int>(steps));
      pending_[word] = 0;
    }
    next_.clear();
    if (steps < seeds_.size()) {
      for (const Cells& cells : seeds_[steps]) settle(cells.word, cells.bits, static_cast<int>(steps));
    }
    for (const Cells& cells : front_) spread(cells);
  }
}

}  // namespace swarm
