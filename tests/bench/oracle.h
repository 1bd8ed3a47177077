// The oracle: with the whole future known, could a robot have survived from a state on? A test tool, not part of the
// planner. Optimistic: acceleration may jump, and nothing but obstacles, other robots and limits counts.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <functional>
#include <queue>
#include <unordered_set>
#include <vector>

#include "planner_daemon/trajectory/bezier.h"
#include "swarm_sim/world/world.h"

namespace swarm {

class Oracle {
 public:
  // Where robot `index` (in the world's order) is at a time; asked for all robots but the one in question.
  using Others = std::function<Eigen::Vector3d(std::size_t index, double t_s)>;

  Oracle(const World& world, std::size_t robot, Others others)
      : world_(world), robot_(robot), others_(std::move(others)) {}

  // Whether any chain of accelerations (-a, 0, a per axis, 0.1 s each) keeps the robot from touching anything between
  // `from_s` and `until_s`. Depth first towards later times, each cell of time, 0.1 m and 0.4 m/s once.
  bool can_survive(double from_s, double until_s, const MotionState& start, int max_nodes = 200'000) {
    std::priority_queue<Node> open;
    std::unordered_set<std::uint64_t> seen;
    std::int64_t order = 0;
    open.push({0, order++, start.position, start.velocity});
    const int steps = static_cast<int>(std::ceil((until_s - from_s) / kStep_s));
    for (int nodes = 0; !open.empty() && nodes < max_nodes; ++nodes) {
      const Node node = open.top();
      open.pop();
      if (node.depth == steps) return true;
      for (int k = 0; k < 27; ++k) {
        const Eigen::Vector3d signs(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
        Node next = node;
        ++next.depth;
        next.order = order++;
        if (!fly(from_s + node.depth * kStep_s, world_.limits.a_max_mps2 * signs, &next)) continue;
        if (seen.insert(key(next)).second) open.push(next);
      }
    }
    return false;
  }

 private:
  static constexpr double kStep_s = 0.1;
  static constexpr int kChecks = 10;

  struct Node {
    int depth = 0;
    std::int64_t order = 0;
    Eigen::Vector3d position, velocity;
    bool operator<(const Node& other) const {  // the latest first, among equals the oldest
      return depth < other.depth || (depth == other.depth && order > other.order);
    }
  };

  static std::uint64_t key(const Node& node) {
    std::uint64_t hash = static_cast<std::uint64_t>(node.depth);
    for (int axis = 0; axis < 3; ++axis) {
      for (const double value : {node.position[axis] / 0.1, node.velocity[axis] / 0.4})
        hash = (hash ^ static_cast<std::uint64_t>(std::llround(value) + 100'000)) * 0x9e3779b97f4a7c15ULL;
    }
    return hash;
  }

  bool fly(double t_s, const Eigen::Vector3d& acceleration, Node* node) const {
    const double radius = world_.robots[robot_].radius_m;
    for (int i = 1; i <= kChecks; ++i) {
      const double h = kStep_s / kChecks;
      const Eigen::Vector3d before = node->velocity;
      node->velocity = (before + h * acceleration).cwiseMin(world_.limits.v_max_mps).cwiseMax(-world_.limits.v_max_mps);
      node->position += h / 2 * (before + node->velocity);
      if (node->position.z() < radius) return false;
      const double t = t_s + i * h;
      for (const WorldObstacle& obstacle : world_.obstacles) {
        const auto state = state_at(obstacle, world_, t);
        if (state && distance(obstacle.shape, node->position - state->position) < radius) return false;
      }
      for (std::size_t k = 0; k < world_.robots.size(); ++k) {
        const double radii = radius + world_.robots[k].radius_m;
        if (k != robot_ && (others_(k, t) - node->position).norm() < radii) return false;
      }
    }
    return true;
  }

  const World& world_;
  std::size_t robot_;
  Others others_;
};

}  // namespace swarm
