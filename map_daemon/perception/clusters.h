// What a scan saw, as pieces that hang together: surfaces whose voxels are near each other.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "map_daemon/perception/free_space_grid.h"

namespace swarm {

struct Cluster {
  std::span<const int> points;         // indices of the scan's surfaces
  Eigen::Vector3d low, high;           // of them, W [m]
  int num_columns = 0, voxels = 0;     // that they are in
  int open_above = 0, open_below = 0;  // columns above and below which nothing is seen to be free
};

class ClusterFinder {
 public:
  // Of the surfaces that `grid` was shown in this scan, by what it knew before; `places` are these (W [m]), and
  // `voxels` where they are in its window. Left out are what
  // is flat and was never free (the ground), what a single ray met, and what is too far. Valid until the next call.
  // `steps`: what stands may seem to step to and fro by a voxel.
  const std::vector<Cluster>& find(const FreeSpaceGrid& grid, std::span<const Eigen::Vector3d> places,
                                   std::span<const Eigen::Vector3i> voxels, bool steps = true);

  // One of these places: nothing was there before, and nothing stood beside it that may seem to step there.
  bool has_moved(int point) const { return has_moved_[static_cast<std::size_t>(point)] != 0; }

 private:
  // Voxels of one column that hang together, in the window of the grid.
  struct Run {
    int x, y, low, high;
    std::uint64_t bits;
    std::uint64_t moved;
    int parent;
    bool taken;
  };

  void collect_runs(const FreeSpaceGrid& grid, bool steps);
  void take_runs();
  void join_runs();
  void give_points();
  int root(int run);
  int& cell(int x, int y) { return first_run_[static_cast<std::size_t>(x * FreeSpaceGrid::kEdge + y)]; }
  template <class Visit>
  void for_each_near(const Run& run, int reach, const Visit& visit);

  std::vector<Run> runs_;       // of a column one after the other
  std::vector<int> first_run_;  // of a column, or -1
  std::vector<int> cluster_of_run_;
  std::vector<int> cluster_of_place_;  // or -1
  std::vector<std::size_t> sizes_;     // of the clusters: points of them
  std::vector<int> points_;            // of the clusters, one after the other
  std::vector<Cluster> clusters_;
  std::vector<char> has_moved_;  // of each place
};

}  // namespace swarm
