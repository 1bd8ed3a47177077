#include "planner_daemon/guidance/guidance.h"

#include <utility>

namespace swarm {
namespace {

// Words of the front that are worked out for another goal at once (about 20 ms), with each plan until then, and with
// each plan while older ways still serve.
constexpr std::int64_t kAtOnce = 500'000, kUntilItServes = 50'000, kEachTime = 3'000;

constexpr double kAtGoal = 1.5;  // voxels: a way that ends so near leads to the goal

}  // namespace

void Guidance::update(const Sogm& sogm, const Sogm& standing, const Sogm* seen, const Eigen::Vector3d& goal,
                      double blocked_m) {
  if (!std::exchange(has_worked_, false)) work();
  is_stale_ = map_.see(sogm, standing, seen, goal, blocked_m) || is_stale_;
  const bool is_new = goal != goal_ || sogm.geometry.resolution_m != resolution_m_;
  if (is_new) {
    goal_ = goal;
    resolution_m_ = sogm.geometry.resolution_m;
    goal_voxel_ = lattice_voxel(goal, resolution_m_);
    const Eigen::Vector3i& size = map_.blocked().geometry.size;
    for (Field& field : fields_) {  // their memory at once: another goal takes its time in any case
      if (field.front.size() != size) field.front.lay_out(size, kCell);
    }
  }
  is_urgent_ = !map_.empty() && (is_new || is_urgent_);
  if (is_new || map_.empty()) {
    empty_ = true;
    works_ = false;
  }
  if (is_new && is_urgent_) {
    begin();
    work_on(kAtOnce);
  }
}

bool Guidance::leads_from(const Eigen::Vector3d& place) const {
  const Eigen::Vector3i voxel = lattice_voxel(place, resolution_m_);
  for (int k = 0; k < 27; ++k) {  // the robot may touch what blocks it
    const Eigen::Vector3i beside = voxel + 3 * Eigen::Vector3i(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
    if (cost(beside) != Wavefront::kUnreached) return true;
  }
  return false;
}

void Guidance::reconsider(const Eigen::Vector3d& place) {
  if (!empty_ && !works_ && !is_stale_ && !leads_from(place) && map_.forget_seen()) is_stale_ = true;
}

void Guidance::forget() {
  (void)map_.forget_seen();
  resolution_m_ = 0.0;
  empty_ = true;
  works_ = false;
}

bool Guidance::is_unreachable(const Eigen::Vector3d& place) const {
  if (resolution_m_ == 0.0) return false;  // it knows no goal yet
  if (!map_.in_flight_space(goal_voxel_)) return true;
  if (empty_) return false;
  const Field& field = fields_[static_cast<std::size_t>(serves_)];
  return (field.grid.contains(goal_voxel_ - field.grid.origin) && field.beside_goal > kAtGoal) || !leads_from(place);
}

void Guidance::work() {
  has_worked_ = true;
  if (works_) {
    work_on(is_urgent_ ? kUntilItServes : kEachTime);
  } else if (is_stale_ && !map_.empty()) {
    begin();
  }
}

void Guidance::work_on(std::int64_t words) {
  if (!fields_[static_cast<std::size_t>(1 - serves_)].front.advance(words)) return;
  serves_ = 1 - serves_;
  works_ = empty_ = is_urgent_ = false;
}

// Where the goal lies outside what is known, the way leads there from the edge.
void Guidance::begin() {
  Field& field = fields_[static_cast<std::size_t>(1 - serves_)];
  const Sogm& blocked = map_.blocked();
  const GridGeometry& grid = blocked.geometry;
  field.grid = grid;
  Wavefront& front = field.front;
  front.lay_out(grid.size, kCell);
  const int words = grid.words_per_column();
  const std::uint64_t top = grid.size.z() % 64 == 0 ? ~std::uint64_t{0} : (std::uint64_t{1} << grid.size.z() % 64) - 1;
  for (int x = 0; x < grid.size.x(); ++x) {
    for (int y = 0; y < grid.size.y(); ++y) {
      const std::uint64_t* in = blocked.column(0, x, y);
      std::uint64_t* open = front.open(x, y);
      for (int w = 0; w < words; ++w) open[w] = ~in[w] & (w == words - 1 ? top : ~std::uint64_t{0});
    }
  }
  field.beside_goal = front.seed_goal(goal_voxel_ - grid.origin, kBeside_m / grid.resolution_m);
  if (!grid.contains(goal_voxel_ - grid.origin)) {
    column_.resize(static_cast<std::size_t>(grid.size.z()));
    const auto cost_of = [&](int x, int y, int z) { return straight_cost(grid.origin + Eigen::Vector3i(x, y, z)); };
    const auto costs_of = [&](int x, int y) {
      for (int z = 0; z < grid.size.z(); ++z) column_[static_cast<std::size_t>(z)] = cost_of(x, y, z);
      return std::span<const int>(column_);
    };
    front.seed_edge(costs_of, cost_of);
  }
  works_ = true;
  is_stale_ = false;
}

int Guidance::cost(const Eigen::Vector3i& voxel) const {
  int cost = 0;
  costs(voxel, Eigen::Vector3i::Zero(), {&cost, 1});
  return cost;
}

void Guidance::costs(const Eigen::Vector3i& first, const Eigen::Vector3i& step, std::span<int> costs) const {
  const auto& [front, grid, beside_goal] = fields_[static_cast<std::size_t>(serves_)];
  Eigen::Vector3i at = first - grid.origin;
  for (int& cost : costs) {
    if (grid.contains(at)) {
      cost = front.cost({at.x() / kCell, at.y() / kCell, at.z() / kCell});
    } else {
      const Eigen::Vector3i voxel = at + grid.origin;
      cost = map_.in_flight_space(voxel) ? straight_cost(voxel) : int{Wavefront::kUnreached};
    }
    at += step;
  }
}

}  // namespace swarm
