#include "planner_daemon/search/static_heuristic.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace swarm {
namespace {

constexpr double kDetour_m = 1.0;

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
                            double space_min_z, double space_max_z, const Guidance* guidance, int cell_voxels) {
  const GridGeometry& grid = standing.sogm->geometry;
  grid_ = grid;
  cell_voxels_ = cell_voxels;
  size_ = cell_voxels == kCellVoxels ? cells_in(grid) : (grid.size.array() / cell_voxels).matrix();
  empty_ = true;
  is_cut_off_ = false;
  if ((size_.array() <= 0).any()) return;
  const Columns all = all_columns(grid);
  const auto words = static_cast<std::size_t>(grid.words_per_column());
  const std::size_t row = static_cast<std::size_t>(grid.size.y()) * words;
  blocked_.resize(static_cast<std::size_t>(grid.size.x()) * row);
  layers_.clear();
  standing.append_layers(0, all, &layers_);
  dilator_.set(grid, blocked_m);
  dilator_.dilate(layers_, all, blocked_.data(), row);
  const bool any = std::ranges::any_of(blocked_, [](std::uint64_t word) { return word != 0; });
  if (!any && (guidance == nullptr || guidance->empty())) return;
  empty_ = false;

  inside_.assign(words, 0);
  const auto voxel = [&](double z) { return z / grid.resolution_m - 0.5 - grid.origin.z(); };
  set_run(voxel(space_min_z) - 0.5, voxel(space_max_z) + 0.5, grid.size.z(), inside_.data());
  front_.lay_out(grid.size, cell_voxels);
  for (int x = 0; x < grid.size.x(); ++x) {
    for (int y = 0; y < grid.size.y(); ++y) {
      const std::uint64_t* blocked = blocked_.data() + static_cast<std::size_t>(x * grid.size.y() + y) * words;
      for (std::size_t w = 0; w < words; ++w) front_.open(x, y)[w] = ~blocked[w] & inside_[w];
    }
  }
  goal_ = lattice_voxel(goal, grid.resolution_m);
  (void)front_.seed_goal(goal_ - grid.origin, Guidance::kBeside_m / grid.resolution_m);
  seed_edge(guidance != nullptr && !guidance->empty() ? guidance : nullptr);
  (void)front_.advance(std::numeric_limits<std::int64_t>::max());
  is_cut_off_ = front_.cost(size_ / 2) == Wavefront::kUnreached;
}

void StaticHeuristic::seed_edge(const Guidance* guidance) {
  const GridGeometry& grid = grid_;
  const bool is_guided = guidance != nullptr;
  const auto cost_beyond = [&](const Eigen::Vector3i& at) {
    const Eigen::Vector3i place = at + grid.origin;
    return is_guided ? guidance->cost(place) : Wavefront::straight_cost(place - goal_);
  };
  // Above and below, the front starts only where the way does not go on beside the voxel, in the window: many fewer
  // seeds. A guided cost is that of the best voxel of a cell: late seeds do not split the front as early ones would.
  const int stride = is_guided ? Guidance::kCell : 1, late = is_guided ? Guidance::kCell * Wavefront::kStraight : 0;
  Eigen::Vector2i beside = {stride, 0};  // where it went on last
  const auto goes_on_beside = [&](const Eigen::Vector3i& at, int cost, const Eigen::Vector2i& step) {
    const Eigen::Vector3i next(at.x() + step.x(), at.y() + step.y(), at.z());
    const bool is_inside = next.x() >= 0 && next.y() >= 0 && next.x() < grid.size.x() && next.y() < grid.size.y();
    if (!is_inside || cost_beyond(next) > cost - Wavefront::straight_cost({step.x(), step.y(), 0})) return false;
    return is_guided || (front_.open(next.x(), next.y())[next.z() / 64] >> next.z() % 64 & 1) != 0;
  };
  const auto cost_above = [&](const Eigen::Vector3i& at) {
    const int cost = cost_beyond(at);
    if (cost >= Wavefront::kUnreached || goes_on_beside(at, cost, beside)) return int{Wavefront::kUnreached};
    for (int k = 0; k < 9; ++k) {
      const Eigen::Vector2i step(stride * (k / 3 - 1), stride * (k % 3 - 1));
      if (k == 4 || !goes_on_beside(at, cost, step)) continue;
      beside = step;
      return int{Wavefront::kUnreached};
    }
    return cost + late;
  };
  front_.seed_edge([&](const Eigen::Vector3i& at) {
    const bool is_side = at.x() == 0 || at.y() == 0 || at.x() == grid.size.x() - 1 || at.y() == grid.size.y() - 1;
    return is_side ? cost_beyond(at) : cost_above(at);
  });
}

std::optional<Eigen::Vector3d> StaticHeuristic::nearest_apart(const Eigen::AlignedBox3d& space,
                                                              const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                                              double apart_m) const {
  if (empty_) return {};
  const auto is_apart = [&](const Eigen::Vector3d& place) {
    const double along = std::clamp((place - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
    return (place - a - along * (b - a)).norm() > apart_m;
  };
  std::optional<Eigen::Vector3d> best;
  int least = Wavefront::kUnreached;
  for (int x = 0; x < size_.x(); ++x) {
    for (int y = 0; y < size_.y(); ++y) {
      for (int z = 0; z < size_.z(); ++z) {
        const Eigen::Vector3d place = grid_.origin.cast<double>() * grid_.resolution_m +
                                      (Eigen::Vector3d(x, y, z).array() + 0.5).matrix() * cell_m();
        const int cost = front_.cost({x, y, z});
        if (cost >= least || !is_open(grid_.voxel_of(place)) || !space.contains(place) || !is_apart(place)) continue;
        least = cost;
        best = place;
      }
    }
  }
  return best;
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

int StaticHeuristic::cost(const Eigen::Vector3d& place) const {
  const Eigen::Vector3i cell = in_cells(place).array().floor().matrix().cast<int>();
  return !empty_ && has_cell(cell) ? front_.cost(cell) : Wavefront::kUnreached;
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

// From cell to cell: each but the cheapest has a cheaper neighbour. The level ones come first.
std::optional<StaticHeuristic::Subgoal> StaticHeuristic::descend(const Eigen::Vector3d& place, int least) const {
  const Eigen::Vector3d from = in_cells(place);
  Eigen::Vector3i cell = from.array().floor().matrix().cast<int>();
  if (!has_cell(cell)) return {};
  std::optional<Subgoal> farthest;
  for (int cost = front_.cost(cell); cost > least;) {
    Eigen::Vector3i best = cell;
    for (const int dz : {0, -1, 1}) {
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          const Eigen::Vector3i next = cell + Eigen::Vector3i(dx, dy, dz);
          if (has_cell(next) && front_.cost(next) < cost) cost = front_.cost(next), best = next;
        }
      }
    }
    if (best == cell) break;
    cell = best;
    const Eigen::Vector3d middle = cell.cast<double>().array() + 0.5;
    if (farthest && !sees(from, middle)) break;  // the first one is near in any case
    farthest = Subgoal{grid_.origin.cast<double>() * grid_.resolution_m + middle * cell_m(), cost};
  }
  return farthest;
}

void StaticHeuristic::ticks(const Eigen::Vector3i& origin, int x, int first_y, int num_y, int num_z, std::size_t stride,
                            int per_cell, std::int16_t far, std::int16_t* out) const {
  const Eigen::Vector3i moved = origin - grid_.origin;  // voxels
  const auto whole = [&](int axis) {
    return moved[axis] >= 0 ? moved[axis] / kCellVoxels : (moved[axis] + 1) / kCellVoxels - 1;
  };
  const Eigen::Vector3i cells(whole(0), whole(1), whole(2));
  const Eigen::Vector3i more = ((moved - kCellVoxels * cells).array() != 0).cast<int>();  // overlap one more cell each
  for (int y = first_y; y < first_y + num_y; ++y, out += stride) {
    std::fill_n(out, stride, far);
    for (int at_x = x + cells.x(); at_x <= x + cells.x() + more.x(); ++at_x) {
      for (int at_y = y + cells.y(); at_y <= y + cells.y() + more.y(); ++at_y) {
        if (at_x < 0 || at_x >= size_.x() || at_y < 0 || at_y >= size_.y()) continue;
        const Wavefront::Cost* costs = front_.column(at_x, at_y);
        for (int z = 0; z < num_z; ++z) {
          for (int at_z = z + cells.z(); at_z <= z + cells.z() + more.z(); ++at_z) {
            if (at_z < 0 || at_z >= size_.z() || costs[at_z] == Wavefront::kUnreached) continue;
            out[z] = static_cast<std::int16_t>(std::min<int>(ticks_of(costs[at_z], per_cell), out[z]));
          }
        }
      }
    }
  }
}

}  // namespace swarm
