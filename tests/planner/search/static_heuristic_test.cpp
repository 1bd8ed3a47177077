// StaticHeuristic against a plain breadth-first search over the same cells.
#include "planner_daemon/search/static_heuristic.h"

#include <gtest/gtest.h>

#include <deque>
#include <map>
#include <vector>

#include "tests/support/random_map.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr double kClearance_m = 0.25;

// Least steps from every open cell: to the goal's cell, or to a cell at the window's rim (or top or bottom) and
// straight on from there.
class PlainStaticHeuristic {
 public:
  PlainStaticHeuristic(const Sogm& standing, const Vector3d& goal, double low_z, double high_z)
      : size(cells_in(standing.geometry)), cell_m(kCellVoxels * standing.geometry.resolution_m) {
    const GridGeometry& grid = standing.geometry;
    const Vector3d corner = grid.origin.cast<double>() * grid.resolution_m;
    const Vector3i goal_cell = ((goal - corner) / cell_m).array().floor().matrix().cast<int>();
    steps.assign(static_cast<std::size_t>(size.prod()), kClosed);
    std::multimap<int, Vector3i> seeds;
    for_each([&](const Vector3i& cell) {
      const Vector3d middle = corner + cell_m * (cell.cast<double>().array() + 0.5).matrix();
      bool open = distance_to_occupied(standing, 0, middle, 1.0) > kClearance_m + 1e-6;
      const double bottom = corner.z() + cell.z() * cell_m;
      open = open && bottom + cell_m > low_z && bottom < high_z;
      if (cell == goal_cell) open = true;
      if (!open) return;
      at(cell) = kUnknown;
      const Vector3i last = size - Vector3i::Ones();
      bool rim = cell.x() == 0 || cell.y() == 0 || cell.x() == last.x() || cell.y() == last.y();
      rim = rim || (cell.z() == 0 && low_z < corner.z());  // beyond floor and ceiling only where the space goes on
      rim = rim || (cell.z() == last.z() && high_z > corner.z() + cell_m * size.z());
      if (!rim && cell != goal_cell) return;
      seeds.emplace(static_cast<int>((goal - middle).cwiseAbs().maxCoeff() / cell_m), cell);
    });
    std::deque<std::pair<int, Vector3i>> queue;
    for (int step = 0; !queue.empty() || !seeds.empty(); ++step) {
      while (!seeds.empty() && seeds.begin()->first == step) {
        queue.emplace_back(step, seeds.begin()->second);
        seeds.erase(seeds.begin());
      }
      for (std::size_t n = queue.size(); n > 0; --n) {
        const Vector3i cell = queue.front().second;
        queue.pop_front();
        if (at(cell) != kUnknown) continue;
        at(cell) = step;
        for (int k = 0; k < 27; ++k) {
          const Vector3i next = cell + Vector3i(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
          if ((next.array() >= 0).all() && (next.array() < size.array()).all() && at(next) == kUnknown)
            queue.emplace_back(step + 1, next);
        }
      }
    }
  }

  template <class Visit>
  void for_each(const Visit& visit) {
    for (int x = 0; x < size.x(); ++x) {
      for (int y = 0; y < size.y(); ++y) {
        for (int z = 0; z < size.z(); ++z) visit(Vector3i(x, y, z));
      }
    }
  }
  int& at(const Vector3i& cell) {
    return steps[static_cast<std::size_t>((cell.x() * size.y() + cell.y()) * size.z() + cell.z())];
  }

  static constexpr int kUnknown = -1, kClosed = -2;
  Vector3i size;
  double cell_m;
  std::vector<int> steps;
};

TEST(StaticHeuristicTest, EqualsAPlainBreadthFirstSearch) {
  Rng rng(3);
  StaticHeuristic static_heuristic;
  int closed = 0, detours = 0, cells = 0;
  for (int trial = 0; trial < 40; ++trial) {
    // Even and odd sizes; columns of one, two and three words of cells.
    const Vector3d size_m = trial % 4 == 3 ? Vector3d(1.1, 0.9, 14.0 + 6 * (trial % 3)) : Vector3d(4, 3.1, 2.1);
    Sogm standing = empty_map(size_m, 0.1, 1, Utime(), 100ms);
    const Vector3d half = size_m / 2;
    for (int i = 0; i < 12; ++i) mark_ball(&standing, 0, in_box(rng, -half, half), uniform(rng, 0.1, 0.7), i % 3 == 0);
    if (trial % 2 == 0) mark_box(&standing, {0, -9, -9}, {0.3, uniform(rng, 0, 1), 99}, 0, 0);
    const Vector3d goal = trial % 5 == 0 ? in_box(rng, -4 * half, 4 * half) : in_box(rng, -half, half);
    const double low_z = uniform(rng, -2, -0.5), high_z = uniform(rng, 0.4, 9);
    static_heuristic.build({&standing}, kClearance_m, goal, low_z, high_z);
    PlainStaticHeuristic plain(standing, goal, low_z, high_z);
    const Vector3d corner = standing.geometry.origin.cast<double>() * 0.1;
    plain.for_each([&](const Vector3i& cell) {
      SCOPED_TRACE(testing::Message() << "trial " << trial << " cell " << cell.transpose());
      const Vector3d inside =
          corner + plain.cell_m * (cell.cast<double>() + in_box(rng, {0.01, 0.01, 0.01}, {0.99, 0.99, 0.99}));
      // Looked up from a window that has moved since, by less than half a cell more.
      const Vector3i moved(uniform_int(rng, -2, 2), uniform_int(rng, -2, 2), uniform_int(rng, -2, 2));
      const Vector3d later = corner + plain.cell_m * moved.cast<double>() + in_cube(rng, 0.45 * plain.cell_m);
      const Vector3i from = cell - moved;
      std::vector<std::int16_t> steps(static_cast<std::size_t>(plain.size.z()), 7);
      static_heuristic.steps(later, from.x(), from.y(), 1, plain.size.z(), steps.size(), steps.data());
      if (from.z() >= 0 && from.z() < plain.size.z()) {
        ASSERT_EQ(std::max(0, int{steps[static_cast<std::size_t>(from.z())]}), std::max(0, plain.at(cell)));
      }
      ++cells;
      closed += plain.at(cell) == PlainStaticHeuristic::kClosed;
      detours += plain.cell_m * plain.at(cell) > (goal - inside).cwiseAbs().maxCoeff() + 2 * plain.cell_m;
    });
  }
  EXPECT_GT(closed, cells / 50);
  EXPECT_GT(detours, cells / 400);
}

TEST(StaticHeuristicTest, KnowsNothingOutsideItsWindow) {
  StaticHeuristic static_heuristic;
  Sogm standing = empty_map({3, 3, 3}, 0.1, 1, Utime(), 100ms);
  mark_box(&standing, {-0.3, -0.3, -0.3}, {0.3, 0.3, 0.3});
  static_heuristic.build({&standing}, kClearance_m, Vector3d(1.2, 0, 0), -1.5, 1.5);
  const auto steps = [&](const Vector3d& corner, int x, int y) {
    std::vector<std::int16_t> out(34, 7);
    static_heuristic.steps(corner, x, y - 1, 3, 10, 12, out.data());  // the column between two others
    EXPECT_EQ(out[10], 7);
    EXPECT_EQ(out[11], 7);
    return std::vector<std::int16_t>(out.begin() + 12, out.begin() + 22);
  };
  const std::vector<std::int16_t> none(10, -1), there = steps({-1.5, -1.5, -1.5}, 0, 0);
  EXPECT_GT(there[0], 0);
  EXPECT_EQ(steps({-1.5, -1.5, -1.5}, 10, 0), none);
  EXPECT_EQ(steps({-1.5, -1.5, -1.5}, 0, -1), none);
  EXPECT_EQ(steps({-1.5, -1.5, 1.5}, 0, 0), none);
  EXPECT_EQ(steps({-1.5, -1.5, -4.5}, 0, 0), none);
  const std::vector<std::int16_t> higher = steps({-1.5, -1.5, -0.9}, 0, 0);
  EXPECT_EQ(higher[0], there[2]);
  EXPECT_EQ(higher[7], there[9]);
  EXPECT_EQ(higher[8], -1);
}

TEST(StaticHeuristicTest, SaysNothingWhereNothingStands) {
  StaticHeuristic static_heuristic;
  const Sogm standing = empty_map({2, 2, 2}, 0.1, 1, Utime(), 100ms);
  static_heuristic.build({&standing}, kClearance_m, Vector3d::Zero(), -1, 1);
  EXPECT_TRUE(static_heuristic.empty());
  Sogm small = empty_map({0.1, 2, 2}, 0.1, 1, Utime(), 100ms);  // less than half a cell
  mark_box(&small, {-1, -1, -1}, {1, 1, 1});
  static_heuristic.build({&small}, kClearance_m, Vector3d::Zero(), -1, 1);
  EXPECT_TRUE(static_heuristic.empty());
}

}  // namespace
}  // namespace swarm
