// Cost to go against a plain dynamic programme over the same cells.
#include "planner_daemon/cost_to_go.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "tests/random_map.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr std::int64_t kStart = 1'700'000'000'000'000;
constexpr int kTicks = 16, kFar = 30'000, kLongest = 15'000;  // per frame; beside the window; of ways told apart

// Times to the goal [ticks] of every cell at the start of every frame, the whole window; only cells that `known` says
// are reached then may be passed.
class PlainCostToGo {
 public:
  using Known = std::function<bool(int frame, const Vector3i& cell)>;
  PlainCostToGo(const Sogm& blocked, const Guidance* guidance, double speed_mps, const Vector3d& goal, double low_z,
                double high_z, const Known& known)
      : size((blocked.geometry.size + Vector3i::Ones()) / 2) {
    const GridGeometry& grid = blocked.geometry;
    const double cell_m = 2 * grid.resolution_m, frame_s = 1e-6 * static_cast<double>(blocked.frame_duration_us);
    const Vector3d corner = grid.origin.cast<double>() * grid.resolution_m;
    std::vector<int> later = table([&](const Vector3i& cell) {
      const Vector3d way_m = (goal - corner - cell_m * (cell.cast<double>().array() + 0.5).matrix()).cwiseAbs();
      const double ticks_per_m = kTicks / (frame_s * speed_mps);
      const int straight_ticks = static_cast<int>(std::round(way_m.maxCoeff() * ticks_per_m));
      std::vector<std::int16_t> steps(static_cast<std::size_t>(size.z()), 0);
      if (guidance != nullptr) guidance->steps(corner, cell.x(), cell.y(), size.z(), steps.data());
      const double guided_m = cell_m * std::max(0, int{steps[static_cast<std::size_t>(cell.z())]});
      return std::min(kLongest, std::max(straight_ticks, static_cast<int>(std::floor(guided_m * ticks_per_m + 0.5))));
    });
    straight = table([&](const Vector3i& cell) {
      const Vector3d way_m = (goal - corner - cell_m * (cell.cast<double>().array() + 0.5).matrix()).cwiseAbs();
      return std::min(kLongest, static_cast<int>(std::round(way_m.maxCoeff() * kTicks / (frame_s * speed_mps))));
    });
    values.assign(static_cast<std::size_t>(blocked.num_frames) + 1, later);
    const Vector3i goal_cell = ((goal - corner) / cell_m).array().floor().matrix().cast<int>();
    const double moves_per_frame = speed_mps * frame_s / cell_m;
    for (int frame = blocked.num_frames - 1; frame >= 0; --frame) {
      const int moves = static_cast<int>(std::floor((frame + 1) * moves_per_frame + 0.5)) -
                        static_cast<int>(std::floor(frame * moves_per_frame + 0.5));
      later = table([&](const Vector3i& cell) {
        bool open = false;
        for (int k = 0; k < 8; ++k) {
          const Vector3i voxel = 2 * cell + Vector3i(k & 1, k >> 1 & 1, k >> 2);
          open = open || (grid.contains(voxel) && !blocked.occupied(frame, voxel));
        }
        if (cell == goal_cell) return 0;  // an occupied goal is still where to go
        const double bottom = corner.z() + cell.z() * cell_m;
        open = open && bottom + cell_m > low_z && bottom < high_z;
        int least = kFar;
        for (int x = std::max(0, cell.x() - moves); x <= std::min(size.x() - 1, cell.x() + moves); ++x) {
          for (int y = std::max(0, cell.y() - moves); y <= std::min(size.y() - 1, cell.y() + moves); ++y) {
            if (!known(frame + 1, {x, y, cell.z()})) continue;
            for (int z = std::max(0, cell.z() - moves); z <= std::min(size.z() - 1, cell.z() + moves); ++z)
              least = std::min(least, values[static_cast<std::size_t>(frame) + 1][index({x, y, z})]);
          }
        }
        return std::min(kFar, least + kTicks + (open ? 0 : CostToGo::kClosedFrames * kTicks));
      });
      values[static_cast<std::size_t>(frame)] = later;
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
  std::vector<std::vector<int>> values;  // by frame
  std::vector<int> straight;
};

TEST(CostToGoTest, EqualsAPlainDynamicProgramme) {
  Rng rng(5);
  CostToGo cost_to_go;
  int compared = 0, detours = 0, closed = 0, after_start = 0, unreached = 0, dead_ends = 0;
  for (int trial = 0; trial < 24; ++trial) {
    // Even and odd sizes; one and two words of cells; frames of no, one or several cells' way.
    const Vector3d size_m =
        trial % 6 == 5 ? Vector3d(2.1, 1.9, trial % 12 == 5 ? 14.5 : 12.8) : Vector3d(5, 3.9 + 0.1 * (trial % 3), 2.1);
    const double speed_mps = std::array{2.0, 0.7, 6.3, 0.01}[static_cast<std::size_t>(trial % 4)];
    Sogm blocked = empty_map(size_m, 0.1, 8, kStart, 100'000);
    const Vector3d half = size_m / 2;
    for (int i = 0; i < 8; ++i)
      mark_moving(&blocked, in_box(rng, -half, half), in_cube(rng, 2.0), uniform(rng, 0.2, 0.5), i % 3 == 0);
    Sogm standing = empty_map(size_m, 0.1, 1, kStart, 100'000);
    if (trial % 2 == 0) mark_box(&standing, {0, -9, -9}, {0.3, uniform(rng, 0, 1), 99});
    const Vector3d goal = trial % 5 == 0 ? in_box(rng, -4 * half, 4 * half) : in_box(rng, -half, half);
    const double low_z = uniform(rng, -0.9, -0.5), high_z = uniform(rng, 0.4, 9);
    Reach reach{in_box(rng, -half, half), kStart + uniform_int(rng, 0, 300'000), speed_mps, 2.0};
    if (trial % 3 != 0) {
      reach.acceleration_mps2 = uniform(rng, 1.0, 5.0) * speed_mps;
      reach.velocity = in_cube(rng, speed_mps);
    }
    Guidance guidance;
    const Guidance* guided = guidance.build(standing, goal, low_z, high_z) ? &guidance : nullptr;
    cost_to_go.build(blocked, guided, reach, goal, {-99, -99, low_z}, {99, 99, high_z});
    const Vector3d corner = blocked.geometry.origin.cast<double>() * 0.1;
    const auto known = [&](int frame, const Vector3i& cell) {
      const Vector3d inside = corner + 0.2 * (cell.cast<double>().array() + 0.5).matrix();
      return cost_to_go.cell_of(frame, 0, inside.x()) >= 0 && cost_to_go.cell_of(frame, 1, inside.y()) >= 0;
    };
    const PlainCostToGo plain(blocked, guided, speed_mps, goal, low_z, high_z, known);
    const int first = cost_to_go.frame_at(reach.utime);
    for (int frame = first; frame <= blocked.num_frames; ++frame) {
      (void)plain.table([&](const Vector3i& cell) {
        const Vector3d inside =
            corner + 0.2 * (cell.cast<double>() + in_box(rng, {0.01, 0.01, 0.01}, {0.99, 0.99, 0.99}));
        const Vector3i found(cost_to_go.cell_of(frame, 0, inside.x()), cost_to_go.cell_of(frame, 1, inside.y()),
                             cost_to_go.cell_of(frame, 2, inside.z()));
        const double s = std::max(0.0, 1e-6 * static_cast<double>(kStart + frame * 100'000 - reach.utime));
        const Span x = span(reach, 0, s, s), y = span(reach, 1, s, s);
        const bool reached = inside.x() >= x.low && inside.x() <= x.high && inside.y() >= y.low && inside.y() <= y.high;
        unreached += !reached;
        if (found.minCoeff() < 0) {
          EXPECT_FALSE(reached) << "trial " << trial << " frame " << frame << " cell " << cell.transpose();
          return 0;
        }
        EXPECT_EQ(found, cell);
        const int value = plain.values[static_cast<std::size_t>(frame)][plain.index(cell)];
        const int delay = std::max(0, value - plain.straight[plain.index(cell)]);
        if (value >= kFar - 200) {  // all that can follow lies beyond what is known
          EXPECT_EQ(cost_to_go.delay_s(frame, cell.x(), cell.y(), cell.z()), 0.0);
          ++dead_ends;
          return 0;
        }
        EXPECT_NEAR(cost_to_go.delay_s(frame, cell.x(), cell.y(), cell.z()), delay * 0.1 / kTicks, 1e-9)
            << "trial " << trial << " frame " << frame << " cell " << cell.transpose();
        ++compared;
        detours += delay > 0 && delay < 16 * kTicks;
        closed += delay >= CostToGo::kClosedFrames * kTicks;
        after_start += frame > first;
        return 0;
      });
      ASSERT_FALSE(HasFailure());
    }
  }
  EXPECT_GT(compared, 50'000);
  EXPECT_GT(unreached, compared / 2);
  EXPECT_LT(dead_ends, compared / 100);
  EXPECT_GT(after_start, compared / 2);
  EXPECT_GT(detours, compared / 20);
  EXPECT_GT(closed, compared / 50);
}

// A wall with a door that opens after 0.8 s: waiting there is what it costs.
TEST(CostToGoTest, KnowsHowLongADoorStaysShut) {
  Sogm blocked = empty_map({8, 4, 2}, 0.1, 20, kStart, 100'000);
  mark_box(&blocked, {0, -9, -9}, {0.4, 9, 9}, 0, 7);
  mark_box(&blocked, {0, -9, -9}, {0.4, -0.3, 9}, 8);
  mark_box(&blocked, {0, 0.3, -9}, {0.4, 9, 9}, 8);
  CostToGo cost_to_go;
  cost_to_go.build(blocked, nullptr, {{-0.5, 0, 0}, kStart, 2.0, 2.0}, {6, 0, 0}, {-99, -99, -1}, {99, 99, 1});
  const auto delay_s = [&](int frame, double x, double y) {
    return cost_to_go.delay_s(frame, cost_to_go.cell_of(frame, 0, x), cost_to_go.cell_of(frame, 1, y),
                              cost_to_go.cell_of(frame, 2, 0.05));
  };
  EXPECT_NEAR(delay_s(0, -0.1, 0.1), 0.8, 0.11);   // in front of it
  EXPECT_NEAR(delay_s(0, -0.5, 0.1), 0.6, 0.11);   // the way there takes part of the time
  EXPECT_NEAR(delay_s(9, -0.1, 0.1), 0.0, 0.01);   // open
  EXPECT_NEAR(delay_s(9, -0.1, -1.1), 0.4, 0.15);  // beside it
  EXPECT_EQ(delay_s(9, 1.1, 0.1), 0.0);            // behind it
  EXPECT_EQ(cost_to_go.delay_s(0, -1, 3, 3), 0.0);
  EXPECT_EQ(cost_to_go.cell_of(0, 0, 3.9), -1);  // not reached so soon
}

}  // namespace
}  // namespace swarm
