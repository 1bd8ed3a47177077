// The space-time heuristic against a plain dynamic programme over the same cells.
#include "planner_daemon/search/space_time_heuristic.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "tests/support/random_map.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr int kTicks = 16, kFar = 30'000, kLongest = 15'000;  // per step; beside the window; of ways told apart
constexpr double kBlocked_m = 0.25;

// Times to the goal [ticks] of every cell at the start of every step, the whole window; only cells that `known` says
// are reached then may be passed.
class PlainSpaceTimeHeuristic {
 public:
  using Known = std::function<bool(int step, const Vector3i& cell)>;
  PlainSpaceTimeHeuristic(const Sogm& occupied, const StaticHeuristic* static_heuristic, double speed_mps,
                          const Vector3d& goal, double low_z, double high_z, int num_steps, const Known& known)
      : size(cells_in(occupied.geometry)) {
    const GridGeometry& grid = occupied.geometry;
    const double cell_m = kCellVoxels * grid.resolution_m, step_s = cell_m / speed_mps;
    const Vector3d corner = grid.origin.cast<double>() * grid.resolution_m;
    const auto middle = [&](const Vector3i& cell) {
      return Vector3d(corner + cell_m * (cell.cast<double>().array() + 0.5).matrix());
    };
    straight = table([&](const Vector3i& cell) {
      const double way_m = (goal - middle(cell)).cwiseAbs().maxCoeff();
      return std::min(kLongest, static_cast<int>(std::round(way_m / cell_m * kTicks)));
    });
    values.assign(static_cast<std::size_t>(num_steps) + 1, table([&](const Vector3i& cell) {
                    std::vector<std::int16_t> steps(static_cast<std::size_t>(size.z()), 0);
                    if (static_heuristic != nullptr)
                      static_heuristic->steps(corner, cell.x(), cell.y(), 1, size.z(), steps.size(), steps.data());
                    const int around = steps[static_cast<std::size_t>(cell.z())];
                    return num_steps * kTicks + std::min(kLongest, std::max(straight[index(cell)], kTicks * around));
                  }));
    const Vector3i goal_cell = ((goal - corner) / cell_m).array().floor().matrix().cast<int>();
    for (int step = num_steps - 1; step >= 0; --step) {
      const auto later = static_cast<std::size_t>(step) + 1;
      const int frame = occupied.frame_at(kStart + to_duration((step + 0.5) * step_s));
      values[later - 1] = table([&](const Vector3i& cell) {
        if (cell == goal_cell) return step * kTicks;  // an occupied goal is still where to go
        bool open = distance_to_occupied(occupied, frame, middle(cell), kBlocked_m + 0.01) > kBlocked_m + 1e-6;
        const double bottom = corner.z() + cell.z() * cell_m;
        open = open && bottom + cell_m > low_z && bottom < high_z;
        int least = kFar;
        for (int k = 0; k < 27; ++k) {
          const Vector3i next = cell + Vector3i(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
          if ((next.array() >= 0).all() && (next.array() < size.array()).all() && known(step + 1, next))
            least = std::min(least, values[later][index(next)]);
        }
        return std::min(kFar, least + (open ? 0 : SpaceTimeHeuristic::kClosedSteps * kTicks));
      });
    }
  }

  template <class Value>
  std::vector<int> table(const Value& value) const {
    std::vector<int> out(static_cast<std::size_t>(size.prod()));
    for (int x = 0; x < size.x(); ++x) {
      for (int y = 0; y < size.y(); ++y) {
        for (int z = 0; z < size.z(); ++z) out[index({x, y, z})] = value(Vector3i(x, y, z));
      }
    }
    return out;
  }
  std::size_t index(const Vector3i& cell) const {
    return static_cast<std::size_t>((cell.x() * size.y() + cell.y()) * size.z() + cell.z());
  }

  Vector3i size;
  std::vector<std::vector<int>> values;  // by step
  std::vector<int> straight;
};

TEST(SpaceTimeHeuristicTest, EqualsAPlainDynamicProgramme) {
  Rng rng(5);
  SpaceTimeHeuristic heuristic;
  int compared = 0, detours = 0, closed = 0, after_start = 0, unreached = 0, dead_ends = 0;
  for (int trial = 0; trial < 24; ++trial) {
    // Whole cells and rests; one word of voxels and several; steps shorter and longer than a frame.
    const Vector3d size_m =
        trial % 6 == 5 ? Vector3d(2.1, 1.9, trial % 12 == 5 ? 14.5 : 12.8) : Vector3d(5, 3.9 + 0.1 * (trial % 3), 2.1);
    const double speed_mps = std::array{2.0, 0.7, 6.3, 0.01}[static_cast<std::size_t>(trial % 4)];
    Sogm occupied = empty_map(size_m, 0.1, 8, kStart, 100ms);
    const Vector3d half = size_m / 2;
    for (int i = 0; i < 8; ++i)
      mark_moving(&occupied, in_box(rng, -half, half), in_cube(rng, 2.0), uniform(rng, 0.05, 0.35), i % 3 == 0);
    Sogm standing = empty_map(size_m, 0.1, 1, kStart, 100ms);
    if (trial % 2 == 0) mark_box(&standing, {0, -9, -9}, {0.3, uniform(rng, 0, 1), 99});
    const Vector3d goal = trial % 5 == 0 ? in_box(rng, -4 * half, 4 * half) : in_box(rng, -half, half);
    const double low_z = uniform(rng, -0.9, -0.5), high_z = uniform(rng, 0.4, 9);
    ReachableSet reach{in_box(rng, -half, half), kStart + Duration(uniform_int(rng, 0, 300'000)), speed_mps, 2.0};
    if (trial % 3 != 0) {
      reach.acceleration_mps2 = uniform(rng, 1.0, 5.0) * speed_mps;
      reach.velocity = in_cube(rng, speed_mps);
    }
    StaticHeuristic static_heuristic;
    const StaticHeuristic* guided = (static_heuristic.build({&standing}, kBlocked_m, goal, low_z, high_z),
                                     static_heuristic.empty() ? nullptr : &static_heuristic);
    heuristic.build({&occupied}, kBlocked_m, guided, reach, goal, {-99, -99, low_z}, {99, 99, high_z});
    const Vector3d corner = occupied.geometry.origin.cast<double>() * 0.1;
    const double cell_m = 0.1 * kCellVoxels, step_s = cell_m / speed_mps;
    const auto known = [&](int step, const Vector3i& cell) {
      const Vector3d inside = corner + cell_m * (cell.cast<double>().array() + 0.5).matrix();
      return heuristic.cell_of(step, 0, inside.x()) >= 0 && heuristic.cell_of(step, 1, inside.y()) >= 0;
    };
    EXPECT_GE(heuristic.num_steps() * step_s, 0.8 - 0.1 * step_s);
    const PlainSpaceTimeHeuristic plain(occupied, guided, speed_mps, goal, low_z, high_z, heuristic.num_steps(), known);
    const int first = heuristic.step_at(reach.utime);
    for (int step = first; step <= heuristic.num_steps(); ++step) {
      const auto at = kStart + to_duration(step * step_s);
      EXPECT_EQ(heuristic.step_at(at), step);
      (void)plain.table([&](const Vector3i& cell) {
        const Vector3d inside =
            corner + cell_m * (cell.cast<double>() + in_box(rng, {0.01, 0.01, 0.01}, {0.99, 0.99, 0.99}));
        const Vector3i found(heuristic.cell_of(step, 0, inside.x()), heuristic.cell_of(step, 1, inside.y()),
                             heuristic.cell_of(step, 2, inside.z()));
        const double s = std::max(0.0, to_seconds(at - reach.utime));
        const Interval x = extent(reach, 0, s, s), y = extent(reach, 1, s, s);
        const bool reached = occupied.geometry.contains(occupied.geometry.voxel_of(inside)) && inside.x() >= x.low &&
                             inside.x() <= x.high && inside.y() >= y.low && inside.y() <= y.high;
        unreached += !reached;
        if (found.minCoeff() < 0) {
          EXPECT_FALSE(reached) << "trial " << trial << " step " << step << " cell " << cell.transpose();
          return 0;
        }
        EXPECT_EQ(found, cell);
        const int value = plain.values[static_cast<std::size_t>(step)][plain.index(cell)];
        const int delay = std::max(0, value - step * kTicks - plain.straight[plain.index(cell)]);
        if (value >= kFar) {  // all that can follow lies beyond what is known
          EXPECT_EQ(heuristic.delay_s(step, cell.x(), cell.y(), cell.z()), 0.0);
          ++dead_ends;
          return 0;
        }
        EXPECT_NEAR(heuristic.delay_s(step, cell.x(), cell.y(), cell.z()), delay * step_s / kTicks, 1e-9 * step_s)
            << "trial " << trial << " step " << step << " cell " << cell.transpose();
        ++compared;
        detours += delay > 0 && delay < 16 * kTicks;
        closed += delay >= SpaceTimeHeuristic::kClosedSteps * kTicks;
        after_start += step > first;
        return 0;
      });
      ASSERT_FALSE(HasFailure());
    }
  }
  EXPECT_GT(compared, 20'000);
  EXPECT_GT(unreached, compared / 2);
  EXPECT_LT(dead_ends, compared / 100);
  EXPECT_GT(after_start, compared / 2);
  EXPECT_GT(detours, compared / 20);
  EXPECT_GT(closed, compared / 50);
}

// A wall with a door that opens after 0.8 s: waiting there is what it costs.
TEST(SpaceTimeHeuristicTest, KnowsHowLongADoorStaysShut) {
  Sogm occupied = empty_map({8, 4, 2}, 0.1, 20, kStart, 100ms);
  mark_box(&occupied, {0.2, -9, -9}, {0.4, 9, 9}, 0, 7);
  mark_box(&occupied, {0.2, -9, -9}, {0.4, -0.5, 9}, 8);
  mark_box(&occupied, {0.2, 0.5, -9}, {0.4, 9, 9}, 8);
  SpaceTimeHeuristic heuristic;
  heuristic.build({&occupied}, kBlocked_m, nullptr, {{-0.5, 0, 0}, kStart, 2.0, 2.0}, {6, 0, 0}, {-99, -99, -1},
                  {99, 99, 1});
  const auto delay_s = [&](double since_s, double x, double y) {
    const int step = heuristic.step_at(kStart + to_duration(since_s));
    return heuristic.delay_s(step, heuristic.cell_of(step, 0, x), heuristic.cell_of(step, 1, y),
                             heuristic.cell_of(step, 2, 0.05));
  };
  // Cells and steps know it to within one of each.
  EXPECT_NEAR(delay_s(0.0, -0.15, 0.1), 0.65, 0.16);  // in front of it: 0.8 s
  EXPECT_NEAR(delay_s(0.0, -0.75, 0.1), 0.38, 0.16);  // the way there takes part of the time
  EXPECT_NEAR(delay_s(0.9, -0.15, 0.1), 0.0, 0.01);   // open
  EXPECT_NEAR(delay_s(0.9, -0.15, -1.1), 0.4, 0.2);   // beside it
  EXPECT_EQ(delay_s(0.9, 1.1, 0.1), 0.0);             // behind it
  EXPECT_EQ(heuristic.delay_s(0, -1, 3, 3), 0.0);
  EXPECT_EQ(heuristic.cell_of(0, 0, 3.9), -1);  // not reached so soon
}

// The rest of the window beyond the last whole cell belongs to that cell.
TEST(SpaceTimeHeuristicTest, KnowsTheWholeWindow) {
  const Sogm occupied = empty_map({2.2, 2.3, 2.1}, 0.1, 8, kStart, 100ms);
  SpaceTimeHeuristic heuristic;
  heuristic.build({&occupied}, kBlocked_m, nullptr, {{0, 0, 0}, kStart, 2.0, 2.0}, {0, 0, 0}, {-99, -99, -9},
                  {99, 99, 9});
  const int last = heuristic.num_steps();
  for (int axis = 0; axis < 3; ++axis) {
    const GridGeometry& grid = occupied.geometry;
    const double low = 0.1 * grid.origin[axis], high = low + 0.1 * grid.size[axis];
    EXPECT_EQ(heuristic.cell_of(last, axis, low + 0.01), 0);
    EXPECT_EQ(heuristic.cell_of(last, axis, high - 0.01), cells_in(grid)[axis] - 1);
    EXPECT_EQ(heuristic.cell_of(last, axis, low - 0.01), -1);
    EXPECT_EQ(heuristic.cell_of(last, axis, high + 0.01), -1);
  }
}

// Ways too long to be told apart: no cell is nearer to the goal than another, so that only time passes.
TEST(SpaceTimeHeuristicTest, FarGoalsAreFarEverywhere) {
  const Sogm occupied = empty_map({5, 5, 2}, 0.1, 8, kStart, 100ms);
  Sogm standing = empty_map({5, 5, 2}, 0.1, 1, kStart, 100ms);
  mark_box(&standing, {0, -9, -9}, {0.3, 1, 9});
  for (const double far_m : {400.0, 3e4}) {
    const Vector3d goal(far_m, 1.0, 0.0);
    StaticHeuristic static_heuristic;
    static_heuristic.build({&standing}, kBlocked_m, goal, -1, 1);
    std::vector<std::int16_t> steps(6);
    static_heuristic.steps({-2.5, -2.5, -1.0}, 1, 8, 1, 6, 6,
                           steps.data());  // one behind the rim, reached a step later
    EXPECT_EQ(steps[2], 900);
    SpaceTimeHeuristic heuristic;
    heuristic.build({&occupied}, kBlocked_m, &static_heuristic, {{0, 0, 0}, kStart, 2.0, 2.0}, goal, {-99, -99, -1},
                    {99, 99, 1});
    for (int step = 0; step <= heuristic.num_steps(); ++step) {
      const int x = heuristic.cell_of(step, 0, -0.01), y = heuristic.cell_of(step, 1, -0.01);
      ASSERT_GE(std::min(x, y), 0);
      EXPECT_NEAR(heuristic.delay_s(step, x, y, 2), 0.15 * (heuristic.num_steps() - step), 1e-9)
          << "step " << step << ", goal " << far_m << " m away";
    }
  }
}

}  // namespace
}  // namespace swarm
