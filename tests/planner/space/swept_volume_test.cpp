#include "planner_daemon/space/swept_volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr Duration kStep = 2ms;

std::vector<Vector3d> positions_during(const Motion& motion, Utime from, Utime to) {
  const Duration step = to - from > 500ms ? 5 * kStep : kStep;
  std::vector<Vector3d> positions;
  for (Utime t = from; t <= to; t += step) positions.push_back(motion.at(std::min(t, to)).position);
  positions.push_back(motion.at(to).position);
  return positions;
}

// How far the hull of a span's control points reaches from its chord, from their second differences alone.
double bulge(const Motion& motion, Utime from, Utime to) {
  double largest = 0.0;
  while (from < to) {
    const Utime stop = std::min(motion.next_knot_after(from), to);
    const ControlPoints c = control_points_between(motion, from, stop);
    for (int k = 1; k < 5; ++k) {
      largest = std::max(largest, 25.0 / 8.0 * (c.col(k - 1) - 2 * c.col(k) + c.col(k + 1)).norm());
    }
    from = stop;
  }
  return largest;
}

// What the layers of all frames hold, drawn into a map like `sogm`.
Sogm drawn(const SweptVolumes& volumes, const Sogm& sogm) {
  Sogm out;
  out.reset(sogm.geometry, sogm.num_frames, sogm.start_utime, sogm.frame_duration);
  const auto words = static_cast<std::size_t>(sogm.geometry.words_per_column());
  for (int frame = 0; frame < sogm.num_frames; ++frame) {
    std::vector<Layer> layers;
    volumes.append_layers(frame, all_columns(sogm.geometry), &layers);
    for (const Layer& layer : layers) {
      for (int x = layer.columns.first.x(); x <= layer.columns.last.x(); ++x) {
        for (std::size_t i = 0; i < static_cast<std::size_t>(layer.columns.width()) * words; ++i) {
          out.column(frame, x, layer.columns.first.y())[i] |=
              layer.words[static_cast<std::size_t>(x - layer.columns.first.x()) * layer.row + i];
        }
      }
    }
  }
  return out;
}

Sogm swept(const Motion& motion, double radius_m, const Sogm& sogm, const std::vector<Columns>& bounds,
           Duration clock_error = {}) {
  SweptVolumes volumes;
  volumes.lay_out(sogm);
  volumes.add(motion, radius_m, clock_error, bounds);
  return drawn(volumes, sogm);
}

std::vector<Columns> everywhere(const Sogm& sogm) {
  return std::vector<Columns>(static_cast<std::size_t>(sogm.num_frames), all_columns(sogm.geometry));
}

Sogm random_window(Rng& rng) {
  GridGeometry geometry;
  geometry.resolution_m = uniform(rng, 0.08, 0.2);
  geometry.size = {uniform_int(rng, 10, 40), uniform_int(rng, 10, 40), uniform_int(rng, 5, 90)};
  geometry.origin =
      -geometry.size / 2 + Vector3i(uniform_int(rng, -8, 8), uniform_int(rng, -8, 8), uniform_int(rng, -8, 8));
  Sogm sogm;
  sogm.reset(geometry, uniform_int(rng, 1, 12), kStart, uniform_duration(rng, 50ms, 400ms));
  return sogm;
}

// Both directions in one: what comes within the radius is marked, in its frame, and nothing much farther is.
TEST(SweptVolumeTest, MarksWhatTheMotionSweepsInEachFrameAndLittleMore) {
  Rng rng(1);
  int switches_inside_a_frame = 0;
  std::int64_t marked = 0, needed = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const Sogm window = random_window(rng);
    const Motion motion = random_motion(rng, kStart - uniform_duration(rng, 0us, 1s), 2.0);
    const double radius = uniform(rng, 0.1, 0.5);
    const Duration error = trial % 2 == 0 ? 0us : uniform_duration(rng, 1us, 50ms);  // of the clock
    const Sogm sogm = swept(motion, radius, window, everywhere(window), error);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", radius " << radius << ", resolution "
                                    << sogm.geometry.resolution_m << ", origin " << sogm.geometry.origin.transpose()
                                    << ", size " << sogm.geometry.size.transpose() << ", " << sogm.num_frames
                                    << " frames of " << sogm.frame_duration.count() << " us\n"
                                    << motion);
    const GridGeometry& grid = sogm.geometry;
    for (int frame = 0; frame < sogm.num_frames; ++frame) {
      const Utime from = kStart + frame * sogm.frame_duration - error;
      Utime to = from + sogm.frame_duration + 2 * error;
      if (frame + 1 == sogm.num_frames) to = std::max(to, motion.end_utime());  // it stays in force
      switches_inside_a_frame +=
          !motion.next.empty() && motion.next.start_utime() > from && motion.next.start_utime() < to;
      const std::vector<Vector3d> positions = positions_during(motion, from, to);
      double step = 0.0;
      for (std::size_t i = 1; i < positions.size(); ++i)
        step = std::max(step, (positions[i] - positions[i - 1]).norm());
      const double limit = radius + 2 * bulge(motion, from, to) + step + 1e-6;
      for (int x = 0; x < grid.size.x(); ++x) {
        for (int y = 0; y < grid.size.y(); ++y) {
          for (int z = 0; z < grid.size.z(); ++z) {
            const Vector3d center = grid.center_of({x, y, z});
            const bool is_marked = sogm.occupied(frame, {x, y, z});
            // Far from all the motion there is nothing to look at closely.
            if (!is_marked &&
                (center - positions.front()).norm() > radius + step * static_cast<double>(positions.size()))
              continue;
            double nearest = INFINITY;
            for (const Vector3d& position : positions) nearest = std::min(nearest, (center - position).squaredNorm());
            nearest = std::sqrt(nearest);
            if (nearest <= radius - 1e-6) {
              ++needed;
              ASSERT_TRUE(is_marked) << "frame " << frame << ", voxel " << x << ' ' << y << ' ' << z << ": " << nearest;
            }
            if (is_marked) {
              ++marked;
              ASSERT_LE(nearest, limit) << "frame " << frame << ", voxel " << x << ' ' << y << ' ' << z;
            }
          }
        }
      }
      if (grid.size.z() % 64 == 0) continue;
      for (int x = 0; x < grid.size.x(); ++x) {
        for (int y = 0; y < grid.size.y(); ++y) {
          ASSERT_EQ(sogm.column(frame, x, y)[grid.words_per_column() - 1] >> (grid.size.z() % 64), 0u)
              << "above the window";
        }
      }
    }
  }
  EXPECT_GT(switches_inside_a_frame, 10);
  EXPECT_GT(needed, 10'000);
  EXPECT_LT(marked, needed * 3 / 2);  // conservative, not wasteful
}

TEST(SweptVolumeTest, HoverTailFillsAllLaterFramesWithTheSameBall) {
  Sogm sogm;
  GridGeometry geometry;
  geometry.size = {20, 20, 20};
  sogm.reset(geometry, 4, kStart, 200ms);
  const Sogm marked = swept({Trajectory::hover(1, kStart - 10s, {1.0, 1.0, 1.0}), {}}, 0.3, sogm, everywhere(sogm));
  for (int frame = 0; frame < 4; ++frame) {
    for (int x = 0; x < 20; ++x) {
      for (int y = 0; y < 20; ++y) {
        for (int z = 0; z < 20; ++z) {
          const double distance = (geometry.center_of({x, y, z}) - Vector3d(1, 1, 1)).norm();
          ASSERT_EQ(marked.occupied(frame, {x, y, z}), distance <= 0.3) << frame << ": " << x << ' ' << y << ' ' << z;
        }
      }
    }
  }
}

TEST(SweptVolumeTest, KeepsOffFarWindowsAndHoldsSeveralMotions) {
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {10, 10, 10}}, 2, kStart, 200ms);
  SweptVolumes volumes;
  volumes.lay_out(sogm);
  volumes.add({Trajectory::hover(1, kStart, {-5, 0, 50}), {}}, 0.3, 0us, everywhere(sogm));
  EXPECT_EQ(drawn(volumes, sogm).words(), sogm.words());
  volumes.add({Trajectory::hover(1, kStart, {0.85, 0.85, 0.85}), {}}, 0.1, 0us, everywhere(sogm));
  volumes.add({Trajectory::hover(1, kStart, {0.25, 0.35, 0.45}), {}}, 0.1, 0us, everywhere(sogm));
  EXPECT_TRUE(drawn(volumes, sogm).occupied(1, {2, 3, 4}));
  EXPECT_TRUE(drawn(volumes, sogm).occupied(1, {8, 8, 8}));
  std::vector<Layer> layers;
  volumes.append_layers(0, {{0, 0}, {3, 3}}, &layers);
  EXPECT_FALSE(layers.empty());
  for (const Layer& layer : layers) EXPECT_LE(layer.columns.last.maxCoeff(), 4) << "the other one is elsewhere";
  volumes.lay_out(sogm);
  EXPECT_EQ(drawn(volumes, sogm).words(), sogm.words());
}

TEST(SweptVolumeTest, KeepsToTheBounds) {
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {20, 20, 20}}, 2, kStart, 200ms);
  const std::vector<Columns> bounds = {Columns{{8, 9}, {15, 10}}, Columns{}};
  MotionState slow;  // up, for what rests is drawn once for all frames
  slow.position = {1.0, 1.0, 1.0};
  slow.velocity.z() = 1e-3;
  Trajectory rising(1, kStart, 1s, 1);
  rising.set_knot(0, slow);
  slow.velocity.setZero();
  rising.set_knot(1, slow);
  const Sogm marked = swept({rising, {}}, 0.3, sogm, bounds);
  const Sogm rests = swept({Trajectory::hover(1, kStart, {1.0, 1.0, 1.0}), {}}, 0.3, sogm, bounds);
  int count = 0;
  for (int x = 0; x < 20; ++x) {
    for (int y = 0; y < 20; ++y) {
      const bool inside = x >= 8 && x <= 15 && y >= 9 && y <= 10;
      const double distance = (sogm.geometry.center_of({x, y, 9}) - Vector3d(1, 1, 1)).norm();
      EXPECT_EQ(marked.occupied(0, {x, y, 9}), inside && distance <= 0.3) << x << ' ' << y;
      EXPECT_EQ(rests.occupied(0, {x, y, 9}), distance <= 0.3) << x << ' ' << y;
      EXPECT_FALSE(marked.occupied(1, {x, y, 9}) || rests.occupied(1, {x, y, 9})) << "no bounds: " << x << ' ' << y;
      count += inside && distance <= 0.3;
    }
  }
  EXPECT_GT(count, 5);
}

}  // namespace
}  // namespace swarm
