// The static map as exact geometry, for judging: the cubes of an OctoMap's occupied leaves, in a tree of
// bounding boxes.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace swarm {

class OccupiedCubes {
 public:
  struct Cube {
    Eigen::Vector3d center;  // W [m]
    double half_edge_m;
  };

  explicit OccupiedCubes(std::vector<Cube> cubes);

  // Of an OcTree file (.bt or .ot). Throws std::runtime_error, one line that names the file, as read_octomap does.
  static OccupiedCubes load(const std::filesystem::path& path);

  // Distance from `point` [m] to the nearest cube, 0 inside one; `max_m` when none is nearer than that.
  double distance(const Eigen::Vector3d& point, double max_m) const;

  // How far the ray from `from` in `direction` (of length 1) gets before it meets a cube, at most `max_m`; 0 inside
  // one.
  double ray_length(const Eigen::Vector3d& from, const Eigen::Vector3d& direction, double max_m) const;

  const std::vector<Cube>& cubes() const { return cubes_; }

 private:
  // A box around cubes [begin, end). Inner nodes: the first half is the next node, the second half starts at `second`.
  struct Node {
    Eigen::Vector3d min, max;
    std::uint32_t begin, end;
    std::uint32_t second;  // 0: a leaf
  };

  std::uint32_t build(std::uint32_t begin, std::uint32_t end);
  double descend(std::uint32_t index, const Eigen::Vector3d& point, double best) const;
  double follow(std::uint32_t index, const Eigen::Vector3d& from, const Eigen::Vector3d& inverse, double best) const;

  std::vector<Cube> cubes_;
  std::vector<Node> nodes_;
};

}  // namespace swarm
