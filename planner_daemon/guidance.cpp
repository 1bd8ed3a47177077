#include "planner_daemon/guidance.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace swarm {
namespace {

constexpr int kMaxSteps = 4000;

// The even bits of a word, close together.
std::uint64_t even_bits(std::uint64_t bits) {
  bits &= 0x5555555555555555;
  bits = (bits | bits >> 1) & 0x3333333333333333;
  bits = (bits | bits >> 2) & 0x0f0f0f0f0f0f0f0f;
  bits = (bits | bits >> 4) & 0x00ff00ff00ff00ff;
  bits = (bits | bits >> 8) & 0x0000ffff0000ffff;
  return (bits | bits >> 16) & 0x00000000ffffffff;
}

// Cells of two voxels' edge: bit z of `open` is clear when all voxels of cell (x, y, z) are occupied in that frame, or
// when it lies above the window. `open` holds as many words as cover half the window's height.
void open_cells(const Sogm& grid, int frame, int x, int y, std::uint64_t* open) {
  const Eigen::Vector3i& size = grid.geometry.size;
  const int words = grid.geometry.words_per_column(), tail = size.z() % 64;
  const std::uint64_t beyond = tail == 0 ? 0 : ~std::uint64_t{0} << tail;  // voxels above the window: never open
  const int dx = 2 * x + 1 < size.x() ? 1 : 0, dy = 2 * y + 1 < size.y() ? 1 : 0;
  const std::uint64_t* columns[4] = {grid.column(frame, 2 * x, 2 * y), grid.column(frame, 2 * x + dx, 2 * y),
                                     grid.column(frame, 2 * x, 2 * y + dy), grid.column(frame, 2 * x + dx, 2 * y + dy)};
  for (int w = 0; w < words; ++w) {
    std::uint64_t closed = columns[0][w] & columns[1][w] & columns[2][w] & columns[3][w];
    if (w == words - 1) closed |= beyond;
    const std::uint64_t bits = even_bits(~(closed & closed >> 1));
    if (w % 2 == 0) {
      open[w / 2] = bits;
    } else {
      open[w / 2] |= bits << 32;
    }
  }
}

}  // namespace

void cells_between(double bottom_m, double cell_m, int num_cells, double low_m, double high_m,
                   std::vector<std::uint64_t>* bits) {
  std::vector<std::uint64_t>& cells = *bits;
  cells.assign((static_cast<std::size_t>(num_cells) + 63) / 64, 0);
  for (int z = 0; z < num_cells; ++z) {
    const double bottom = bottom_m + z * cell_m;
    if (bottom + cell_m > low_m && bottom < high_m)
      cells[static_cast<std::size_t>(z >> 6)] |= std::uint64_t{1} << (z & 63);
  }
}

void Guidance::open_space(const Sogm& standing, double space_min_z, double space_max_z) {
  cells_between(corner_.z(), cell_m_, size_.z(), space_min_z, space_max_z, &space_);
  for (int x = 0; x < size_.x(); ++x) {
    for (int y = 0; y < size_.y(); ++y) {
      std::uint64_t* open = open_.data() + column(x, y) * static_cast<std::size_t>(words_);
      open_cells(standing, 0, x, y, open);
      for (int w = 0; w < words_; ++w) open[w] &= space_[static_cast<std::size_t>(w)];
    }
  }
}

// Sources of the search: cells from which the way to the goal is straight.
void Guidance::seed(int x, int y, int w, std::uint64_t bits, const Eigen::Vector3d& goal) {
  const auto word = static_cast<std::uint32_t>(column(x, y) * static_cast<std::size_t>(words_) + w);
  for (bits &= open_[word]; bits != 0; bits &= bits - 1) {
    const int z = 64 * w + std::countr_zero(bits);
    const auto way = [&](int axis, int cell) { return std::abs(goal[axis] - corner_[axis] - cell_m_ * (cell + 0.5)); };
    const double way_m = std::max({way(0, x), way(1, y), way(2, z)});
    const auto steps = static_cast<std::size_t>(std::min<double>(kMaxSteps, way_m * inverse_cell_));
    if (steps >= seeds_.size()) seeds_.resize(steps + 1);
    seeds_[steps].push_back({word, bits & -bits});
  }
}

void Guidance::reach(std::uint32_t word, std::uint64_t bits, int steps) {
  bits &= open_[word];
  if (bits == 0) return;
  open_[word] &= ~bits;
  front_.push_back({word, bits});
  std::int16_t* out = steps_.data() + word / static_cast<std::uint32_t>(words_) * static_cast<std::size_t>(size_.z()) +
                      word % static_cast<std::uint32_t>(words_) * 64;
  while (bits != 0) {  // a run of ones at a time
    const int first = std::countr_zero(bits), last = first + std::countr_one(bits >> first);
    std::fill(out + first, out + last, static_cast<std::int16_t>(steps));
    bits = last == 64 ? 0 : bits >> last << last;
  }
}

// To the 26 neighbours of each cell.
void Guidance::spread(const Cells& cells) {
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
        const std::size_t word = column(nx, ny) * static_cast<std::size_t>(words_) + nw;
        const std::uint64_t added = bits & open_[word];
        if (added == 0) continue;
        if (pending_[word] == 0) next_.push_back(static_cast<std::uint32_t>(word));
        pending_[word] |= added;
      }
    }
  }
}

void Guidance::steps(const Eigen::Vector3d& corner, int x, int y, int n, std::int16_t* out) const {
  const Eigen::Vector3i moved = ((corner - corner_) * inverse_cell_).array().round().matrix().cast<int>();
  std::fill_n(out, n, std::int16_t{-1});
  x += moved.x();
  y += moved.y();
  if (x < 0 || x >= size_.x() || y < 0 || y >= size_.y()) return;
  const int first = std::max(0, -moved.z()), last = std::min(n, size_.z() - moved.z());
  const std::int16_t* in = steps_.data() + column(x, y) * static_cast<std::size_t>(size_.z()) + moved.z();
  if (first < last) std::copy(in + first, in + last, out + first);
}

bool Guidance::build(const Sogm& standing, const Eigen::Vector3d& goal, double space_min_z, double space_max_z) {
  const GridGeometry& grid = standing.geometry;
  if (std::none_of(standing.words.begin(), standing.words.begin() + grid.words_per_frame(),
                   [](std::uint64_t word) { return word != 0; })) {
    return false;
  }
  cell_m_ = 2 * grid.resolution_m;
  inverse_cell_ = 1.0 / cell_m_;
  corner_ = grid.origin.cast<double>() * grid.resolution_m;
  size_ = (grid.size + Eigen::Vector3i::Ones()) / 2;
  words_ = (size_.z() + 63) / 64;
  const std::size_t columns = column(size_.x() - 1, size_.y() - 1) + 1;
  open_.resize(columns * static_cast<std::size_t>(words_));
  pending_.assign(open_.size(), 0);
  steps_.assign(columns * static_cast<std::size_t>(size_.z()), -1);
  open_space(standing, space_min_z, space_max_z);

  for (auto& seeds : seeds_) seeds.clear();
  const Eigen::Vector3i goal_cell(cell_of(0, goal.x()), cell_of(1, goal.y()), cell_of(2, goal.z()));
  if (goal_cell.minCoeff() >= 0) {
    const int w = goal_cell.z() >> 6;
    const std::uint64_t bit = std::uint64_t{1} << (goal_cell.z() & 63);
    // An occupied goal is still where to go.
    open_[column(goal_cell.x(), goal_cell.y()) * static_cast<std::size_t>(words_) + w] |= bit;
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
      reach(word, pending_[word], static_cast<int>(steps));
      pending_[word] = 0;
    }
    next_.clear();
    if (steps < seeds_.size()) {
      for (const Cells& cells : seeds_[steps]) reach(cells.word, cells.bits, static_cast<int>(steps));
    }
    for (const Cells& cells : front_) spread(cells);
  }
  return true;
}

}  // namespace swarm
