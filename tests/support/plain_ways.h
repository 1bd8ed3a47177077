// Least ways through open voxels by a plain Dijkstra search: the oracle of whatever knows the way.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <queue>
#include <tuple>
#include <vector>

#include "planner_daemon/guidance/wavefront.h"

namespace swarm {

class PlainWays {
 public:
  static constexpr int kNone = 65'535;  // so far and farther there is no way

  explicit PlainWays(const Eigen::Vector3i& grid_size)
      : size(grid_size), open(static_cast<std::size_t>(grid_size.prod()), false), costs(open.size(), kNone) {}

  bool contains(const Eigen::Vector3i& v) const { return (v.array() >= 0).all() && (v.array() < size.array()).all(); }
  std::size_t index(const Eigen::Vector3i& v) const {
    return static_cast<std::size_t>((v.x() * size.y() + v.y()) * size.z() + v.z());
  }
  bool is_open(const Eigen::Vector3i& v) const { return contains(v) && open[index(v)]; }
  bool is_outermost(const Eigen::Vector3i& v) const {
    return (v.array() == 0).any() || (v.array() == size.array() - 1).any();
  }
  template <class Visit>
  void for_each_voxel(const Visit& visit) const {
    for (int x = 0; x < size.x(); ++x) {
      for (int y = 0; y < size.y(); ++y) {
        for (int z = 0; z < size.z(); ++z) visit(Eigen::Vector3i(x, y, z));
      }
    }
  }

  // Of one step to a neighbour.
  static int step_cost(int dx, int dy) { return dx != 0 && dy != 0 ? 11 : 10; }
  void seed(const Eigen::Vector3i& v, int cost) {
    if (is_open(v)) queue_.emplace(cost, v.x(), v.y(), v.z());
  }
  // At the open voxels nearest to the goal, at most `beside` voxels away.
  void seed_goal(const Eigen::Vector3i& goal, double beside) {
    double nearest2 = beside * beside + 1e-6;
    const auto distance2 = [&](const Eigen::Vector3i& v) { return (v - goal).cast<double>().squaredNorm(); };
    for_each_voxel([&](const Eigen::Vector3i& v) {
      if (is_open(v)) nearest2 = std::min(nearest2, distance2(v));
    });
    for_each_voxel([&](const Eigen::Vector3i& v) {
      if (distance2(v) <= nearest2) seed(v, Wavefront::straight_cost(v - goal));
    });
  }
  template <class CostOf>
  void seed_edge(const CostOf& cost_of) {
    for_each_voxel([&](const Eigen::Vector3i& v) {
      if (is_outermost(v)) seed(v, cost_of(v));
    });
  }

  void search() {
    while (!queue_.empty()) {
      const auto [cost, x, y, z] = queue_.top();
      queue_.pop();
      if (cost >= costs[index({x, y, z})]) continue;
      costs[index({x, y, z})] = cost;
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dz = -1; dz <= 1; ++dz) {
            const Eigen::Vector3i next(x + dx, y + dy, z + dz);
            const int next_cost = cost + step_cost(dx, dy);
            if (is_open(next) && next_cost < costs[index(next)])
              queue_.emplace(next_cost, next.x(), next.y(), next.z());
          }
        }
      }
    }
  }

  int cost(const Eigen::Vector3i& v) const { return costs[index(v)]; }
  // The least of a cell of `edge` voxels along each edge.
  int cell_cost(const Eigen::Vector3i& cell, int edge) const {
    int least = kNone;
    const Eigen::Vector3i first = edge * cell, last = (first.array() + edge).min(size.array()) - 1;
    for (int x = first.x(); x <= last.x(); ++x) {
      for (int y = first.y(); y <= last.y(); ++y) {
        for (int z = first.z(); z <= last.z(); ++z) least = std::min(least, cost({x, y, z}));
      }
    }
    return least;
  }

  Eigen::Vector3i size;
  std::vector<bool> open;
  std::vector<int> costs;

 private:
  using Entry = std::tuple<int, int, int, int>;  // cost, voxel
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue_;
};

}  // namespace swarm
