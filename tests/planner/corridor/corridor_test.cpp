#include "planner_daemon/corridor/corridor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/support/hull_distance.h"
#include "tests/support/random_map.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr double kPiece_s = 0.2;
const Vector3d kEverywhere = Vector3d::Constant(1e3);
const Eigen::AlignedBox3d kAll(-kEverywhere, kEverywhere);

struct Box {
  Vector3d low, high;
  bool contains(const Vector3d& p) const {
    return (p.array() >= low.array()).all() && (p.array() <= high.array()).all();
  }
};

// ReachableSet around the control points, inside the flight space, but never less than the control points.
Box box_around(const ControlPoints& piece, double extent, const Vector3d& space_min, const Vector3d& space_max) {
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = piece.row(axis).minCoeff(), high = piece.row(axis).maxCoeff();
    box.low[axis] = std::min(low, std::max(low - extent, space_min[axis]));
    box.high[axis] = std::max(high, std::min(high + extent, space_max[axis]));
  }
  return box;
}

ControlPoints random_piece(Rng& rng, const Vector3d& half) {
  MotionState from, to;
  from.position = in_box(rng, -half, half);
  from.velocity = in_cube(rng, 2);
  from.acceleration = in_cube(rng, 5);
  to.acceleration = in_cube(rng, 5);
  to.velocity = from.velocity + kPiece_s / 2 * (from.acceleration + to.acceleration);
  to.position = from.position + kPiece_s / 2 * (from.velocity + to.velocity);
  if (uniform_int(rng, 0, 4) == 0) from.velocity.setZero(), from.acceleration.setZero(), to = from;  // hovers
  return quintic_control_points(from, to, kPiece_s);
}

bool occupied_during(const Sogm& sogm, int first, int last, const Vector3i& voxel) {
  for (int frame = first; frame <= last; ++frame) {
    if (sogm.occupied(frame, voxel)) return true;
  }
  return false;
}

bool on_free_voxels(const ControlPoints& piece, const Sogm& sogm, int first, int last) {
  for (int i = 0; i <= 40; ++i) {
    const Vector3d p = evaluate_bezier(piece, kPiece_s, i / 40.0).position;
    if (occupied_during(sogm, first, last, sogm.geometry.voxel_of(p))) return false;
  }
  return true;
}

template <typename Visit>
void for_each_voxel(const GridGeometry& grid, const Visit& visit) {
  for (int x = 0; x < grid.size.x(); ++x) {
    for (int y = 0; y < grid.size.y(); ++y) {
      for (int z = 0; z < grid.size.z(); ++z) visit(Vector3i(x, y, z));
    }
  }
}

// Pieces anywhere over random maps, over the window's border and outside it, for one or several frames.
TEST(CorridorTest, ExcludesAllThatIsOccupiedAndHoldsThePiece) {
  Rng rng(1);
  const Vector3d space_min(-2.6, -2.6, -1.2), space_max(2.6, 2.6, 1.3);
  const CorridorOptions options;
  CorridorBuilder builder(options);
  int grown = 0, refused = 0, excluded = 0, beside_border = 0;
  for (int map = 0; map < 40; ++map) {
    const Sogm sogm = random_map(rng, uniform_int(rng, 1, 30), {4.4, 4.4, 2.4}, 6, kStart,
                                 Duration(uniform_int(rng, 100'000, 300'000)));
    for (int trial = 0; trial < 20; ++trial) {
      ControlPoints piece = random_piece(rng, {2.5, 2.5, 1.1});
      if (trial % 4 == 0) {  // a thick hull
        for (int k = 0; k < 6; ++k) piece.col(k) += in_cube(rng, 0.2);
      }
      const Utime from = kStart + Duration(uniform_int(rng, -300'000, 2'000'000)), to = from + 200ms;
      const int first = sogm.frame_at(from), last = sogm.frame_at(to - 1us);
      SCOPED_TRACE(testing::Message() << "map " << map << " trial " << trial << ", frames " << first << " to " << last
                                      << ", piece\n"
                                      << piece);
      Polytope polytope;
      const FiriStatus status = builder.build(piece, {&sogm}, 0.0, {space_min, space_max}, from, to, &polytope);
      for (int k = 0; k < 6; ++k) ASSERT_LE(polytope.violation(piece.col(k)), 1e-9) << "control point " << k;
      const Box box = box_around(piece, options.extent_m, space_min, space_max);
      for (int i = 0; i < 60; ++i) {  // nothing outside the box
        const Vector3d p = in_box(rng, box.low.array() - 0.5, box.high.array() + 0.5);
        ASSERT_TRUE(box.contains(p) || polytope.violation(p) > 0.0) << p.transpose();
      }
      if (status == FiriStatus::kSeedBlocked) {
        ++refused;
        double nearest = INFINITY;
        for_each_voxel(sogm.geometry, [&](const Vector3i& voxel) {
          const Vector3d center = sogm.geometry.center_of(voxel);
          if (!box.contains(center) || nearest < 1e-6 || !occupied_during(sogm, first, last, voxel)) return;
          if (((center - piece.rowwise().minCoeff()).array() < -1e-6).any()) return;
          if (((center - piece.rowwise().maxCoeff()).array() > 1e-6).any()) return;
          nearest = std::min(nearest, distance_to_hull(piece, center));
        });
        ASSERT_LT(nearest, 1e-6) << "refused although no centre lies in the hull";
        continue;
      }
      if (!on_free_voxels(piece, sogm, first, last)) continue;  // the search leads over free voxels only
      ++grown;
      beside_border += !sogm.geometry.contains(sogm.geometry.voxel_of(box.low)) ||
                       !sogm.geometry.contains(sogm.geometry.voxel_of(box.high));
      for_each_voxel(sogm.geometry, [&](const Vector3i& voxel) {
        if (!occupied_during(sogm, first, last, voxel)) return;
        const Vector3d center = sogm.geometry.center_of(voxel);
        excluded += box.contains(center);
        ASSERT_GE(polytope.violation(center), -1e-9) << "voxel " << voxel.transpose() << " at " << center.transpose();
      });
    }
  }
  EXPECT_GT(grown, 200);
  EXPECT_GT(refused, 10);
  EXPECT_GT(excluded, 20'000);
  EXPECT_GT(beside_border, 50);
}

TEST(CorridorTest, ObstaclesAreTheSurfaceOfTheFramesUnion) {
  Rng rng(2);
  const CorridorOptions options;
  CorridorBuilder builder(options);
  std::size_t hidden = 0, found = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const Sogm sogm = random_map(rng, 30, {4, 4, trial % 2 == 0 ? 2.0 : 8.0}, 4, kStart, 200ms);
    const ControlPoints piece = random_piece(rng, {2, 2, 1});
    const Utime from = kStart + Duration(uniform_int(rng, 0, 700'000)), to = from + 200ms;
    const int first = sogm.frame_at(from), last = sogm.frame_at(to - 1us);
    Polytope polytope;
    (void)builder.build(piece, {&sogm}, 0.0, kAll, from, to, &polytope);
    const Box box = box_around(piece, options.extent_m, -kEverywhere, kEverywhere);
    const GridGeometry& grid = sogm.geometry;
    const Vector3i low = grid.voxel_of(box.low), high = grid.voxel_of(box.high);
    const auto in_box_voxels = [&](const Vector3i& v) {
      return (v.array() >= low.array()).all() && (v.array() <= high.array()).all();
    };
    std::vector<Vector3i> expected, actual;
    for_each_voxel(grid, [&](const Vector3i& voxel) {
      if (!in_box_voxels(voxel) || !occupied_during(sogm, first, last, voxel)) return;
      bool covered = true;
      for (int axis = 0; axis < 3; ++axis) {
        for (int side : {-1, 1}) {
          const Vector3i neighbour = voxel + side * Vector3i::Unit(axis);
          // Upwards the whole column is known; sideways what lies outside the box counts as free.
          covered = covered && (axis == 2 || in_box_voxels(neighbour)) && occupied_during(sogm, first, last, neighbour);
        }
      }
      if (covered)
        ++hidden;
      else
        expected.push_back(voxel);
    });
    for (const PointRun& run : builder.obstacles()) {
      ASSERT_GE(run.count, 1);
      const Vector3i lowest = grid.voxel_of(run.first);
      ASSERT_LT((grid.center_of(lowest) - run.first).norm(), 1e-12);
      for (int k = 0; k < run.count; ++k) actual.push_back(lowest + Vector3i(0, 0, k));
    }
    const auto less = [](const Vector3i& a, const Vector3i& b) {
      return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
    };
    std::sort(actual.begin(), actual.end(), less);
    std::sort(expected.begin(), expected.end(), less);
    ASSERT_EQ(actual, expected) << "trial " << trial << "\n" << piece;
    found += actual.size();
  }
  EXPECT_GT(found, 10'000u);
  EXPECT_GT(hidden, 1'000u);
}

TEST(CorridorTest, AnEmptyMapGivesTheBoxInsideTheFlightSpace) {
  Rng rng(3);
  const Vector3d space_min(-2, -2, 0.2), space_max(2, 2, 3);
  for (double extent : {0.3, 1.2, 3.0}) {
    CorridorBuilder builder(CorridorOptions{extent});
    const Sogm sogm = empty_map({6, 6, 4}, 0.1, 3, kStart, 200ms);
    for (int trial = 0; trial < 30; ++trial) {
      const ControlPoints piece = random_piece(rng, {2.5, 2.5, 3});  // some leave the flight space, which gives way
      Polytope polytope;
      ASSERT_EQ(builder.build(piece, {&sogm}, 0.0, {space_min, space_max}, kStart, kStart + 200ms, &polytope),
                FiriStatus::kGrown);
      EXPECT_TRUE(builder.obstacles().empty());
      const Box box = box_around(piece, extent, space_min, space_max);
      for (int i = 0; i < 200; ++i) {
        const Vector3d p = in_box(rng, box.low.array() - 0.3, box.high.array() + 0.3);
        ASSERT_EQ(polytope.violation(p) <= 0.0, box.contains(p)) << p.transpose() << "\n" << piece;
      }
    }
  }
}

TEST(CorridorTest, LooksAtThePiecesFramesOnly) {
  Rng rng(4);
  CorridorBuilder builder(CorridorOptions{});
  for (int trial = 0; trial < 30; ++trial) {
    const Sogm sogm = random_map(rng, 20, {4, 4, 2}, 6, kStart, 200ms);
    Sogm other = sogm;  // as crowded as can be in the frames before and after
    mark_box(&other, -kEverywhere, kEverywhere, 0, 1);
    mark_box(&other, -kEverywhere, kEverywhere, 4, 5);
    const ControlPoints piece = random_piece(rng, {1, 1, 1});
    // Up to the first microsecond of the next frame, not included.
    const Utime from = kStart + 400ms + uniform_int(rng, 0, 1) * 100ms, to = kStart + 800ms;
    Polytope a, b;
    const FiriStatus status = builder.build(piece, {&sogm}, 0.0, kAll, from, to, &a);
    ASSERT_EQ(builder.build(piece, {&other}, 0.0, kAll, from, to, &b), status);
    ASSERT_EQ(a.normals, b.normals) << piece;
    ASSERT_EQ(a.offsets, b.offsets) << piece;
  }
}

TEST(CorridorTest, StopsAtTheVoxelsFace) {
  Sogm sogm = empty_map({6, 6, 3}, 0.1, 1, kStart, 200ms);
  mark_box(&sogm, {0.8, -9, -9}, {1.0, 9, 9});  // voxels from x = 0.8 on
  CorridorBuilder builder(CorridorOptions{2.0});
  ControlPoints piece;
  for (int k = 0; k < 6; ++k) piece.col(k) = Vector3d(0, 0.1 * k, 0.05);
  Polytope polytope;
  ASSERT_EQ(builder.build(piece, {&sogm}, 0.0, kAll, kStart, kStart + 200ms, &polytope), FiriStatus::kGrown);
  for (double y : {-1.9, 0.0, 2.4}) {
    EXPECT_LT(polytope.violation({0.799, y, 0.05}), 0.0) << y;
    EXPECT_GT(polytope.violation({0.801, y, 0.05}), 0.0) << y;
    EXPECT_LT(polytope.violation({-1.99, y, 0.05}), 0.0) << y;
  }
}

TEST(CorridorTest, RefusesASeedAroundAnOccupiedVoxel) {
  Sogm sogm = empty_map({4, 4, 2}, 0.1, 2, kStart, 200ms);
  mark_box(&sogm, {0.2, 0.2, 0.2}, {0.3, 0.3, 0.3}, 1, 1);  // the voxel at 0.25
  CorridorBuilder builder(CorridorOptions{});
  ControlPoints piece;
  for (int k = 0; k < 6; ++k) piece.col(k) = Vector3d::Constant(0.1 * k);  // passes its centre
  Polytope polytope;
  EXPECT_EQ(builder.build(piece, {&sogm}, 0.0, kAll, kStart + 200ms, kStart + 400ms, &polytope),
            FiriStatus::kSeedBlocked);
  EXPECT_EQ(builder.build(piece, {&sogm}, 0.0, kAll, kStart + 100ms, kStart + 300ms, &polytope),
            FiriStatus::kSeedBlocked);
  EXPECT_EQ(builder.build(piece, {&sogm}, 0.0, kAll, kStart, kStart + 200ms, &polytope),
            FiriStatus::kGrown);  // not yet there
}

TEST(CorridorTest, KeepsOutOfWhatIsKeptClearOfBesides) {
  const Sogm sogm = empty_map({4, 4, 2}, 0.1, 1, kStart, 200ms);
  const Motion hovers{Trajectory::hover(1, kStart - 1s, {0, 0, 0}), {}};
  const Columns all = all_columns(sogm.geometry);
  SweptVolumes peer, apart;
  for (SweptVolumes* volumes : {&peer, &apart}) {
    volumes->lay_out(sogm);
    EXPECT_TRUE(volumes->empty());
    volumes->add(hovers, volumes == &peer ? 0.25 : 0.75, 0us, {&all, 1});
    EXPECT_FALSE(volumes->empty());
  }
  CorridorBuilder builder(CorridorOptions{});
  ControlPoints piece;
  Polytope polytope;
  const auto grow = [&](double y, const Occupancy& occupancy) {
    for (int k = 0; k < 6; ++k) piece.col(k) = Vector3d(0.06 * k - 0.15, y, 0.02);
    return builder.build(piece, occupancy, 0.0, kAll, kStart, kStart + 200ms, &polytope);
  };
  const Vector3d between(0.0, 0.6, 0.02);
  ASSERT_EQ(grow(1.0, {&sogm, &peer}), FiriStatus::kGrown);
  EXPECT_LT(polytope.violation(between), 0.0);
  ASSERT_EQ(grow(1.0, {&sogm, &peer, &apart}), FiriStatus::kGrown);
  EXPECT_GT(polytope.violation(between), 0.0);
  // All inside: no surface tells.
  EXPECT_EQ(grow(0.45, {&sogm, &peer}), FiriStatus::kGrown);
  EXPECT_EQ(grow(0.45, {&sogm, &peer, &apart}), FiriStatus::kSeedBlocked);
}

}  // namespace
}  // namespace swarm
