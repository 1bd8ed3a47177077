#include "planner_daemon/search/static_heuristic.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "lcmtypes/bus/wide.h"

namespace swarm {
namespace {

constexpr double kDetour_m = 1.0;
constexpr int kNoWay = 1 << 20;  // more than any cost

// Bit k of the lower half: any of the bits 2 k and 2 k + 1.
std::uint64_t pairs(std::uint64_t bits) {
  bits = (bits | bits >> 1) & 0x5555'5555'5555'5555;
  bits = (bits | bits >> 1) & 0x3333'3333'3333'3333;
  bits = (bits | bits >> 2) & 0x0f0f'0f0f'0f0f'0f0f;
  bits = (bits | bits >> 4) & 0x00ff'00ff'00ff'00ff;
  bits = (bits | bits >> 8) & 0x0000'ffff'0000'ffff;
  return (bits | bits >> 16) & 0x0000'0000'ffff'ffff;
}

SWARM_WIDE void least_of(const Wavefront::Cost* __restrict costs, std::size_t n, Wavefront::Cost* __restrict least) {
  for (std::size_t i = 0; i < n; ++i) least[i] = std::min(least[i], costs[i]);
}

// Costs of cells of a layer, rows along x `row` apart: where the way does not go on in it `stride` beside the cell,
// and `late` more; kUnreached elsewhere.
SWARM_WIDE void find_leaving(const int* __restrict costs, std::size_t row, std::size_t stride, int straight,
                             int diagonal, int late, std::size_t n, int* __restrict leaving) {
  for (std::size_t i = 0; i < n; ++i) {
    const int* const at = costs + i;
    const int beside = std::min(std::min(*(at - row), *(at + row)), std::min(*(at - stride), *(at + stride)));
    const int across = std::min(std::min(*(at - row - stride), *(at - row + stride)),
                                std::min(*(at + row - stride), *(at + row + stride)));
    const bool leaves = std::min(beside + straight, across + diagonal) > *at;
    leaving[i] = leaves ? std::min<int>(*at + late, Wavefront::kUnreached) : Wavefront::kUnreached;
  }
}

SWARM_WIDE void to_ticks(const Wavefront::Cost* __restrict costs, std::size_t n, std::uint32_t per_cost,
                         std::int16_t far, std::int16_t* __restrict out) {
  const auto most = static_cast<std::uint32_t>(far);
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t ticks = costs[i] * per_cost / (kCellVoxels * Wavefront::kStraight);
    out[i] = costs[i] < Wavefront::kUnreached ? static_cast<std::int16_t>(std::min<std::uint32_t>(ticks, most)) : far;
  }
}

// The voxels inside that nothing blocks.
SWARM_WIDE void add_open(const std::uint64_t* __restrict blocked, const std::uint64_t* __restrict inside, std::size_t n,
                         std::uint64_t* __restrict open) {
  for (std::size_t i = 0; i < n; ++i) open[i] |= ~blocked[i] & inside[i];
}

}  // namespace

CellSpan cells_between(double bottom_m, double cell_m, int num_cells, double low_m, double high_m) {
  CellSpan span{num_cells, -1};
  for (int z = 0; z < num_cells; ++z) {
    const double bottom = bottom_m + z * cell_m;
    if (bottom + cell_m > low_m && bottom < high_m) span = {std::min(span.first, z), z};
  }
  return span;
}

void StaticHeuristic::build(const Occupancy& standing, double blocked_m, const Eigen::Vector3d& goal,
                            const Eigen::AlignedBox3d& space, const Guidance* guidance, Detail detail) {
  const bool is_guided = guidance != nullptr && !guidance->empty();
  const bool any = lay_out(standing, blocked_m, goal, space, detail);
  empty_ = (!any && !is_guided) || (size_.array() <= 0).any();
  if (empty_) return;
  open_cells();
  seed_goal();
  seed_edge(is_guided ? guidance : nullptr);
  advance();
}

void StaticHeuristic::build_within(const Occupancy& standing, double blocked_m, const Eigen::Vector3d& goal,
                                   const Eigen::AlignedBox3d& space) {
  (void)lay_out(standing, blocked_m, goal, space, Detail::kCells);
  empty_ = (size_.array() <= 0).any();
  if (empty_) return;
  open_cells();
  seed_goal();
  advance();
}

bool StaticHeuristic::lay_out(const Occupancy& standing, double blocked_m, const Eigen::Vector3d& goal,
                              const Eigen::AlignedBox3d& space, Detail detail) {
  const GridGeometry& grid = standing.sogm->geometry;
  grid_ = grid;
  is_cut_off_ = false;
  goal_ = lattice_voxel(goal, grid.resolution_m);
  cell_voxels_ = detail == Detail::kCells && blocked_m >= kThickEnough * grid.resolution_m ? 2 : 1;
  first_cell_ = lattice_cell(grid.origin);
  size_.setZero();
  if ((cells_in(grid).array() <= 0).any()) return false;
  size_ = lattice_cell(grid.origin + grid.size - Eigen::Vector3i::Ones()) - first_cell_ + Eigen::Vector3i::Ones();
  const Columns all = all_columns(grid);
  const auto words = static_cast<std::size_t>(grid.words_per_column());
  const std::size_t row = static_cast<std::size_t>(grid.size.y()) * words;
  blocked_.resize(static_cast<std::size_t>(grid.size.x()) * row);
  layers_.clear();
  standing.append_layers(0, all, &layers_);
  dilator_.set(grid, blocked_m);
  dilator_.dilate(layers_, all, blocked_.data(), row);

  const auto voxels = [&](const Eigen::Vector3d& place, double more) {
    return ((place / grid.resolution_m - grid.origin.cast<double>()).array() - 0.5 + more).eval();
  };
  const Eigen::Array3d low = voxels(space.min(), -0.5), high = voxels(space.max(), 0.5);
  const Eigen::Array2d last = all.last.cast<double>();
  inside_columns_ = {low.head<2>().ceil().max(0.0).min(last + 1.0).cast<int>(),
                     high.head<2>().floor().min(last).max(-1.0).cast<int>()};
  inside_.assign(words, 0);
  set_run(low.z(), high.z(), grid.size.z(), inside_.data());
  return std::ranges::any_of(blocked_, [](std::uint64_t word) { return word != 0; });
}

void StaticHeuristic::advance() {
  (void)front_.advance(std::numeric_limits<std::int64_t>::max());
  is_cut_off_ = !start_of((lattice_cell(grid_.origin + grid_.size / 2) - first_cell_).cast<double>().array() + 0.5);
}

// Cells with an open voxel. A row of columns at a time.
void StaticHeuristic::open_cells() {
  const int n = grid_.words_per_column(), num_y = grid_.size.y();
  const auto words = static_cast<std::size_t>(n), row = static_cast<std::size_t>(num_y) * words;
  front_.lay_out(size_, 1);
  inside_row_.assign(row, 0);
  for (int y = inside_columns_.first.y(); y <= inside_columns_.last.y(); ++y)
    std::ranges::copy(inside_, inside_row_.begin() + y * n);
  column_.resize(words);
  const Eigen::Vector3i first = cell_voxels_ * first_cell_ - grid_.origin;  // their first voxel, or one before it
  for (int x = 0; x < size_.x(); ++x) {
    const int low_x = first.x() + cell_voxels_ * x;
    open_row_.assign(row, 0);
    for (int at_x = std::max(low_x, inside_columns_.first.x());
         at_x <= std::min(low_x + cell_voxels_ - 1, inside_columns_.last.x()); ++at_x)
      add_open(blocked_.data() + static_cast<std::size_t>(at_x) * row, inside_row_.data(), row, open_row_.data());
    for (int y = 0; y < size_.y(); ++y) {
      const int low_y = first.y() + cell_voxels_ * y, last_y = std::min(low_y + cell_voxels_, num_y) - 1;
      std::ranges::copy_n(open_row_.data() + std::max(low_y, 0) * n, n, column_.data());
      for (int at_y = std::max(low_y, 0) + 1; at_y <= last_y; ++at_y) {
        for (int w = 0; w < n; ++w)
          column_[static_cast<std::size_t>(w)] |= open_row_[static_cast<std::size_t>(at_y * n + w)];
      }
      std::uint64_t* open = front_.open(x, y);
      for (int w = 0; w <= n; ++w) {
        const std::uint64_t bits = word_of_column(column_.data(), n, w, first.z());
        if (bits != 0) open[w / cell_voxels_] |= cell_voxels_ == 1 ? bits : pairs(bits) << 32 * (w % 2);
      }
    }
  }
}

// At the voxels nearest to it: cells would lead around what stands there to be a little nearer.
void StaticHeuristic::seed_goal() {
  const auto is_reachable = [&](const Eigen::Vector3i& voxel) {
    const Columns column{voxel.head<2>(), voxel.head<2>()};
    return is_open(voxel) && intersect(column, inside_columns_) &&
           (inside_[static_cast<std::size_t>(voxel.z() / 64)] >> voxel.z() % 64 & 1) != 0;
  };
  const Eigen::Vector3i goal = goal_ - grid_.origin;
  const bool is_closed = grid_.contains(goal) && !is_reachable(goal);
  ends_.clear();
  (void)for_each_nearest(goal, Guidance::kBeside_m / grid_.resolution_m, is_reachable, [&](const Eigen::Vector3i& at) {
    const Eigen::Vector3i cell = lattice_cell(at + grid_.origin) - first_cell_;
    front_.seed(cell.x(), cell.y(), cell.z() / 64, std::uint64_t{1} << cell.z() % 64,
                Wavefront::straight_cost(at - goal) / cell_voxels_);
    if (is_closed) ends_.push_back(at + grid_.origin);
  });
}

// What ways cost from each of the cells from `at` on, every `step`, if they leave the window there.
void StaticHeuristic::find_costs_beyond(const Guidance* guidance, const Eigen::Vector3i& at,
                                        const Eigen::Vector3i& step, std::span<int> costs) {
  const Eigen::Vector3i cell = at + first_cell_;
  if (guidance == nullptr) {
    Eigen::Vector3i way = cell - lattice_cell(goal_);
    for (int& cost : costs) cost = Wavefront::straight_cost(way), way += step;
    return;
  }
  guidance->costs(cell_voxels_ * cell, cell_voxels_ * step, costs);
  if (cell_voxels_ == 1) return;
  farther_.resize(costs.size());
  guidance->costs(cell_voxels_ * cell + Eigen::Vector3i::Ones(), cell_voxels_ * step, farther_);
  for (std::size_t i = 0; i < costs.size(); ++i) {
    const int cost = std::min(costs[i], farther_[i]);
    costs[i] = cost >= Wavefront::kUnreached ? cost : cost / cell_voxels_;
  }
}

// Above and below, the front starts only where the way does not go on beside the cell, in the window: many fewer
// seeds. A guided cost is that of the best voxel of kCell: late seeds do not split the front as early ones would.
void StaticHeuristic::find_costs_of_layer(const Guidance* guidance, int z, std::vector<int>* leaving) {
  const bool is_guided = guidance != nullptr;
  const int stride = is_guided ? Guidance::kCell / cell_voxels_ : 1,
            late = is_guided ? stride * Wavefront::kStraight : 0;
  const std::size_t row = row_of_layer(), n = static_cast<std::size_t>(size_.y());
  leaving->assign(at_in_layer(size_.x(), 0), Wavefront::kUnreached);
  const int outermost = z == 0 ? 0 : grid_.size.z() - 1;  // voxel: within the flight space?
  if ((inside_[static_cast<std::size_t>(outermost / 64)] >> outermost % 64 & 1) == 0) return;
  layer_.assign(at_in_layer(size_.x() + kLayerRim, 0), kNoWay);
  for (int x = 0; x < size_.x(); ++x) {
    const std::span<int> costs(layer_.data() + at_in_layer(x, 0), n);
    find_costs_beyond(guidance, {x, 0, z}, Eigen::Vector3i::UnitY(), costs);
    for (int y = 0; y < size_.y() && !is_guided; ++y) {
      if ((front_.open(x, y)[z / 64] >> z % 64 & 1) == 0) costs[static_cast<std::size_t>(y)] = kNoWay;
    }
  }
  for (int x = 0; x < size_.x(); ++x) {
    const std::size_t at = at_in_layer(x, 0);
    find_leaving(layer_.data() + at, static_cast<std::size_t>(stride) * row, static_cast<std::size_t>(stride),
                 stride * Wavefront::kStraight, stride * Wavefront::kDiagonal, late, n, leaving->data() + at);
  }
}

void StaticHeuristic::seed_edge(const Guidance* guidance) {
  find_costs_of_layer(guidance, 0, &leaving_below_);
  find_costs_of_layer(guidance, size_.z() - 1, &leaving_above_);
  leaving_beside_.resize(static_cast<std::size_t>(size_.z()));
  const auto costs_beside = [&](int x, int y) {
    find_costs_beyond(guidance, {x, y, 0}, Eigen::Vector3i::UnitZ(), leaving_beside_);
    return std::span<const int>(leaving_beside_);
  };
  front_.seed_edge(costs_beside,
                   [&](int x, int y, int z) { return (z == 0 ? leaving_below_ : leaving_above_)[at_in_layer(x, y)]; });
}

std::optional<StaticHeuristic::Refuge> StaticHeuristic::refuge(const Eigen::AlignedBox3d& space,
                                                               const Eigen::Vector3d& other, double apart_m) const {
  if (empty_) return {};
  const auto middle = [&](const Eigen::Vector3i& cell) -> Eigen::Vector3d {
    return ((cell + first_cell_).cast<double>().array() + 0.5) * cell_m();
  };
  const auto for_each_reached = [&](auto visit) {
    for (int x = 0; x < size_.x(); ++x) {
      for (int y = 0; y < size_.y(); ++y) {
        for (int z = 0; z < size_.z(); ++z) {
          const Eigen::Vector3i cell(x, y, z);
          const Eigen::Vector3d place = middle(cell);
          const int cost = front_.cost(cell);
          if (cost < Wavefront::kUnreached && is_open(grid_.voxel_of(place)) && space.contains(place))
            visit(cell, place, cost);
        }
      }
    }
  };
  std::optional<Eigen::Vector3i> farthest;
  int most = -1;
  for_each_reached([&](const Eigen::Vector3i& cell, const Eigen::Vector3d&, int cost) {
    if (cost > most) most = cost, farthest = cell;
  });
  if (!farthest) return {};
  std::vector<Eigen::Vector3d> way = {middle(*farthest)};
  Eigen::Vector3i cell = *farthest;
  for (Eigen::Vector3i next = next_of(cell); next != cell; cell = next, next = next_of(cell))
    way.push_back(middle(next));
  const Eigen::Vector3d came = other - way.back();
  for (int i = 1, n = static_cast<int>(std::ceil(came.norm() / cell_m())); i <= n; ++i)
    way.push_back(way[way.size() - 1] + came / n);
  std::ranges::reverse(way);
  Refuge refuge{way, way.back(), false};
  int least = Wavefront::kUnreached;
  for_each_reached([&](const Eigen::Vector3i&, const Eigen::Vector3d& place, int cost) {
    const auto is_near = [&](const Eigen::Vector3d& at) { return (place - at).squaredNorm() < apart_m * apart_m; };
    if (cost >= least || std::ranges::any_of(way, is_near)) return;
    least = cost;
    refuge.place = place;
    refuge.is_apart = true;
  });
  return refuge;
}

// Through cells that are not closed all through.
bool StaticHeuristic::sees(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const {
  const int steps = static_cast<int>(std::ceil(2.0 * (to - from).cwiseAbs().maxCoeff()));
  for (int i = 1; i <= steps; ++i) {
    const Eigen::Vector3d at = from + (to - from) * i / steps;
    if (front_.cost(at.cast<int>()) == Wavefront::kUnreached) return false;
  }
  return true;
}

// A robot may be a little closer to what stands still than ways lead.
std::optional<Eigen::Vector3i> StaticHeuristic::start_of(const Eigen::Vector3d& from) const {
  const Eigen::Vector3i middle = from.array().floor().matrix().cast<int>();
  if (!has_cell(middle)) return {};
  std::optional<Eigen::Vector3i> nearest;
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 27; ++k) {
    const Eigen::Vector3i cell = middle + Eigen::Vector3i(k / 9, k / 3 % 3, k % 3) - Eigen::Vector3i::Ones();
    const double away = cell == middle ? 0.0 : ((cell.cast<double>().array() + 0.5).matrix() - from).norm();
    if (away >= least || !has_cell(cell) || front_.cost(cell) == Wavefront::kUnreached) continue;
    least = away;
    nearest = cell;
  }
  return nearest;
}

int StaticHeuristic::cost(const Eigen::Vector3d& place) const {
  const auto start = empty_ ? std::nullopt : start_of(in_cells(place));
  return start ? cost_at(*start) : Wavefront::kUnreached;
}

std::optional<StaticHeuristic::Subgoal> StaticHeuristic::subgoal(const Eigen::Vector3d& place) const {
  if (empty_ || is_cut_off_) return {};
  const int straight = Wavefront::straight_cost(goal_ - grid_.origin - grid_.voxel_of(place));
  if (cost(place) - straight < Wavefront::kStraight * kDetour_m / grid_.resolution_m) return {};
  return descend(place, 0);
}

std::optional<StaticHeuristic::Subgoal> StaticHeuristic::ahead(const Eigen::Vector3d& place, double reach_m) const {
  if (cost(place) == Wavefront::kUnreached) return {};
  return descend(place, cost(place) - static_cast<int>(Wavefront::kStraight * reach_m / grid_.resolution_m));
}

// The level ones come first.
Eigen::Vector3i StaticHeuristic::next_of(const Eigen::Vector3i& cell) const {
  Eigen::Vector3i best = cell;
  int least = cost_at(cell);
  for (const int dz : {0, -1, 1}) {
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        const Eigen::Vector3i next = cell + Eigen::Vector3i(dx, dy, dz);
        if (has_cell(next) && cost_at(next) < least) least = cost_at(next), best = next;
      }
    }
  }
  return best;
}

std::optional<Eigen::Vector3d> StaticHeuristic::beside_goal(const Eigen::Vector3d& place) const {
  if (empty_ || is_cut_off_ || ends_.empty()) return {};
  const auto start = start_of(in_cells(place));
  if (!start) return {};
  Eigen::Vector3i cell = *start;
  for (Eigen::Vector3i next = next_of(cell); next != cell; next = next_of(cell)) cell = next;
  std::optional<Eigen::Vector3d> nearest;
  for (const Eigen::Vector3i& voxel : ends_) {
    if (lattice_cell(voxel) - first_cell_ != cell) continue;
    const Eigen::Vector3d end = (voxel.cast<double>().array() + 0.5) * grid_.resolution_m;
    if (!nearest || (end - place).norm() < (*nearest - place).norm()) nearest = end;
  }
  return nearest;
}

// From cell to cell: each but the cheapest has a cheaper neighbour.
std::optional<StaticHeuristic::Subgoal> StaticHeuristic::descend(const Eigen::Vector3d& place, int least) const {
  const Eigen::Vector3d from = in_cells(place);
  const auto start = start_of(from);
  if (!start) return {};
  std::optional<Subgoal> farthest;
  for (Eigen::Vector3i cell = *start; cost_at(cell) > least;) {
    const Eigen::Vector3i next = next_of(cell);
    if (next == cell) break;
    cell = next;
    const Eigen::Vector3d middle = cell.cast<double>().array() + 0.5;
    if (farthest && !sees(from, middle)) break;  // the first one is near in any case
    farthest = Subgoal{(first_cell_.cast<double>() + middle) * cell_m(), cost_at(cell)};
  }
  return farthest;
}

// Along x, z and y one after the other: each of the cells of ways is read once or twice.
void StaticHeuristic::ticks(const Eigen::Vector3i& origin, int x, int first_y, int num_y, int num_z, std::size_t stride,
                            int per_cell, std::int16_t far, std::int16_t* out) const {
  const auto overlapping = [&](int cell, int axis) {
    const auto at = [&](int voxel) { return lattice_cell(voxel + origin[axis]) - first_cell_[axis]; };
    return CellSpan{std::max(0, at(kCellVoxels * cell)), std::min(size_[axis] - 1, at(kCellVoxels * (cell + 1) - 1))};
  };
  const int low_y = overlapping(first_y, 1).first;
  const auto columns = static_cast<std::size_t>(std::max(0, overlapping(first_y + num_y - 1, 1).last + 1 - low_y));
  const auto height = static_cast<std::size_t>(size_.z()), n = columns * height;

  // Row k of rows_: the least of k + 1 cells of a column from each one on.
  const std::size_t row = n + 1;
  const auto num_rows = static_cast<std::size_t>(cell_voxels_ == 2 ? kCellVoxels - 1 : kCellVoxels);
  rows_.assign(num_rows * row, Wavefront::kUnreached);
  const CellSpan along_x = overlapping(x, 0);
  for (int at_x = along_x.first; at_x <= along_x.last; ++at_x) least_of(front_.column(at_x, low_y), n, rows_.data());
  for (std::size_t k = 1; k < num_rows; ++k) {
    least_of(rows_.data(), n, rows_.data() + k * row);
    least_of(rows_.data() + (k - 1) * row + 1, n, rows_.data() + k * row);
  }

  sampled_.assign(columns * stride, Wavefront::kUnreached);
  for (int z = 0; z < num_z; ++z) {
    const CellSpan along_z = overlapping(z, 2);
    if (along_z.first > along_z.last) continue;
    const Wavefront::Cost* least = rows_.data() + static_cast<std::size_t>(along_z.last - along_z.first) * row +
                                   static_cast<std::size_t>(along_z.first);
    Wavefront::Cost* sampled = sampled_.data() + z;
    for (std::size_t y = 0; y < columns; ++y) sampled[y * stride] = least[y * height];
  }

  nearest_.assign(static_cast<std::size_t>(num_y) * stride, Wavefront::kUnreached);
  for (int y = 0; y < num_y; ++y) {
    const CellSpan along_y = overlapping(first_y + y, 1);
    for (int at_y = along_y.first; at_y <= along_y.last; ++at_y) {
      least_of(sampled_.data() + static_cast<std::size_t>(at_y - low_y) * stride, stride,
               nearest_.data() + static_cast<std::size_t>(y) * stride);
    }
  }
  to_ticks(nearest_.data(), nearest_.size(), static_cast<std::uint32_t>(cell_voxels_ * per_cell), far, out);
}

}  // namespace swarm
