// Layout of the SOGM and exactness of the dilation against brute force.
#include "map_daemon/sogm.h"

#include <gtest/gtest.h>

#include <random>
#include <stdexcept>

#include "map_daemon/dilation.h"

namespace swarm {
namespace {

Sogm random_sogm(const Eigen::Vector3i& size, int frames, double density, double resolution_m, std::mt19937* rng) {
  Sogm sogm;
  sogm.reset({.resolution_m = resolution_m, .origin = {-7, 3, 1}, .size = size}, frames, 1000, 100000);
  std::bernoulli_distribution occupied(density);
  for (int f = 0; f < frames; ++f) {
    for (int x = 0; x < size.x(); ++x) {
      for (int y = 0; y < size.y(); ++y) {
        for (int z = 0; z < size.z(); ++z) {
          if (occupied(*rng)) sogm.column(f, x, y)[z / 64] |= std::uint64_t{1} << (z % 64);
        }
      }
    }
  }
  return sogm;
}

// The definition, with the radius given in tenths of a voxel so that the comparison is exact.
void brute_force(const Sogm& in, int radius_tenths, Sogm* out) {
  out->reset(in.geometry, in.num_frames, in.start_utime, in.frame_duration_us);
  const Eigen::Vector3i size = in.geometry.size;
  const int reach = radius_tenths / 10;
  for (int f = 0; f < in.num_frames; ++f) {
    for (int x = 0; x < size.x(); ++x) {
      for (int y = 0; y < size.y(); ++y) {
        for (int z = 0; z < size.z(); ++z) {
          if (!in.occupied(f, {x, y, z})) continue;
          for (int dx = -reach; dx <= reach; ++dx) {
            for (int dy = -reach; dy <= reach; ++dy) {
              for (int dz = -reach; dz <= reach; ++dz) {
                const Eigen::Vector3i v(x + dx, y + dy, z + dz);
                if (100 * (dx * dx + dy * dy + dz * dz) > radius_tenths * radius_tenths) continue;
                if (in.geometry.contains(v))
                  out->column(f, v.x(), v.y())[v.z() / 64] |= std::uint64_t{1} << (v.z() % 64);
              }
            }
          }
        }
      }
    }
  }
}

TEST(Dilation, EqualsBruteForce) {
  std::mt19937 rng(20240601);
  Dilator dilator;
  Sogm out, expected;
  const Eigen::Vector3i sizes[] = {{1, 1, 1},   {9, 13, 7},  {13, 5, 64}, {6, 11, 65},
                                   {4, 7, 131}, {17, 2, 40}, {2, 3, 128}};
  for (const Eigen::Vector3i& size : sizes) {
    for (double density : {0.0, 0.002, 0.03}) {
      for (double resolution_m : {0.1, 0.15, 0.08}) {
        const Sogm in = random_sogm(size, 2, density, resolution_m, &rng);
        for (int radius_tenths : {0, 7, 10, 14, 15, 20, 30, 37, 50, 90}) {
          out = dilator.dilate(in, radius_tenths * resolution_m / 10);
          brute_force(in, radius_tenths, &expected);
          EXPECT_TRUE(out.words == expected.words)
              << "size " << size.transpose() << " density " << density << " resolution " << resolution_m << " radius "
              << radius_tenths << "/10 voxels";
          EXPECT_EQ(out.geometry, in.geometry);
          EXPECT_EQ(out.start_utime, in.start_utime);
          EXPECT_EQ(out.frame_duration_us, in.frame_duration_us);
        }
      }
    }
  }
}

TEST(Dilation, RadiusOnTheLatticeIsInclusive) {
  Sogm in, out;
  in.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {9, 9, 9}}, 1, 0, 1);
  in.column(0, 4, 4)[0] = 1u << 4;
  dilate(in, 0.3, &out);  // 0.3 / 0.1 < 3 in floating point
  EXPECT_TRUE(out.occupied(0, {1, 4, 4}));
  EXPECT_TRUE(out.occupied(0, {4, 4, 7}));
  EXPECT_TRUE(out.occupied(0, {2, 2, 5}));   // 4 + 4 + 1 = 9
  EXPECT_FALSE(out.occupied(0, {2, 2, 6}));  // 12
  EXPECT_FALSE(out.occupied(0, {0, 4, 4}));
}

TEST(Dilation, RadiusLargerThanTheWindowFillsIt) {
  Sogm in, out;
  in.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {5, 4, 70}}, 1, 0, 1);
  in.column(0, 0, 0)[0] = 1;
  dilate(in, 1e6, &out);
  for (int x = 0; x < 5; ++x) {
    for (int y = 0; y < 4; ++y) {
      EXPECT_EQ(out.column(0, x, y)[0], ~std::uint64_t{0});
      EXPECT_EQ(out.column(0, x, y)[1], 0x3fu);
    }
  }
}

TEST(Dilation, WhatWasOccupiedSomeFramesBeforeCountsAsWell) {
  std::mt19937 rng(11);
  Dilator dilator;
  for (int trial = 0; trial < 12; ++trial) {
    const Sogm in = random_sogm({11, 14, trial % 2 == 0 ? 9 : 70}, 6, 0.004, 0.1, &rng);
    for (int before : {0, 1, 3, 9}) {
      Sogm sums = in, expected;
      for (int frame = 0; frame < in.num_frames; ++frame) {
        for (int earlier = std::max(0, frame - before); earlier < frame; ++earlier) {
          for (int i = 0; i < in.geometry.words_per_frame(); ++i)
            sums.column(frame, 0, 0)[i] |= in.column(earlier, 0, 0)[i];
        }
      }
      for (double radius_m : {0.0, 0.15}) {
        dilate(sums, radius_m, &expected);
        EXPECT_TRUE(dilator.dilate(in, radius_m, nullptr, before).words == expected.words)
            << "trial " << trial << ": " << before << " frames before, radius " << radius_m;
      }
    }
  }
}

// Inside what is reached while a frame is in force, as without a reach; elsewhere clear, or at most a voxel wider.
TEST(Dilation, ReachLimitsTheWorkAndNothingElse) {
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  int kept = 0, dropped = 0;
  for (int trial = 0; trial < 30; ++trial) {
    const Sogm in = random_sogm({24, 17, trial % 2 == 0 ? 9 : 70}, 5, 0.01, 0.1, &rng);
    const double frame_s = 1e-6 * static_cast<double>(in.frame_duration_us);
    const Eigen::Vector3d middle = in.geometry.center_of(in.geometry.size / 2);
    Reach reach;
    reach.center = middle + Eigen::Vector3d(2.0 * uniform(rng), 1.5 * uniform(rng), uniform(rng));
    reach.utime = in.start_utime + static_cast<std::int64_t>(1e6 * frame_s * 3 * (1 + uniform(rng)));
    reach.speed_mps = 0.5 / frame_s * (1 + uniform(rng));
    reach.horizon_s = frame_s * (4 + uniform(rng));
    Sogm whole, part;
    dilate(in, 0.25, &whole);
    dilate(in, 0.25, &part, &reach);
    for (int frame = 0; frame < in.num_frames; ++frame) {
      // In force until its end; the last one for ever.
      const double end_s =
          1e-6 * static_cast<double>(in.start_utime + (frame + 1) * in.frame_duration_us - reach.utime);
      const bool last = frame + 1 == in.num_frames;
      const double way_m = reach.speed_mps * std::max(0.0, last ? reach.horizon_s : std::min(end_s, reach.horizon_s));
      for (int x = 0; x < in.geometry.size.x(); ++x) {
        for (int y = 0; y < in.geometry.size.y(); ++y) {
          const Eigen::Vector2d off =
              (in.geometry.center_of({x, y, 0}) - reach.center).head<2>().cwiseAbs().array() - 0.05;  // nearest edge
          const bool reached = (last || end_s >= 0.0) && off.maxCoeff() <= way_m;
          for (int w = 0; w < in.geometry.words_per_column(); ++w) {
            const std::uint64_t a = whole.column(frame, x, y)[w], b = part.column(frame, x, y)[w];
            const std::uint64_t expected = reached ? a : off.maxCoeff() > way_m + 0.2 ? 0 : b;
            ASSERT_EQ(b, expected) << "trial " << trial << " frame " << frame << " column " << x << " " << y;
            ASSERT_EQ(b & ~a, 0u);
            kept += b != 0;
            dropped += a != b;
          }
        }
      }
    }
  }
  EXPECT_GT(kept, 1000);
  EXPECT_GT(dropped, 1000);
}

TEST(Dilation, RefusesSenselessRadii) {
  Sogm in, out;
  in.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {2, 2, 2}}, 1, 0, 1);
  EXPECT_THROW(dilate(in, -0.1, &out), std::invalid_argument);
  EXPECT_THROW(dilate(in, std::nan(""), &out), std::invalid_argument);
}

TEST(Sogm, FrameAtClampsToFirstAndLast) {
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {1, 1, 1}}, 20, 5'000'000, 100'000);
  EXPECT_EQ(sogm.frame_at(0), 0);
  EXPECT_EQ(sogm.frame_at(5'000'000), 0);
  EXPECT_EQ(sogm.frame_at(5'099'999), 0);
  EXPECT_EQ(sogm.frame_at(5'100'000), 1);
  EXPECT_EQ(sogm.frame_at(6'999'999), 19);
  EXPECT_EQ(sogm.frame_at(7'000'000), 19);
  EXPECT_EQ(sogm.frame_at(60'000'000), 19);
}

TEST(Sogm, ResetClearsAndKeepsTheAllocation) {
  std::mt19937 rng(7);
  Sogm sogm = random_sogm({10, 9, 70}, 4, 0.5, 0.1, &rng);
  const std::uint64_t* before = sogm.words.data();
  sogm.reset({.resolution_m = 0.2, .origin = {1, 2, 3}, .size = {5, 9, 64}}, 3, 42, 7);
  EXPECT_EQ(sogm.words.data(), before);
  EXPECT_EQ(sogm.words, std::vector<std::uint64_t>(3u * 5 * 9, 0));
  EXPECT_FALSE(sogm.occupied(0, {-1, 0, 0}));
  EXPECT_FALSE(sogm.occupied(2, {4, 8, 64}));
}

TEST(Sogm, VoxelsLieOnTheWorldLattice) {
  const GridGeometry g{.resolution_m = 0.1, .origin = {-50, 20, -3}, .size = {100, 100, 40}};
  for (const Eigen::Vector3i& v : {Eigen::Vector3i(0, 0, 0), Eigen::Vector3i(99, 7, 39), Eigen::Vector3i(50, 50, 3)}) {
    EXPECT_EQ(g.voxel_of(g.center_of(v)), v);
    EXPECT_EQ(g.voxel_of(g.center_of(v) + Eigen::Vector3d::Constant(0.049)), v);
    EXPECT_EQ(g.voxel_of(g.center_of(v) - Eigen::Vector3d::Constant(0.049)), v);
  }
  EXPECT_FALSE(g.contains(g.voxel_of({-5.01, 3, 1})));
}

}  // namespace
}  // namespace swarm
