#include "swarm_sim/world/occupied_cubes.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "map_daemon/octomap_file.h"

namespace swarm {
namespace {

constexpr std::uint32_t kCubesPerLeaf = 8;

double box_distance(const Eigen::Vector3d& point, const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
  return (min - point).cwiseMax(point - max).cwiseMax(0.0).norm();
}

// Of a ray, whose direction's inverse is given: infinite where it does not meet the box.
double length_to_box(const Eigen::Vector3d& from, const Eigen::Vector3d& inverse, const Eigen::Vector3d& min,
                     const Eigen::Vector3d& max) {
  double begin = 0.0, end = INFINITY;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::isinf(inverse[axis])) {
      if (from[axis] < min[axis] || from[axis] > max[axis]) return INFINITY;
      continue;
    }
    const double a = (min[axis] - from[axis]) * inverse[axis], b = (max[axis] - from[axis]) * inverse[axis];
    begin = std::max(begin, std::min(a, b));
    end = std::min(end, std::max(a, b));
  }
  return begin <= end ? begin : INFINITY;
}

}  // namespace

OccupiedCubes::OccupiedCubes(std::vector<Cube> cubes) : cubes_(std::move(cubes)) {
  if (!cubes_.empty()) build(0, static_cast<std::uint32_t>(cubes_.size()));
}

OccupiedCubes OccupiedCubes::load(const std::filesystem::path& path) {
  const std::unique_ptr<octomap::OcTree> tree = read_octomap(path.string());
  std::vector<Cube> cubes;
  for (auto leaf = tree->begin_leafs(); leaf != tree->end_leafs(); ++leaf) {
    if (tree->isNodeOccupied(*leaf)) cubes.push_back({{leaf.getX(), leaf.getY(), leaf.getZ()}, 0.5 * leaf.getSize()});
  }
  return OccupiedCubes(std::move(cubes));
}

std::uint32_t OccupiedCubes::build(std::uint32_t begin, std::uint32_t end) {
  Node node{Eigen::Vector3d::Constant(INFINITY), Eigen::Vector3d::Constant(-INFINITY), begin, end, 0};
  for (std::uint32_t i = begin; i < end; ++i) {
    node.min = node.min.cwiseMin((cubes_[i].center.array() - cubes_[i].half_edge_m).matrix());
    node.max = node.max.cwiseMax((cubes_[i].center.array() + cubes_[i].half_edge_m).matrix());
  }
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.push_back(node);
  if (end - begin > kCubesPerLeaf) {
    int axis = 0;
    (node.max - node.min).maxCoeff(&axis);
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(cubes_.begin() + begin, cubes_.begin() + middle, cubes_.begin() + end,
                     [axis](const Cube& a, const Cube& b) { return a.center[axis] < b.center[axis]; });
    build(begin, middle);
    const std::uint32_t second = build(middle, end);
    nodes_[index].second = second;
  }
  return index;
}

double OccupiedCubes::distance(const Eigen::Vector3d& point, double max_m) const {
  return nodes_.empty() ? max_m : descend(0, point, max_m);
}

double OccupiedCubes::ray_length(const Eigen::Vector3d& from, const Eigen::Vector3d& direction, double max_m) const {
  return nodes_.empty() ? max_m : follow(0, from, direction.cwiseInverse(), max_m);
}

double OccupiedCubes::follow(std::uint32_t index, const Eigen::Vector3d& from, const Eigen::Vector3d& inverse,
                             double best) const {
  const Node& node = nodes_[index];
  if (node.second == 0) {
    for (std::uint32_t i = node.begin; i < node.end; ++i) {
      const Eigen::Vector3d half = Eigen::Vector3d::Constant(cubes_[i].half_edge_m);
      best = std::min(best, length_to_box(from, inverse, cubes_[i].center - half, cubes_[i].center + half));
    }
    return best;
  }
  std::uint32_t near = index + 1, far = node.second;
  double near_m = length_to_box(from, inverse, nodes_[near].min, nodes_[near].max);
  double far_m = length_to_box(from, inverse, nodes_[far].min, nodes_[far].max);
  if (far_m < near_m) std::swap(near, far), std::swap(near_m, far_m);
  if (near_m < best) best = follow(near, from, inverse, best);
  if (far_m < best) best = follow(far, from, inverse, best);
  return best;
}

double OccupiedCubes::descend(std::uint32_t index, const Eigen::Vector3d& point, double best) const {
  const Node& node = nodes_[index];
  if (node.second == 0) {
    for (std::uint32_t i = node.begin; i < node.end; ++i) {
      const Eigen::Vector3d half = Eigen::Vector3d::Constant(cubes_[i].half_edge_m);
      best = std::min(best, box_distance(point, cubes_[i].center - half, cubes_[i].center + half));
    }
    return best;
  }
  std::uint32_t near = index + 1, far = node.second;
  double near_m = box_distance(point, nodes_[near].min, nodes_[near].max);
  double far_m = box_distance(point, nodes_[far].min, nodes_[far].max);
  if (far_m < near_m) std::swap(near, far), std::swap(near_m, far_m);
  if (near_m < best) best = descend(near, point, best);
  if (far_m < best) best = descend(far, point, best);
  return best;
}

}  // namespace swarm
