// Exactness of the dilation against brute force.
#include "map_daemon/dilation.h"

#include <gtest/gtest.h>

#include <array>
#include <stdexcept>
#include <vector>

#include "tests/support/random_map.h"

namespace swarm {
namespace {

// The definition, with the radius given in tenths of a voxel so that the comparison is exact.
void brute_force(const Sogm& in, int radius_tenths, Sogm* out) {
  out->reset(in.geometry, in.num_frames, in.start_utime, in.frame_duration);
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
          dilator.dilate(in, radius_tenths * resolution_m / 10, &out);
          brute_force(in, radius_tenths, &expected);
          EXPECT_TRUE(out.words() == expected.words())
              << "size " << size.transpose() << " density " << density << " resolution " << resolution_m << " radius "
              << radius_tenths << "/10 voxels";
          EXPECT_EQ(out.geometry, in.geometry);
          EXPECT_EQ(out.start_utime, in.start_utime);
          EXPECT_EQ(out.frame_duration, in.frame_duration);
        }
      }
    }
  }
}

TEST(Dilation, RadiusOnTheLatticeIsInclusive) {
  Sogm in, out;
  in.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {9, 9, 9}}, 1, Utime(), 1us);
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
  in.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {5, 4, 70}}, 1, Utime(), 1us);
  in.column(0, 0, 0)[0] = 1;
  dilate(in, 1e6, &out);
  for (int x = 0; x < 5; ++x) {
    for (int y = 0; y < 4; ++y) {
      EXPECT_EQ(out.column(0, x, y)[0], ~std::uint64_t{0});
      EXPECT_EQ(out.column(0, x, y)[1], 0x3fu);
    }
  }
}

// Boxes of the union of whole frames and of parts of others; every stride-th column of it as well.
TEST(Dilation, BoxesAndSamplesOfSeveralLayersEqualTheWhole) {
  Rng rng(7);
  Dilator dilator;
  Sogm whole;
  int set = 0, sampled = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Eigen::Vector3i size(uniform_int(rng, 3, 30), uniform_int(rng, 3, 30),
                               std::array{9, 64, 70, 130}[static_cast<std::size_t>(trial % 4)]);
    const Sogm in = random_bits(size, 3, 0.01, 0.1, rng), patches = random_bits(size, 2, 0.05, 0.1, rng);
    const double radius_m = uniform(rng, 0.0, 0.45);
    const auto words = static_cast<std::size_t>(in.geometry.words_per_column());
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", size " << size.transpose() << ", " << radius_m << " m");
    std::vector<Layer> layers;
    Sogm all;
    all.reset(in.geometry, 1, Utime(), 1us);
    for (int frame = 0; frame < uniform_int(rng, 0, 3); ++frame) {
      layers.push_back(layer_of(in, frame));
      for (std::size_t i = 0; i < all.words().size(); ++i) all.words_to_write()[i] |= in.column(frame, 0, 0)[i];
    }
    for (int frame = 0; frame < uniform_int(rng, 0, 2); ++frame) {
      const Columns part = random_columns(rng, size.head<2>());
      Layer layer = layer_of(patches, frame);
      layer.columns = part;
      layer.words = patches.column(frame, part.first.x(), part.first.y());
      layers.push_back(layer);
      for_each_column(in.geometry, [&](int x, int y) {
        for (std::size_t w = 0; w < words && holds(part, x, y); ++w)
          all.column(0, x, y)[w] |= patches.column(frame, x, y)[w];
      });
    }
    dilate(all, radius_m, &whole);
    dilator.set(in.geometry, radius_m);

    const Columns columns = random_columns(rng, size.head<2>());
    const std::size_t row = static_cast<std::size_t>(columns.width()) * words + 3;
    constexpr std::uint64_t kUntouched = 0x5a5a;
    std::vector<std::uint64_t> out(row * static_cast<std::size_t>(columns.last.x() - columns.first.x() + 1),
                                   kUntouched);
    dilator.dilate(layers, columns, out.data(), row);
    for (std::size_t i = 0; i < out.size(); ++i) {
      const int x = columns.first.x() + static_cast<int>(i / row);
      const auto at = i % row;
      if (at < row - 3) {
        const int y = columns.first.y() + static_cast<int>(at / words);
        ASSERT_EQ(out[i], whole.column(0, x, y)[at % words]) << x << ' ' << y;
        set += out[i] != 0;
      } else {
        ASSERT_EQ(out[i], kUntouched) << "between the rows";
      }
    }

    const int stride = uniform_int(rng, 1, 4);
    const Eigen::Vector2i cells = (size.head<2>().array() - 1 - stride / 2) / stride + 1;
    if (cells.minCoeff() < 1 || size.head<2>().minCoeff() <= stride / 2) continue;
    const Columns some = random_columns(rng, cells);
    std::vector<std::uint64_t> samples(
        static_cast<std::size_t>((some.last.x() - some.first.x() + 1) * some.width()) * words, kUntouched);
    dilator.sample(layers, stride, some, samples.data(), static_cast<std::size_t>(some.width()) * words);
    const std::uint64_t* sample = samples.data();
    for (int x = some.first.x(); x <= some.last.x(); ++x) {
      for (int y = some.first.y(); y <= some.last.y(); ++y) {
        for (std::size_t w = 0; w < words; ++w, ++sample) {
          ASSERT_EQ(*sample, whole.column(0, stride * x + stride / 2, stride * y + stride / 2)[w])
              << "stride " << stride << ", cell " << x << ' ' << y;
          sampled += *sample != 0;
        }
      }
    }
  }
  EXPECT_GT(set, 5000);
  EXPECT_GT(sampled, 1000);
}

TEST(Dilation, RefusesSenselessRadii) {
  Sogm in, out;
  in.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {2, 2, 2}}, 1, Utime(), 1us);
  EXPECT_THROW(dilate(in, -0.1, &out), std::invalid_argument);
  EXPECT_THROW(dilate(in, std::nan(""), &out), std::invalid_argument);
}

}  // namespace
}  // namespace swarm
