// Least ways to a goal through open voxels: Dial's algorithm, 64 voxels at a time.
//
// The room guidance/ knows the way: what stands still beyond the window of the SOGM, and how far it is to the goal from
// everywhere around it (the paper names the absence of global guidance as its weakness, section VI).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace swarm {

// Visits the voxels that is_open(voxel) and that are the nearest to the goal, at most `beside` voxels away. Returns how
// far these are [voxels]; infinity: there are none.
template <class IsOpen, class Visit>
double for_each_nearest(const Eigen::Vector3i& goal, double beside, const IsOpen& is_open, const Visit& visit) {
  double nearest2 = std::numeric_limits<double>::infinity();
  const int reach = static_cast<int>(beside + 1e-9);
  const auto for_each_open = [&](const auto& look_at) {
    for (int x = -reach; x <= reach; ++x) {
      for (int y = -reach; y <= reach; ++y) {
        for (int z = -reach; z <= reach; ++z) {
          const Eigen::Vector3i way(x, y, z);
          if (is_open(goal + way)) look_at(goal + way, way.cast<double>().squaredNorm());
        }
      }
    }
  };
  for_each_open([&](const Eigen::Vector3i&, double distance2) { nearest2 = std::min(nearest2, distance2); });
  if (nearest2 > beside * beside + 1e-9) return std::numeric_limits<double>::infinity();
  for_each_open([&](const Eigen::Vector3i& voxel, double distance2) {
    if (distance2 <= nearest2 + 1e-9) visit(voxel);
  });
  return std::sqrt(nearest2);
}

// A step goes to any of the 26 neighbours. It costs kStraight, and kDiagonal where it leads along x and y at once; what
// it climbs or sinks on the way is free. So a way is nearly as short as it can be, although limits for each axis would
// make diagonals cheaper yet.
class Wavefront {
 public:
  using Cost = std::uint16_t;
  static constexpr int kStraight = 10, kDiagonal = 11;
  static constexpr Cost kUnreached = 65'535;

  // Of a way with nothing around.
  static int straight_cost(const Eigen::Vector3i& way) {
    const Eigen::Vector3i lengths = way.cwiseAbs();
    const int steps = lengths.maxCoeff(), diagonal = std::max(0, lengths.x() + lengths.y() - steps);
    return kStraight * steps + (kDiagonal - kStraight) * diagonal;
  }

  // `size` voxels, all closed; costs are kept for cells of `cell` voxels along each edge. Keeps its memory.
  void lay_out(const Eigen::Vector3i& size, int cell);
  // Words of a column of voxels (bit k of word w: z = 64 w + k), to be set where it is open before the front starts.
  // Bits above the size stay 0.
  std::uint64_t* open(int x, int y) { return open_.data() + word_of(x, y); }
  int words_per_column() const { return words_; }

  // The front starts at these voxels with such a cost: where they are open.
  void seed(int x, int y, int w, std::uint64_t bits, int cost);
  // It starts at the goal; where that is closed, at the open voxels nearest to it, at most `beside` voxels away.
  // Returns how far these are [voxels]; infinity: there are none.
  double seed_goal(const Eigen::Vector3i& goal, double beside);
  // It starts at voxels of this column, by z: kUnreached or more where it does not.
  void seed_column(int x, int y, std::span<const int> costs);
  // It starts at the outermost voxels: costs_beside(x, y) of the columns at the sides, and cost_above(x, y, z) at both
  // ends of the others.
  template <class CostsBeside, class CostAbove>
  void seed_edge(const CostsBeside& costs_beside, const CostAbove& cost_above);
  // Spreads until about `max_words` words were reached; true: it is complete.
  bool advance(std::int64_t max_words);

  // Of the voxel of a cell that is the nearest to the goal; kUnreached: none of them leads there.
  Cost cost(const Eigen::Vector3i& cell) const { return column(cell.x(), cell.y())[cell.z()]; }
  // The same of a column of cells, from z = 0 on.
  const Cost* column(int x, int y) const { return costs_.data() + (Eigen::Index{x} * cells_.y() + y) * cells_.z(); }
  const Eigen::Vector3i& size() const { return size_; }  // voxels
  const Eigen::Vector3i& cells() const { return cells_; }

 private:
  struct Voxels {
    std::uint32_t word;  // of open_
    std::uint64_t bits;
  };
  struct Seed {
    int cost;
    Voxels voxels;
  };
  static constexpr std::size_t kRing = kDiagonal + 1;

  std::size_t word_of(int x, int y) const {  // a rim of closed columns around
    return (static_cast<std::size_t>(x + 1) * static_cast<std::size_t>(size_.y() + 2) +
            static_cast<std::size_t>(y + 1)) *
           static_cast<std::size_t>(words_);
  }
  void reach(const Voxels& voxels);
  void keep_cost(std::uint32_t word, std::uint64_t bits);
  void spread(std::uint32_t word, std::uint64_t bits);
  void push(std::uint32_t word, std::uint64_t bits, int cost) {
    bits &= open_[word];
    if (bits != 0) ring_[static_cast<std::size_t>(cost) % kRing].push_back({word, bits});
  }

  Eigen::Vector3i size_ = Eigen::Vector3i::Zero(), cells_ = Eigen::Vector3i::Zero();
  int cell_ = 1, words_ = 0;
  std::vector<std::uint64_t> open_;              // voxels not reached yet
  std::vector<std::uint64_t> new_;               // reached at the cost in force
  std::vector<std::uint32_t> front_;             // words of new_
  std::array<std::vector<Voxels>, kRing> ring_;  // to be reached, by cost
  std::vector<Seed> seeds_;                      // the cheapest last, once it goes
  bool started_ = false;
  int cost_ = 0;  // in force
  std::vector<Cost> costs_;
  std::vector<std::uint32_t> cell_columns_;  // of a column of voxels, the rim's among them: where its cells begin
  std::vector<std::uint16_t> cell_at_;       // of a voxel's place along z
};

template <class CostsBeside, class CostAbove>
void Wavefront::seed_edge(const CostsBeside& costs_beside, const CostAbove& cost_above) {
  for (int x = 0; x < size_.x(); ++x) {
    for (int y = 0; y < size_.y(); ++y) {
      if (x == 0 || y == 0 || x == size_.x() - 1 || y == size_.y() - 1) {
        seed_column(x, y, costs_beside(x, y));
        continue;
      }
      for (const int z : {0, size_.z() - 1}) {
        const int cost = cost_above(x, y, z);
        if (cost < kUnreached) seed(x, y, z / 64, std::uint64_t{1} << z % 64, cost);
      }
    }
  }
}

}  // namespace swarm
