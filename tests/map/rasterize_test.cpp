// What is drawn into the frames, voxel by voxel against exact distances: obstacles larger than what is looked at
// together, at the window's edges, over several words of a column, that stand, turn and move.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "map_daemon/obstacle.h"

namespace swarm {
namespace {

using std::numbers::pi;

struct Drawing {
  Obstacle obstacle;
  double margin_m = 0.0, growth_mps = 0.0;
  Sogm sogm;
};

Drawing random_drawing(Shape::Kind kind, std::mt19937* rng) {
  const auto uniform = [rng](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(*rng);
  };
  const auto one_of = [rng](int n) { return static_cast<int>((*rng)() % static_cast<unsigned>(n)); };
  Drawing drawing;
  const int height = std::array{1, 40, 64, 75, 130}[static_cast<std::size_t>(one_of(5))];
  drawing.sogm.reset({.resolution_m = std::array{0.08, 0.1, 0.15}[static_cast<std::size_t>(one_of(3))],
                      .origin = {one_of(40) - 40, one_of(40) - 40, one_of(height + 1) - height},
                      .size = {30 + one_of(20), 30 + one_of(20), height}},
                     3, Utime(7s), 100ms);
  Shape& shape = drawing.obstacle.shape;
  shape.kind = kind;
  shape.size = {uniform(0.0, 2.5), uniform(0.0, 1.5), uniform(0.0, 2.0)};
  if (kind == Shape::Kind::kRing) shape.size.y() *= 0.2;
  shape.yaw_rad = one_of(4) == 0 ? pi / 2 * one_of(4) : uniform(-pi, pi);
  drawing.obstacle.position = Eigen::Vector3d(uniform(-3, 3), uniform(-3, 3), uniform(-3, 3));
  drawing.obstacle.velocity = one_of(3) * Eigen::Vector3d(uniform(-2, 2), uniform(-2, 2), one_of(2) * uniform(-2, 2));
  drawing.obstacle.utime = Utime(7s) - Duration(one_of(300'000));
  drawing.obstacle.acceleration_mps2 = one_of(2) * uniform(0.0, 2.0);
  drawing.margin_m = drawing.sogm.geometry.resolution_m / 2 + one_of(2) * uniform(0.0, 0.1);
  drawing.growth_mps = one_of(2) * uniform(0.0, 0.2);
  return drawing;
}

// How far the voxel's centre stays beyond what is marked in a frame [m], by the rule that obstacle.h and rasterize.cpp
// tell: solids round from above along all of their way, others at places at most half a voxel apart.
double beyond_m(const Drawing& drawing, int frame, const Eigen::Vector3d& center) {
  const double frame_s = to_seconds(drawing.sogm.frame_duration), resolution_m = drawing.sogm.geometry.resolution_m;
  const double lead_s = to_seconds(drawing.sogm.start_utime - drawing.obstacle.utime), end_s = (frame + 1) * frame_s;
  const Eigen::Vector3d motion = frame_s * drawing.obstacle.velocity;
  const Eigen::Vector3d from = drawing.obstacle.position + (lead_s + frame * frame_s) * drawing.obstacle.velocity;
  Shape core = thickened(drawing.obstacle.shape, resolution_m, drawing.margin_m);
  double r = drawing.margin_m + drawing.growth_mps * end_s +
             drawing.obstacle.acceleration_mps2 * std::pow(std::clamp(lead_s + end_s, 0.0, kUnseen_s), 2) / 2;
  if (core.kind == Shape::Kind::kRing) r += core.size.y() / 2, core.size.y() = 0.0;
  if (core.kind == Shape::Kind::kSphere) r += core.size.x() / 2, core.size.x() = 0.0;
  const bool is_round = core.kind == Shape::Kind::kColumn || core.kind == Shape::Kind::kSphere;
  if (is_round && motion.z() == 0.0) {
    const Eigen::Vector2d way = motion.head<2>(), to = (center - from).head<2>();
    const double s = way.squaredNorm() > 0.0 ? std::clamp(way.dot(to) / way.squaredNorm(), 0.0, 1.0) : 0.0;
    return distance(core, center - from - s * motion) - r;
  }
  const int steps = static_cast<int>(std::ceil(motion.norm() / (0.5 * resolution_m)));
  const double step_m = steps > 0 ? motion.norm() / steps : 0.0;
  double nearest = 1e9;
  for (int k = 0; k <= steps; ++k)
    nearest = std::min(nearest, distance(core, center - from - (steps > 0 ? 1.0 * k / steps : 0.0) * motion));
  return nearest - std::hypot(r, step_m / 2);
}

TEST(RasterizeExactly, MarksWhatDistancesSay) {
  std::mt19937 rng(21);
  std::int64_t marked = 0, visited = 0;
  for (const Shape::Kind kind : {Shape::Kind::kColumn, Shape::Kind::kRing, Shape::Kind::kBox, Shape::Kind::kSphere}) {
    for (int trial = 0; trial < 8; ++trial) {
      Drawing drawing = random_drawing(kind, &rng);
      rasterize(drawing.obstacle, drawing.margin_m, drawing.growth_mps, &drawing.sogm);
      const GridGeometry& grid = drawing.sogm.geometry;
      for (int frame = 0; frame < drawing.sogm.num_frames; ++frame) {
        for (int x = 0; x < grid.size.x(); ++x) {
          for (int y = 0; y < grid.size.y(); ++y) {
            for (int z = 0; z < grid.size.z(); ++z) {
              const double beyond = beyond_m(drawing, frame, grid.center_of({x, y, z}));
              if (std::abs(beyond) < 2e-9) continue;  // what is in contact counts as inside
              const bool is_marked = drawing.sogm.occupied(frame, {x, y, z});
              marked += is_marked;
              ++visited;
              ASSERT_EQ(is_marked, beyond < 0.0)
                  << "kind " << static_cast<int>(kind) << ", trial " << trial << ", frame " << frame << ", voxel " << x
                  << ' ' << y << ' ' << z << ", beyond " << beyond << " m";
            }
          }
        }
      }
    }
  }
  EXPECT_GT(marked, visited / 500);
}

// All frames of what stands are one.
TEST(RasterizeExactly, WhatStandsIsTheSameInAllFrames) {
  std::mt19937 rng(22);
  for (int trial = 0; trial < 100; ++trial) {
    Drawing drawing = random_drawing(static_cast<Shape::Kind>(trial % 4), &rng);
    drawing.obstacle.velocity.setZero();
    drawing.obstacle.acceleration_mps2 = drawing.growth_mps = 0.0;
    rasterize(drawing.obstacle, drawing.margin_m, 0.0, &drawing.sogm);
    const auto begin = drawing.sogm.words().begin();
    const auto n = static_cast<std::ptrdiff_t>(drawing.sogm.geometry.words_per_frame());
    for (int frame = 1; frame < drawing.sogm.num_frames; ++frame) {
      ASSERT_TRUE(std::equal(begin, begin + n, begin + frame * n)) << "trial " << trial;
    }
  }
}

}  // namespace
}  // namespace swarm
