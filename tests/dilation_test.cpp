// Exactness of the dilation against brute force.
#include "map_daemon/dilation.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/random_map.h"
#include "tests/random_reach.h"

namespace swarm {
namespace {

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
  Rng rng(20240601);
  Dilator dilator;
  Sogm out, expected;
  const Eigen::Vector3i sizes[] = {{1, 1, 1},   {9, 13, 7},  {13, 5, 64}, {6, 11, 65},
                                   {4, 7, 131}, {17, 2, 40}, {2, 3, 128}};
  for (const Eigen::Vector3i& size : sizes) {
    for (double density : {0.0, 0.002, 0.03}) {
      for (double resolution_m : {0.1, 0.15, 0.08}) {
        const Sogm in = random_bits(size, 2, density, resolution_m, rng);
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

// As without a reach in the columns that are reached; the others are clear, whatever the Dilator held before.
TEST(Dilation, ReachLimitsTheWorkAndNothingElse) {
  Rng rng(7);
  int kept = 0, dropped = 0;
  Dilator dilator;
  Sogm whole;
  for (int trial = 0; trial < 60; ++trial) {
    const Sogm in = random_bits({24, 17, trial / 20 == 1 ? 70 : 9}, 5, 0.01, 0.1, rng);
    const Reach reach = random_reach(rng, in);
    const double linger_s = trial % 3 == 0 ? uniform(rng, 0.0, 0.3) : 0.0;
    dilate(in, 0.25, &whole);
    const Sogm& part = dilator.dilate(in, 0.25, &reach, linger_s);
    for (int frame = 0; frame < in.num_frames; ++frame) {
      const Columns columns = reached(in, frame, reach, linger_s);
      for_each_column(in.geometry, [&](int x, int y) {
        for (int w = 0; w < in.geometry.words_per_column(); ++w) {
          const std::uint64_t a = whole.column(frame, x, y)[w], b = part.column(frame, x, y)[w];
          EXPECT_EQ(b, holds(columns, x, y) ? a : 0)
              << "trial " << trial << " frame " << frame << ": " << x << ' ' << y;
          kept += b != 0;
          dropped += a != b;
        }
      });
      ASSERT_FALSE(HasFailure());
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

}  // namespace
}  // namespace swarm
