// What a robot reaches, against motions that keep its limits.
#include "planner_daemon/space/reachability.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/random_map.h"
#include "tests/support/random_reachable_set.h"

namespace swarm {
namespace {

// Bang-bang along each axis from the reach's start on; switches sign at random, or never for the outermost motions.
class Flight {
 public:
  Flight(const ReachableSet& reach, const Eigen::Vector2d& push, double switch_rate_hz, Rng& rng)
      : reach_(reach),
        push_(push),
        rate_hz_(switch_rate_hz),
        rng_(rng),
        at_(reach.center.head<2>()),
        velocity_(reach.velocity.head<2>()) {}

  Eigen::Vector2d at() const { return at_; }
  void step(double dt_s) {
    for (int axis = 0; axis < 2; ++axis) {
      if (uniform(rng_, 0, 1) < rate_hz_ * dt_s) push_[axis] = uniform(rng_, -1, 1);
      double& v = velocity_[axis];
      const double limit = std::max(reach_.speed_mps, std::abs(v)), before = v;
      v = std::isinf(reach_.acceleration_mps2)
              ? push_[axis] * reach_.speed_mps
              : std::clamp(v + push_[axis] * reach_.acceleration_mps2 * dt_s, -limit, limit);
      at_[axis] += (std::isinf(reach_.acceleration_mps2) ? v : (before + v) / 2) * dt_s;
    }
  }

 private:
  const ReachableSet& reach_;
  Eigen::Vector2d push_;
  double rate_hz_;
  Rng& rng_;
  Eigen::Vector2d at_, velocity_;
};

TEST(ReachTest, HoldsEveryMotionWithinTheLimitsAndLittleMore) {
  Rng rng(3);
  constexpr double kStep_s = 0.0005;
  int loose = 0, sides = 0;
  for (int trial = 0; trial < 200; ++trial) {
    Sogm sogm;
    sogm.reset({.resolution_m = 0.1, .origin = {-60, -60, 0}, .size = {120, 120, 1}}, 6, Utime(1s), 100ms);
    ReachableSet reach = random_reachable_set(rng, sogm);
    reach.center = in_cube(rng, 1.0);
    const double linger_s = trial % 2 == 0 ? 0.0 : uniform(rng, 0.0, 0.3);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << reach.speed_mps << " m/s, "
                                    << reach.acceleration_mps2 << " m/s2, velocity " << reach.velocity.transpose());
    std::array<Columns, 6> met;  // what some motion came to while the frame was in force or a little later
    for (int motion = 0; motion < 12; ++motion) {
      const Eigen::Vector2d push(motion % 2 == 0 ? 1 : -1, motion % 4 < 2 ? 1 : -1);
      Flight flight(reach, push, motion < 4 ? 0.0 : 3.0, rng);
      for (double t = 0.0; t <= reach.horizon_s; t += kStep_s, flight.step(kStep_s)) {
        const Eigen::Vector2i voxel = sogm.geometry.voxel_of({flight.at().x(), flight.at().y(), 0.05}).head<2>();
        for (int frame = 0; frame < sogm.num_frames; ++frame) {
          const double since_s = t + to_seconds(reach.utime - sogm.start_utime) - 0.1 * frame;
          const bool last = frame + 1 == sogm.num_frames;
          if (since_s < 0.0 || (!last && since_s > 0.1 + linger_s)) continue;
          const Columns columns = reachable_columns(sogm, frame, reach, linger_s);
          ASSERT_TRUE(holds(columns, voxel.x(), voxel.y())) << "frame " << frame << " at " << voxel.transpose();
          Columns& seen = met[static_cast<std::size_t>(frame)];
          seen = seen.empty() ? Columns{voxel, voxel} : Columns{seen.first.cwiseMin(voxel), seen.last.cwiseMax(voxel)};
        }
      }
    }
    for (int frame = 0; frame < sogm.num_frames; ++frame) {
      const Columns columns = reachable_columns(sogm, frame, reach, linger_s);
      const Columns& seen = met[static_cast<std::size_t>(frame)];
      if (seen.empty()) continue;
      for (int axis = 0; axis < 2; ++axis) {
        sides += 2;
        loose += seen.first[axis] - columns.first[axis] > 2;
        loose += columns.last[axis] - seen.last[axis] > 2;
      }
    }
  }
  EXPECT_GT(sides, 3000);
  EXPECT_LT(loose, sides / 50);
}

TEST(ReachTest, IsEmptyBeforeAndOutsideTheWindow) {
  Sogm sogm;
  sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {20, 20, 1}}, 3, Utime(1s), 100ms);
  ReachableSet reach{{1, 1, 0}, Utime(1150ms), 1.0, 1.0};
  EXPECT_TRUE(reachable_columns(sogm, 0, reach).empty());
  EXPECT_FALSE(reachable_columns(sogm, 0, reach, 0.06).empty());
  EXPECT_FALSE(reachable_columns(sogm, 1, reach).empty());
  reach.utime = Utime(9s);
  EXPECT_FALSE(reachable_columns(sogm, 2, reach).empty());  // in force for ever
  reach.center.x() = 4.0;
  EXPECT_TRUE(reachable_columns(sogm, 2, reach).empty());
}

}  // namespace
}  // namespace swarm
