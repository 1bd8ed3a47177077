#include "map_daemon/perception/clusters.h"

#include <algorithm>
#include <bit>

namespace swarm {
namespace {

constexpr int kEdge = FreeSpaceGrid::kEdge;
constexpr int kGap = 3;      // voxels of a column with no more than two empty ones between hang together
constexpr int kReach = 2;    // and columns with no more than one
constexpr int kSlack = 2;    // whose heights are no further apart
constexpr int kUpright = 3;  // what is no higher is flat: ground, or a table
constexpr int kBeside = 3;   // an end is an end where one of so many voxels beyond it is seen to be free
constexpr int kLeastVoxels = 2;

}  // namespace

template <class Visit>
void ClusterFinder::for_each_near(const Run& run, int reach, const Visit& visit) {
  for (int x = std::max(run.x - reach, 0); x <= std::min(run.x + reach, kEdge - 1); ++x) {
    for (int y = std::max(run.y - reach, 0); y <= std::min(run.y + reach, kEdge - 1); ++y) {
      const int first = cell(x, y);
      if (first < 0) continue;
      for (auto i = static_cast<std::size_t>(first); i < runs_.size() && runs_[i].x == x && runs_[i].y == y; ++i) {
        if (runs_[i].low <= run.high + kSlack && runs_[i].high >= run.low - kSlack) visit(static_cast<int>(i));
      }
    }
  }
}

void ClusterFinder::collect_runs(const FreeSpaceGrid& grid, bool steps) {
  if (first_run_.empty()) first_run_.assign(std::size_t{kEdge} * kEdge, -1);
  for (const Run& run : runs_) cell(run.x, run.y) = -1;
  runs_.clear();
  for (const int column : grid.surface_columns()) {
    const Eigen::Vector2i place = grid.place_of(column);
    cell(place.x(), place.y()) = static_cast<int>(runs_.size());
    std::uint64_t rest = grid.surfaces(column);
    // What stands seems to step to and fro by a voxel, where poses err, and rays pass through parts of its voxels.
    std::uint64_t was_free = grid.ever_free(column), beside = 0;
    for (int x = std::max(place.x() - 1, 0); steps && x <= std::min(place.x() + 1, kEdge - 1); ++x) {
      for (int y = std::max(place.y() - 1, 0); y <= std::min(place.y() + 1, kEdge - 1); ++y) {
        beside |= grid.lasting(grid.column_of(x, y));
        was_free &= grid.ever_free(grid.column_of(x, y));
      }
    }
    was_free &= ~(beside | beside << 1 | beside >> 1);
    while (rest != 0) {
      const int low = std::countr_zero(rest);
      int high = low;
      for (int next = high + 1; next < 64 && next <= high + kGap; ++next)
        if ((rest >> next & 1) != 0) high = next;
      const std::uint64_t span = (~std::uint64_t{0} >> (63 - (high - low))) << low;
      const std::uint64_t bits = rest & span;
      runs_.push_back({place.x(), place.y(), low, high, bits, bits & was_free, static_cast<int>(runs_.size()), false});
      rest &= ~span;
    }
  }
}

// What stands upright, and what is where nothing was.
void ClusterFinder::take_runs() {
  for (Run& run : runs_) {
    run.taken = 2 * std::popcount(run.moved) >= std::popcount(run.bits);
    if (run.taken) continue;
    int low = run.low, high = run.high;
    for_each_near(run, 1, [&](int other) {
      low = std::min(low, runs_[static_cast<std::size_t>(other)].low);
      high = std::max(high, runs_[static_cast<std::size_t>(other)].high);
    });
    run.taken = high - low >= kUpright;
  }
}

int ClusterFinder::root(int run) {
  while (runs_[static_cast<std::size_t>(run)].parent != run) {
    int& parent = runs_[static_cast<std::size_t>(run)].parent;
    parent = runs_[static_cast<std::size_t>(parent)].parent;
    run = parent;
  }
  return run;
}

void ClusterFinder::join_runs() {
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    if (!runs_[i].taken) continue;
    for_each_near(runs_[i], kReach, [&](int other) {
      if (!runs_[static_cast<std::size_t>(other)].taken) return;
      const int a = root(static_cast<int>(i)), b = root(other);
      runs_[static_cast<std::size_t>(std::max(a, b))].parent = std::min(a, b);
    });
  }
}

// Its points to each cluster, in their order.
void ClusterFinder::give_points() {
  points_.resize(cluster_of_place_.size());
  int* next = points_.data();
  for (std::size_t i = 0; i < clusters_.size(); ++i) {
    clusters_[i].points = {next, sizes_[i]};
    next += sizes_[i];
    sizes_[i] = 0;
  }
  for (std::size_t i = 0; i < cluster_of_place_.size(); ++i) {
    if (cluster_of_place_[i] < 0) continue;
    const auto number = static_cast<std::size_t>(cluster_of_place_[i]);
    points_[static_cast<std::size_t>(clusters_[number].points.data() - points_.data()) + sizes_[number]++] =
        static_cast<int>(i);
  }
}

const std::vector<Cluster>& ClusterFinder::find(const FreeSpaceGrid& grid, std::span<const Eigen::Vector3d> places,
                                                std::span<const Eigen::Vector3i> voxels, bool steps) {
  collect_runs(grid, steps);
  take_runs();
  join_runs();
  clusters_.clear();
  cluster_of_run_.assign(runs_.size(), -1);
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    const Run& run = runs_[i];
    if (!run.taken) continue;
    int& number = cluster_of_run_[static_cast<std::size_t>(root(static_cast<int>(i)))];
    if (number < 0) {
      number = static_cast<int>(clusters_.size());
      clusters_.emplace_back();
    }
    cluster_of_run_[i] = number;
    Cluster& cluster = clusters_[static_cast<std::size_t>(number)];
    ++cluster.num_columns;
    cluster.voxels += std::popcount(run.bits);
    const int column = grid.column_of(run.x, run.y);
    const std::uint64_t free = grid.free(column);
    const auto is_open = [free](int first, int last) {
      for (int z = std::max(first, 0); z <= std::min(last, 63); ++z)
        if ((free >> z & 1) != 0) return false;
      return true;
    };
    if (is_open(run.high + 1, run.high + kBeside)) ++cluster.open_above;
    if (is_open(run.low - kBeside, run.low - 1)) ++cluster.open_below;
  }
  has_moved_.assign(places.size(), 0);
  cluster_of_place_.assign(places.size(), -1);
  sizes_.assign(clusters_.size(), 0);
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Eigen::Vector3i& voxel = voxels[i];
    if (!grid.geometry().contains(voxel)) continue;
    const int first = cell(voxel.x(), voxel.y());
    for (auto r = static_cast<std::size_t>(std::max(first, 0)); first >= 0 && r < runs_.size(); ++r) {
      const Run& run = runs_[r];
      if (run.x != voxel.x() || run.y != voxel.y()) break;
      if (voxel.z() > run.high) continue;
      if (cluster_of_run_[r] < 0) break;
      has_moved_[i] = (run.moved >> voxel.z() & 1) != 0 ? 1 : 0;
      cluster_of_place_[i] = cluster_of_run_[r];
      Cluster& cluster = clusters_[static_cast<std::size_t>(cluster_of_run_[r])];
      if (sizes_[static_cast<std::size_t>(cluster_of_run_[r])]++ == 0) cluster.low = cluster.high = places[i];
      cluster.low = cluster.low.cwiseMin(places[i]);
      cluster.high = cluster.high.cwiseMax(places[i]);
      break;
    }
  }
  give_points();
  std::erase_if(clusters_, [](const Cluster& cluster) {
    return cluster.points.empty() || (cluster.voxels < kLeastVoxels && cluster.points.size() < 3);
  });
  return clusters_;
}

}  // namespace swarm
