// Layout of the SOGM.
#include "map_daemon/sogm.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/random_map.h"

namespace swarm {
namespace {

TEST(Sogm, FrameAtClampsToFirstAndLast) {
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {1, 1, 1}}, 20, Utime(5s), 100ms);
  EXPECT_EQ(sogm.frame_at(Utime()), 0);
  EXPECT_EQ(sogm.frame_at(Utime(5s)), 0);
  EXPECT_EQ(sogm.frame_at(to_utime(5'099'999)), 0);
  EXPECT_EQ(sogm.frame_at(Utime(5100ms)), 1);
  EXPECT_EQ(sogm.frame_at(to_utime(6'999'999)), 19);
  EXPECT_EQ(sogm.frame_at(Utime(7s)), 19);
  EXPECT_EQ(sogm.frame_at(Utime(60s)), 19);
}

TEST(Sogm, ResetClearsAndKeepsTheAllocation) {
  Rng rng(7);
  Sogm sogm = random_bits({10, 9, 70}, 4, 0.5, 0.1, rng);
  const std::uint64_t* before = sogm.words().data();
  sogm.reset({.resolution_m = 0.2, .origin = {1, 2, 3}, .size = {5, 9, 64}}, 3, to_utime(42), 7us);
  EXPECT_EQ(sogm.words().data(), before);
  EXPECT_EQ(sogm.words(), std::vector<std::uint64_t>(3u * 5 * 9, 0));
  EXPECT_FALSE(sogm.occupied(0, {-1, 0, 0}));
  EXPECT_FALSE(sogm.occupied(2, {4, 8, 64}));
}

// However it is written to: what reset() does not clear would be there for ever.
TEST(Sogm, ResetLeavesNothingOfWhatWasWritten) {
  Rng rng(8);
  Sogm sogm;
  for (int trial = 0; trial < 300; ++trial) {
    const Eigen::Vector3i size(uniform_int(rng, 1, 20), uniform_int(rng, 1, 30),
                               uniform_int(rng, 0, 1) == 0 ? 40 : 130);
    const int frames = uniform_int(rng, 1, 4);
    for (int round = 0; round < 3; ++round) {
      SCOPED_TRACE(testing::Message() << "trial " << trial << ", round " << round << ", size " << size.transpose());
      sogm.reset({.resolution_m = 0.1, .origin = {trial, 0, 0}, .size = size}, frames, Utime(), 100ms);
      const auto frame_words = static_cast<std::size_t>(sogm.geometry.words_per_frame());
      ASSERT_EQ(sogm.words(), std::vector<std::uint64_t>(static_cast<std::size_t>(frames) * frame_words, 0));
      for (int i = uniform_int(rng, 0, 5); i > 0; --i) {
        const int frame = uniform_int(rng, 0, frames - 1);
        const Columns box = random_columns(rng, size.head<2>());
        sogm.column(frame, box.first.x(), box.first.y())[sogm.geometry.words_per_column() - 1] |= 1;
        *sogm.word(frame, static_cast<std::size_t>(uniform_int(rng, 0, static_cast<int>(frame_words) - 1))) |= 2;
        std::uint64_t* const corner = sogm.columns(frame, box);
        for (int x = box.first.x(); x <= box.last.x(); ++x)
          for (int y = box.first.y(); y <= box.last.y(); ++y)
            corner[sogm.geometry.words_per_column() * ((x - box.first.x()) * size.y() + y - box.first.y())] |= 4;
        if (frame + 1 < frames) sogm.repeat_before(frame + 1);
      }
      if (uniform_int(rng, 0, 9) == 0) std::ranges::fill(sogm.words_to_write(), 1);
    }
  }
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

TEST(Sogm, ColumnsGrowAsFarAsTheWindow) {
  const GridGeometry grid{.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {20, 30, 1}};
  const Columns grown = Columns{{1, 10}, {15, 27}}.grown(3, grid);
  EXPECT_EQ(grown.first, Eigen::Vector2i(0, 7));
  EXPECT_EQ(grown.last, Eigen::Vector2i(18, 29));
  EXPECT_TRUE(Columns{}.grown(3, grid).empty());
}

// Of that frame, and nothing above the window.
TEST(Sogm, TheComplementIsWhatIsNotSet) {
  Sogm sogm, rest;
  sogm.reset({.resolution_m = 0.1, .origin = {1, 2, 3}, .size = {3, 4, 70}}, 2, Utime(5us), 100ms);
  set_run(0, 69, 70, sogm.column(0, 1, 1));
  set_run(60, 66, 70, sogm.column(1, 2, 3));
  complement(sogm, 1, &rest);
  ASSERT_EQ(rest.num_frames, 1);
  EXPECT_EQ(rest.geometry, sogm.geometry);
  for (int x = 0; x < 3; ++x)
    for (int y = 0; y < 4; ++y)
      for (int z = 0; z < 70; ++z) EXPECT_NE(rest.occupied(0, {x, y, z}), sogm.occupied(1, {x, y, z})) << x << y << z;
  EXPECT_EQ(rest.column(0, 0, 0)[1], 0x3fu);
}

}  // namespace
}  // namespace swarm
