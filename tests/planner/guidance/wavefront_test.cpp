// The wavefront against a plain Dijkstra search over the same voxels.
#include "planner_daemon/guidance/wavefront.h"

#include <gtest/gtest.h>

#include <limits>
#include <span>
#include <string>
#include <vector>

#include "tests/support/plain_ways.h"
#include "tests/support/random_map.h"

namespace swarm {
namespace {

using Eigen::Vector3i;

constexpr std::int64_t kAll = std::numeric_limits<std::int64_t>::max();
constexpr int kHeights[] = {1, 40, 64, 70, 130};  // one word, a whole one, and several

PlainWays random_voxels(const Vector3i& size, double density, Rng& rng) {
  PlainWays ways(size);
  std::bernoulli_distribution closed(density);
  for (std::size_t i = 0; i < ways.open.size(); ++i) ways.open[i] = !closed(rng);
  return ways;
}

Vector3i random_size(int height, Rng& rng) {
  return {uniform_int(rng, 4, 13), uniform_int(rng, 4, 13), height};
}

Vector3i random_voxel(const Vector3i& size, Rng& rng) {
  return {uniform_int(rng, 0, size.x() - 1), uniform_int(rng, 0, size.y() - 1), uniform_int(rng, 0, size.z() - 1)};
}

void lay_out(const PlainWays& ways, int cell, Wavefront* front) {
  front->lay_out(ways.size, cell);
  ASSERT_EQ(front->words_per_column(), (ways.size.z() + 63) / 64);
  ways.for_each_voxel([&](const Vector3i& v) {
    if (ways.is_open(v)) front->open(v.x(), v.y())[v.z() / 64] |= std::uint64_t{1} << v.z() % 64;
  });
}

void seed(const Vector3i& v, int cost, Wavefront* front) {
  front->seed(v.x(), v.y(), v.z() / 64, std::uint64_t{1} << v.z() % 64, cost);
}

template <class Visit>
void for_each_cell(const PlainWays& ways, int cell, const Visit& visit) {
  PlainWays((ways.size.array() + cell - 1) / cell).for_each_voxel(visit);
}

// How many cells are reached.
int expect_equal(const Wavefront& front, const PlainWays& ways, int cell) {
  int reached = 0, wrong = 0;
  EXPECT_EQ(front.cells(), Vector3i((ways.size.array() + cell - 1) / cell));
  for_each_cell(ways, cell, [&](const Vector3i& at) {
    const int expected = ways.cell_cost(at, cell);
    reached += expected != PlainWays::kNone;
    EXPECT_EQ(front.column(at.x(), at.y())[at.z()], front.cost(at));
    if (front.cost(at) != expected && ++wrong <= 3) {
      ADD_FAILURE() << "cell " << at.transpose() << " of " << cell << " voxels: " << front.cost(at) << ", not "
                    << expected;
    }
  });
  EXPECT_EQ(wrong, 0);
  return reached;
}

TEST(WavefrontTest, EqualsAPlainDijkstraSearch) {
  Rng rng(1);
  Wavefront front;
  int reached = 0, unreached = 0;
  for (const int height : kHeights) {
    for (const int cell : {1, 2, 3}) {
      for (const double density : {0.3, 0.6, 0.85}) {
        PlainWays ways = random_voxels(random_size(height, rng), density, rng);
        SCOPED_TRACE(testing::Message() << ways.size.transpose() << " voxels, cells of " << cell << ", density "
                                        << density);
        lay_out(ways, cell, &front);
        for (int i = 0; i < 3; ++i) {  // some of them lose, or are closed
          const Vector3i v = random_voxel(ways.size, rng);
          const int cost = uniform_int(rng, 0, 60);
          seed(v, cost, &front);
          ways.seed(v, cost);
        }
        ASSERT_TRUE(front.advance(kAll));
        ways.search();
        const int count = expect_equal(front, ways, cell);
        reached += count;
        unreached += front.cells().prod() - count;
        ASSERT_FALSE(HasFailure());
      }
    }
  }
  EXPECT_GT(reached, 20'000);
  EXPECT_GT(unreached, 3'000);
}

TEST(WavefrontTest, WithNothingAroundWaysAreStraight) {
  Rng rng(2);
  Wavefront front;
  for (const int height : kHeights) {
    PlainWays ways(random_size(height, rng));
    ways.open.assign(ways.open.size(), true);
    const Vector3i goal = random_voxel(ways.size, rng);
    lay_out(ways, 1, &front);
    front.seed_goal(goal, 0.0);
    ASSERT_TRUE(front.advance(kAll));
    ways.seed(goal, 0);
    ways.search();
    expect_equal(front, ways, 1);
    int longer = 0;
    ways.for_each_voxel([&](const Vector3i& v) { longer += ways.cost(v) != Wavefront::straight_cost(v - goal); });
    EXPECT_EQ(longer, 0) << "height " << height;
  }
}

TEST(WavefrontTest, InSmallPortionsItIsTheSame) {
  Rng rng(3);
  Wavefront at_once, bit_by_bit;
  for (const int height : kHeights) {
    PlainWays ways = random_voxels(random_size(height, rng), 0.5, rng);
    lay_out(ways, 2, &at_once);
    lay_out(ways, 2, &bit_by_bit);
    for (int i = 0; i < 6; ++i) {
      const Vector3i v = random_voxel(ways.size, rng);
      const int cost = 500 * i;  // the later ones long after the front of the earlier ones has come to rest
      seed(v, cost, &at_once);
      seed(v, cost, &bit_by_bit);
      ways.seed(v, cost);
    }
    ASSERT_TRUE(at_once.advance(kAll));
    int portions = 1;
    while (!bit_by_bit.advance(1 + portions % 3)) ASSERT_LT(++portions, 100'000);
    EXPECT_GT(portions, height == 1 ? 0 : 10);
    EXPECT_TRUE(bit_by_bit.advance(1) || bit_by_bit.advance(kAll));  // nothing is left to do
    ways.search();
    expect_equal(at_once, ways, 2);
    expect_equal(bit_by_bit, ways, 2);
    ASSERT_FALSE(HasFailure()) << "height " << height;
  }
}

// In at the outermost voxels, each at a cost of its own; columns alike in part, as those of a window are.
TEST(WavefrontTest, ComesInFromTheEdge) {
  Rng rng(4);
  Wavefront front;
  for (const int height : {1, 2, 40, 64, 65, 70, 128, 130}) {
    for (const double density : {0.0, 0.4, 0.7}) {
      PlainWays ways = random_voxels(random_size(height, rng), density, rng);
      SCOPED_TRACE(testing::Message() << ways.size.transpose() << " voxels, density " << density);
      const Vector3i goal = random_voxel(ways.size, rng) * 5;
      std::vector<int> costs(ways.open.size());
      ways.for_each_voxel([&](const Vector3i& v) {
        int& cost = costs[ways.index(v)] = Wavefront::straight_cost(v - goal);
        if (uniform_int(rng, 0, 3) == 0) cost += uniform_int(rng, 0, 40);
        if (uniform_int(rng, 0, 3) == 0) cost = uniform_int(rng, 0, 1) == 0 ? PlainWays::kNone : 90'000;
      });
      const auto cost_of = [&](const Vector3i& v) { return costs[ways.index(v)]; };
      lay_out(ways, 1, &front);
      std::vector<int> column(static_cast<std::size_t>(ways.size.z()));
      const auto costs_of = [&](int x, int y) {
        for (int z = 0; z < ways.size.z(); ++z) column[static_cast<std::size_t>(z)] = cost_of({x, y, z});
        return std::span<const int>(column);
      };
      front.seed_edge(costs_of, [&](int x, int y, int z) { return cost_of({x, y, z}); });
      ways.seed_edge(cost_of);
      ASSERT_TRUE(front.advance(kAll));
      ways.search();
      EXPECT_GT(expect_equal(front, ways, 1), 0);
    }
  }
}

// A goal inside a wall is reached where the wall's open voxels are the nearest to it; too deep in it, nowhere.
TEST(WavefrontTest, AGoalThatIsClosedIsReachedBesideIt) {
  Rng rng(5);
  Wavefront front;
  int beside = 0, nowhere = 0;
  for (const int height : kHeights) {
    for (int trial = 0; trial < 12; ++trial) {
      PlainWays ways = random_voxels(random_size(height, rng), 0.2, rng);
      const Vector3i goal =
          random_voxel(ways.size, rng) + Vector3i(uniform_int(rng, -3, 3), 0, uniform_int(rng, -3, 3));
      const int wall = uniform_int(rng, 0, 5);
      ways.for_each_voxel([&](const Vector3i& v) {
        if ((v - goal).squaredNorm() < wall * wall) ways.open[ways.index(v)] = false;
      });
      const double reach = trial % 2 == 0 ? 3.0 : uniform(rng, 0, 6);
      SCOPED_TRACE(testing::Message() << ways.size.transpose() << " voxels, goal " << goal.transpose() << ", wall "
                                      << wall << ", reach " << reach);
      lay_out(ways, 1, &front);
      front.seed_goal(goal, reach);
      ways.seed_goal(goal, reach);
      ASSERT_TRUE(front.advance(kAll));
      ways.search();
      const int reached = expect_equal(front, ways, 1);
      ASSERT_FALSE(HasFailure());
      nowhere += reached == 0;
      beside += reached != 0 && !ways.is_open(goal);
    }
  }
  EXPECT_GT(beside, 10);
  EXPECT_GT(nowhere, 10);
}

// What costs more than can be told is not reached.
TEST(WavefrontTest, EndsWhereCostsDo) {
  Wavefront front;
  PlainWays ways({200, 1, 3});
  ways.open.assign(ways.open.size(), true);
  lay_out(ways, 1, &front);
  seed({0, 0, 0}, PlainWays::kNone - 601, &front);
  ways.seed({0, 0, 0}, PlainWays::kNone - 601);
  seed({199, 0, 0}, PlainWays::kNone, &front);
  ASSERT_TRUE(front.advance(kAll));
  ways.search();
  EXPECT_EQ(expect_equal(front, ways, 1), 3 * 61);
}

}  // namespace
}  // namespace swarm
