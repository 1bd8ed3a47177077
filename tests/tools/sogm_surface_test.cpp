// The surface of a map equals what is found voxel by voxel, and is quick.
#include "tools/logs/sogm_surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <tuple>

#include "lcmtypes/bus/node_clock.h"
#include "tests/support/random_map.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

const Eigen::Vector3i kNeighbours[] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};

// Voxel by voxel.
std::vector<SurfaceVoxel> naive_surface(const Sogm& sogm, int frame) {
  const int first = frame == kAllFrames ? 0 : frame, last = frame == kAllFrames ? sogm.num_frames - 1 : frame;
  const auto first_frame = [&](const Eigen::Vector3i& voxel) {
    for (int i = first; i <= last; ++i) {
      if (sogm.occupied(i, voxel)) return i;
    }
    return -1;
  };
  std::vector<SurfaceVoxel> surface;
  for_each_column(sogm.geometry, [&](int x, int y) {
    for (int z = 0; z < sogm.geometry.size.z(); ++z) {
      const int begins = first_frame({x, y, z});
      if (begins < 0 || std::ranges::all_of(kNeighbours, [&](const Eigen::Vector3i& step) {
            return first_frame(Eigen::Vector3i(x, y, z) + step) >= 0;
          }))
        continue;
      surface.push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y), static_cast<std::int16_t>(z),
                         static_cast<std::int16_t>(begins)});
    }
  });
  return surface;
}

std::vector<SurfaceVoxel> sorted(std::vector<SurfaceVoxel> voxels) {
  std::ranges::sort(voxels, {}, [](const SurfaceVoxel& v) { return std::tuple(v.x, v.y, v.z); });
  return voxels;
}

void expect_as_naive(const Sogm& sogm, int frame) {
  std::vector<SurfaceVoxel> surface = {{9, 9, 9, 9}};
  sogm_surface(sogm, frame, &surface);
  EXPECT_TRUE(std::ranges::is_sorted(surface, {}, [](const SurfaceVoxel& v) { return std::pair(v.x, v.y); }));
  ASSERT_TRUE(sorted(surface) == naive_surface(sogm, frame)) << "frame " << frame;
}

TEST(SogmSurface, EqualsWhatIsFoundVoxelByVoxel) {
  Rng rng(5);
  for (int trial = 0; trial < 40; ++trial) {
    SCOPED_TRACE(trial);
    const Eigen::Vector3i size(uniform_int(rng, 1, 9), uniform_int(rng, 1, 9), uniform_int(rng, 1, 150));
    const Sogm sogm = random_bits(size, uniform_int(rng, 1, 6), trial % 2 == 0 ? 0.3 : 0.9, 0.1, rng);
    for (int frame = kAllFrames; frame < sogm.num_frames; ++frame) expect_as_naive(sogm, frame);
  }
  for (int trial = 0; trial < 3; ++trial) {
    const Sogm sogm = random_map(rng, 12, {4, 3, 2}, 8, kStart, 100ms);
    for (const int frame : {kAllFrames, 0, 7}) expect_as_naive(sogm, frame);
  }
}

TEST(SogmSurface, FullWindowsShowTheirRimOnly) {
  Rng rng(6);
  const Sogm sogm = random_bits({5, 6, 70}, 1, 1.0, 0.1, rng);
  std::vector<SurfaceVoxel> surface;
  sogm_surface(sogm, 0, &surface);
  EXPECT_EQ(surface.size(), 5u * 6 * 70 - 3u * 4 * 68);
}

TEST(SogmSurface, FramesThatAreNotThereHaveNone) {
  Rng rng(7);
  const Sogm sogm = random_bits({3, 3, 3}, 2, 1.0, 0.1, rng);
  std::vector<SurfaceVoxel> surface;
  for (const int frame : {-2, 2, 1000}) {
    surface.resize(4);
    sogm_surface(sogm, frame, &surface);
    EXPECT_TRUE(surface.empty());
  }
  sogm_surface(Sogm{}, kAllFrames, &surface);
  EXPECT_TRUE(surface.empty());
}

TEST(SogmSurface, TakesFarLessThanTheTimeBetweenMaps) {
  Rng rng(8);
  const Sogm sogm = random_map(rng, 40, {10, 10, 4}, 20, kStart, 100ms);
  std::vector<SurfaceVoxel> surface;
  double least_ms = 1e9;
  for (int i = 0; i < 20; ++i) {
    const std::chrono::nanoseconds begun = stopwatch();
    sogm_surface(sogm, kAllFrames, &surface);
    least_ms = std::min(least_ms, to_ms(stopwatch() - begun));
  }
  RecordProperty("least_ms", std::to_string(least_ms));
  EXPECT_GT(surface.size(), 1000u);
  EXPECT_LT(least_ms, 50.0);
}

}  // namespace
}  // namespace swarm
