#include "tools/bridge/ned_frame.h"

#include <gtest/gtest.h>

#include "tests/support/random_motion.h"

namespace swarm {
namespace {

TEST(NedFrame, IsRightHandedAndComesBack) {
  Rng rng(1);
  for (int i = 0; i < 1000; ++i) {
    const NedFrame frame(uniform(rng, -6.3, 6.3), in_cube(rng, 100));
    const Eigen::Vector3d a = in_cube(rng, 10), b = in_cube(rng, 10);
    EXPECT_LT((frame.position_to_world(frame.position_to_ned(a)) - a).norm(), 1e-12);
    EXPECT_LT((frame.to_world(frame.to_ned(a)) - a).norm(), 1e-13);
    EXPECT_LT((frame.to_ned(a).cross(frame.to_ned(b)) - frame.to_ned(a.cross(b))).norm(), 1e-12);
    EXPECT_LT((frame.position_to_ned(a) - frame.position_to_ned(b) - frame.to_ned(a - b)).norm(), 1e-12);
    EXPECT_DOUBLE_EQ(frame.to_ned(a).z(), -a.z());
    // A robot that flies where it looks does so in both frames.
    const double yaw = uniform(rng, -std::numbers::pi, std::numbers::pi), ned_yaw = frame.yaw(yaw);
    const Eigen::Vector3d ahead(std::cos(yaw), std::sin(yaw), 0);
    EXPECT_LT((frame.to_ned(ahead) - Eigen::Vector3d(std::cos(ned_yaw), std::sin(ned_yaw), 0)).norm(), 1e-12);
    EXPECT_LE(std::abs(ned_yaw), std::numbers::pi);
    EXPECT_NEAR(std::remainder(frame.yaw(ned_yaw) - yaw, 2 * std::numbers::pi), 0.0, 1e-12);
  }
  const NedFrame plain(0, {0, 0, 0});
  EXPECT_EQ(plain.position_to_ned({1, 2, 3}), Eigen::Vector3d(1, -2, -3));
  EXPECT_EQ(plain.yaw(0.5), -0.5);
  // North along W's y axis: W is east, north, up, with its zero two metres above the controller's.
  const NedFrame enu(std::numbers::pi / 2, {0, 0, -2});
  EXPECT_LT((enu.position_to_ned({1, 2, 3}) - Eigen::Vector3d(2, 1, -5)).norm(), 1e-12);
  EXPECT_NEAR(enu.yaw(0), std::numbers::pi / 2, 1e-12);  // looking east
}

}  // namespace
}  // namespace swarm
