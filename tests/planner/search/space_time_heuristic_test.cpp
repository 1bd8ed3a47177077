// The space-time heuristic against a plain dynamic programme over the same cells.
#include "planner_daemon/search/space_time_heuristic.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <vector>

#include "tests/support/plain_static_heuristic.h"
#include "tests/support/random_map.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr int kTicks = 16, kFar = 30'000, kLongest = 27'000;  // per step; no way is known; of ways told apart
constexpr double kBlocked_m = 0.25;

struct SpaceTimeScene {
  Sogm occupied, standing;  // whose window has been elsewhere
  double speed_mps = 2.0;
  Vector3d goal;
  double low_z, high_z;
  ReachableSet reach;
};

// Times to the goal [ticks] of every cell at the start of every step, the whole window; only cells that `known` says
// are reached then may be passed. `ways`: around what stands still; null: there is nothing, or it knows no way.
class PlainSpaceTimeHeuristic {
 public:
  using Known = std::function<bool(int step, const Vector3i& cell)>;
  PlainSpaceTimeHeuristic(const SpaceTimeScene& scene, const PlainStaticHeuristic* ways,
                          const std::optional<StaticHeuristic::Subgoal>& subgoal, int num_steps, const Known& known)
      : size(cells_in(scene.occupied.geometry)) {
    const GridGeometry& grid = scene.occupied.geometry;
    const double cell_m = kCellVoxels * grid.resolution_m, step_s = cell_m / scene.speed_mps;
    const Vector3d corner = grid.origin.cast<double>() * grid.resolution_m;
    const auto middle = [&](const Vector3i& cell) {
      return Vector3d(corner + cell_m * (cell.cast<double>().array() + 0.5).matrix());
    };
    const Vector3d target = subgoal ? subgoal->position : scene.goal;
    const int rest = subgoal ? subgoal->cost * kTicks / (kCellVoxels * Wavefront::kStraight) : 0;
    straight = table([&](const Vector3i& cell) {
      const double way_m = (target - middle(cell)).cwiseAbs().maxCoeff();
      return rest + std::min(kLongest, static_cast<int>(std::round(way_m / cell_m * kTicks)));
    });
    const std::vector<int> around = table([&](const Vector3i& cell) {
      return ways != nullptr ? ways->ticks(grid.origin, cell, kTicks, kFar) : straight[index(cell)];
    });
    values.assign(static_cast<std::size_t>(num_steps) + 1, table([&](const Vector3i& cell) {
                    return std::min(kFar, num_steps * kTicks + around[index(cell)]);
                  }));
    const Vector3i goal_cell = ((scene.goal - corner) / cell_m).array().floor().matrix().cast<int>();
    for (int step = num_steps - 1; step >= 0; --step) {
      const auto later = static_cast<std::size_t>(step) + 1;
      const int frame = scene.occupied.frame_at(kStart + to_duration((step + 0.5) * step_s));
      values[later - 1] = table([&](const Vector3i& cell) {
        if (cell == goal_cell) return step * kTicks;  // an occupied goal is still where to go
        const double bottom = corner.z() + cell.z() * cell_m;
        const bool is_inside = bottom + cell_m > scene.low_z && bottom < scene.high_z;
        const bool is_side = cell.x() == 0 || cell.y() == 0 || cell.x() == size.x() - 1 || cell.y() == size.y() - 1;
        const int least_way = std::min(kFar, around[index(cell)] + step * kTicks);
        int value = kFar;
        if (is_side) {  // from there it goes on as if nothing moved
          value = least_way;
        } else {
          for (int k = 0; k < 27; ++k) {
            const Vector3i next = cell + Vector3i(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
            if ((next.array() >= 0).all() && (next.array() < size.array()).all() && known(step + 1, next))
              value = std::min(value, values[later][index(next)]);
          }
          if (!is_inside) value += kPenalty;
          value = std::max(value, least_way);
        }
        const Vector3i voxel = (kCellVoxels * cell).array() + kCellVoxels / 2;
        const bool stands = ways != nullptr && ways->is_too_close(voxel + grid.origin - ways->grid.origin);
        if (is_inside && !stands &&
            distance_to_occupied(scene.occupied, frame, middle(cell), kBlocked_m + 0.01) < kBlocked_m + 1e-6)
          value += kPenalty;
        return std::min(kFar, value);
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

  static constexpr int kPenalty = SpaceTimeHeuristic::kClosedSteps * kTicks;
  Vector3i size;
  std::vector<std::vector<int>> values;  // by step
  std::vector<int> straight;
};

struct Comparisons {
  int compared = 0, detours = 0, closed = 0, after_start = 0, unreached = 0, without_way = 0, ahead = 0, subgoals = 0,
      with_ways = 0;
};

void compare_all(const SpaceTimeScene& scene, bool is_guided, SpaceTimeHeuristic* heuristic, Rng& rng,
                 Comparisons* sum) {
  StaticHeuristic around;
  const Eigen::AlignedBox3d space(Vector3d(-99, -99, scene.low_z), Vector3d(99, 99, scene.high_z));
  around.build({&scene.standing}, kBlocked_m, scene.goal, space, nullptr);
  const PlainStaticHeuristic plain_around(scene.standing, kBlocked_m, scene.goal, space, nullptr);
  const StaticHeuristic* guided = is_guided ? &around : nullptr;
  const bool has_ways = is_guided && !around.empty() && !around.is_cut_off();
  const auto subgoal = has_ways ? around.subgoal(scene.reach.center) : std::nullopt;
  heuristic->build({&scene.occupied}, kBlocked_m, guided, scene.reach, scene.goal, {-99, -99, scene.low_z},
                   {99, 99, scene.high_z});
  const GridGeometry& grid = scene.occupied.geometry;
  const Vector3d corner = grid.origin.cast<double>() * 0.1;
  const double cell_m = 0.1 * kCellVoxels, step_s = cell_m / scene.speed_mps;
  const auto known = [&](int step, const Vector3i& cell) {
    const Vector3d inside = corner + cell_m * (cell.cast<double>().array() + 0.5).matrix();
    return heuristic->cell_of(step, 0, inside.x()) >= 0 && heuristic->cell_of(step, 1, inside.y()) >= 0;
  };
  sum->subgoals += subgoal.has_value();
  sum->with_ways += has_ways;
  ASSERT_EQ(heuristic->target(), subgoal ? subgoal->position : scene.goal);
  if (subgoal) {
    ASSERT_NEAR(heuristic->rest_s(), subgoal->cost / 30.0 * step_s, step_s / kTicks);
  } else {
    ASSERT_EQ(heuristic->rest_s(), 0.0);
  }
  const PlainSpaceTimeHeuristic plain(scene, has_ways ? &plain_around : nullptr, subgoal, heuristic->num_steps(),
                                      known);
  const int first = heuristic->step_at(scene.reach.utime);
  for (int step = first; step <= heuristic->num_steps(); ++step) {
    const auto at = kStart + to_duration(step * step_s);
    ASSERT_EQ(heuristic->step_at(at), step);
    (void)plain.table([&](const Vector3i& cell) {
      if (testing::Test::HasFailure()) return 0;
      const Vector3d inside =
          corner + cell_m * (cell.cast<double>() + in_box(rng, {0.01, 0.01, 0.01}, {0.99, 0.99, 0.99}));
      const Vector3i found(heuristic->cell_of(step, 0, inside.x()), heuristic->cell_of(step, 1, inside.y()),
                           heuristic->cell_of(step, 2, inside.z()));
      const double s = std::max(0.0, to_seconds(at - scene.reach.utime));
      const Interval x = extent(scene.reach, 0, s, s), y = extent(scene.reach, 1, s, s);
      const bool reached = grid.contains(grid.voxel_of(inside)) && inside.x() >= x.low && inside.x() <= x.high &&
                           inside.y() >= y.low && inside.y() <= y.high;
      sum->unreached += !reached;
      if (found.minCoeff() < 0) {
        EXPECT_FALSE(reached) << "step " << step << " cell " << cell.transpose();
        return 0;
      }
      EXPECT_EQ(found, cell);
      const int value = plain.values[static_cast<std::size_t>(step)][plain.index(cell)];
      const int delay = value - step * kTicks - plain.straight[plain.index(cell)];
      const double delay_s = value < kFar ? delay * step_s / kTicks : SpaceTimeHeuristic::kNoWay_s;
      EXPECT_NEAR(heuristic->delay_s(step, cell.x(), cell.y(), cell.z()), delay_s, 1e-9 * step_s + 1e-12)
          << "step " << step << " of " << heuristic->num_steps() << ", cell " << cell.transpose();
      ++sum->compared;
      sum->after_start += step > first;
      sum->without_way += value >= kFar;
      if (value >= kFar) return 0;
      sum->ahead += delay < 0;
      sum->detours += delay > 0 && delay < 16 * kTicks;
      sum->closed += delay >= PlainSpaceTimeHeuristic::kPenalty;
      return 0;
    });
    ASSERT_FALSE(testing::Test::HasFailure());
  }
}

// Things that move, and things that stand still, which the static heuristic was told of when its window was elsewhere.
SpaceTimeScene random_space_time_scene(const Vector3d& size_m, double speed_mps, int trial, Rng& rng) {
  SpaceTimeScene scene;
  scene.speed_mps = speed_mps;
  scene.occupied = empty_map(size_m, 0.1, 8, kStart, 100ms);
  scene.standing = empty_map(size_m, 0.1, 1, kStart, 100ms);
  if (trial % 3 != 0)
    scene.standing.geometry.origin +=
        Vector3i(uniform_int(rng, -4, 4), uniform_int(rng, -4, 4), uniform_int(rng, -1, 1));
  const Vector3d half = size_m / 2;
  for (int i = 0; i < 8; ++i)
    mark_moving(&scene.occupied, in_box(rng, -half, half), in_cube(rng, 2.0), uniform(rng, 0.05, 0.35), i % 3 == 0);
  for (int i = 0; i < 5 * (trial % 2); ++i) {
    Vector3d place = in_box(rng, -half, half);
    if (place.head<2>().norm() < 0.6) place.y() = 0.6;  // the robot, in the middle, is not enclosed
    mark_moving(&scene.occupied, place, Vector3d::Zero(), 0.25, true);
    mark_moving(&scene.standing, place, Vector3d::Zero(), 0.25, true);
  }
  const double end = uniform(rng, 0.5, 1);
  for (Sogm* sogm : {&scene.occupied, &scene.standing}) {
    if (trial % 4 != 0) mark_box(sogm, {0.6, -1.2, -9}, {0.8, end, 99});
    if (trial % 4 == 2) mark_box(sogm, {-0.4, end, -9}, {0.8, end + 0.2, 99});
    if (trial % 4 == 2) mark_box(sogm, {-0.4, -1.2, -9}, {0.8, -1.0, 99});
  }
  scene.goal = trial % 5 == 0 ? in_box(rng, -4 * half, 4 * half) : in_box(rng, -half, half);
  if (trial % 4 == 2) scene.goal = {uniform(rng, 1.3, 2.2), uniform(rng, -0.5, 0.5), 0.1};
  scene.low_z = uniform(rng, -0.9, -0.5);
  scene.high_z = uniform(rng, 0.4, trial % 2 == 0 ? 0.8 : 9);
  scene.reach = {in_box(rng, -half, half), kStart + Duration(uniform_int(rng, 0, 300'000)), speed_mps, 2.0};
  if (trial % 4 == 2) scene.reach.center = {uniform(rng, -0.1, 0.2), uniform(rng, -0.4, 0.1), 0.1};
  return scene;
}

TEST(SpaceTimeHeuristicTest, EqualsAPlainDynamicProgramme) {
  Rng rng(5);
  SpaceTimeHeuristic heuristic;
  Comparisons sum;
  for (int trial = 0; trial < 24; ++trial) {
    // Whole cells and rests; one word of voxels and several; steps shorter and longer than a frame.
    const Vector3d size_m =
        trial % 6 == 5 ? Vector3d(2.1, 1.9, trial % 12 == 5 ? 14.5 : 12.8) : Vector3d(5, 3.9 + 0.1 * (trial % 3), 2.1);
    const double speed_mps = std::array{2.0, 0.7, 6.3, 0.01, 2.0}[static_cast<std::size_t>(trial % 5)];
    SpaceTimeScene scene = random_space_time_scene(size_m, speed_mps, trial, rng);
    if (trial % 3 != 0) {  // it turns soon enough to come to each place again
      scene.reach.acceleration_mps2 = uniform(rng, 3.0, 6.0) * speed_mps;
      scene.reach.velocity = in_cube(rng, speed_mps);
    }
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", goal " << scene.goal.transpose());
    ASSERT_NO_FATAL_FAILURE(compare_all(scene, trial % 7 != 6, &heuristic, rng, &sum));
    EXPECT_GE(heuristic.num_steps() * 0.3 / speed_mps, 0.8 - 0.03 / speed_mps);
  }
  EXPECT_GT(sum.compared, 20'000);
  EXPECT_GT(sum.unreached, sum.compared / 2);
  EXPECT_GT(sum.without_way, sum.compared / 100);
  EXPECT_LT(sum.without_way, sum.compared / 2);
  EXPECT_GT(sum.after_start, sum.compared / 2);
  EXPECT_GT(sum.detours, sum.compared / 20);
  EXPECT_GT(sum.closed, sum.compared / 100);
  EXPECT_GT(sum.ahead, sum.compared / 100);
  EXPECT_GT(sum.subgoals, 2);
  EXPECT_GT(sum.with_ways, 8);
  EXPECT_LT(sum.with_ways, 22);
}

// A robot that hardly turns leaves where it is now behind: those places are not among those it comes to in the end.
TEST(SpaceTimeHeuristicTest, KnowsTheWaysFromPlacesThatAreLeftBehind) {
  Rng rng(6);
  SpaceTimeHeuristic heuristic;
  Comparisons sum;
  for (int trial = 0; trial < 6; ++trial) {
    SpaceTimeScene scene = random_space_time_scene({5, 3.9, 2.1}, 2.0, trial, rng);
    scene.reach.center = {-1.5, 0.1, 0.1};
    scene.reach.acceleration_mps2 = 1.0;
    scene.reach.velocity = {2.0, 0, 0};
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", goal " << scene.goal.transpose());
    ASSERT_NO_FATAL_FAILURE(compare_all(scene, true, &heuristic, rng, &sum));
  }
  EXPECT_GT(sum.compared, 2'000);
}

// However fast the robot: there are never more steps than fit the memory, and values do not overflow.
TEST(SpaceTimeHeuristicTest, KnowsTheWaysOfFastRobots) {
  Rng rng(7);
  SpaceTimeHeuristic heuristic;
  Comparisons sum;
  for (int trial = 0; trial < 4; ++trial) {
    SpaceTimeScene scene = random_space_time_scene({2.1, 2.1, 1.4}, 150.0, 2 * trial, rng);
    mark_box(&scene.standing, {-1.0, 0.5, -9}, {-0.4, 1.0, 9});  // no way from inside it
    scene.reach.utime = kStart + 300ms;
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", goal " << scene.goal.transpose());
    ASSERT_NO_FATAL_FAILURE(compare_all(scene, true, &heuristic, rng, &sum));
    EXPECT_LE(heuristic.num_steps(), 200);
  }
  EXPECT_GT(sum.without_way, 100);
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

// Ways too long to be told apart: no cell is nearer to the goal than another.
TEST(SpaceTimeHeuristicTest, FarGoalsAreFarEverywhere) {
  const Sogm occupied = empty_map({5, 5, 2}, 0.1, 8, kStart, 100ms);
  Sogm standing = empty_map({5, 5, 2}, 0.1, 1, kStart, 100ms);
  mark_box(&standing, {0, -9, -9}, {0.3, 1, 9});
  for (const double far_m : {600.0, 1000.0, 3e4, 1e30}) {
    const Vector3d goal(far_m, 1.0, 0.0);
    StaticHeuristic static_heuristic;
    static_heuristic.build({&standing}, kBlocked_m, goal, {Vector3d(-99, -99, -0.84), Vector3d(99, 99, 0.84)}, nullptr);
    SpaceTimeHeuristic heuristic;
    heuristic.build({&occupied}, kBlocked_m, &static_heuristic, {{0, 0, 0}, kStart, 2.0, 2.0}, goal, {-99, -99, -1},
                    {99, 99, 1});
    for (int step = 0; step <= heuristic.num_steps(); ++step) {
      const int x = heuristic.cell_of(step, 0, -0.01), y = heuristic.cell_of(step, 1, -0.01);
      ASSERT_GE(std::min(x, y), 0);
      for (const int beside : {-1, 0, 1}) {
        const double delay_s = heuristic.delay_s(step, x + beside, y - beside, 2);
        EXPECT_EQ(delay_s, heuristic.delay_s(step, x, y, 2)) << "step " << step << ", goal " << far_m << " m away";
        EXPECT_GE(delay_s, 0.0);
        EXPECT_LE(delay_s, SpaceTimeHeuristic::kNoWay_s);
      }
    }
  }
}

}  // namespace
}  // namespace swarm
