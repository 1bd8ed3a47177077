// Robots are masked where what they announced says that they are at the time of a scan.
#include "map_daemon/perception/peer_mask.h"

#include <gtest/gtest.h>

#include "tests/support/quintic_to.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using sogm_swarm::announcement_t;

announcement_t announcement_of(int robot, const Motion& motion, float radius = 0.25f) {
  announcement_t message{};
  message.header.robot_id = static_cast<std::int16_t>(robot);
  message.radius = radius;
  message.committed = motion.committed.to_wire();
  message.pending = motion.next.to_wire();
  message.pending_state = motion.next.empty() ? announcement_t::kNone : announcement_t::kCommitted;
  return message;
}

// Before it begins, on its way, where it goes over to what is committed next, and long after it has ended.
void expect_at(PeerMask& mask, const Motion& motion, Duration clock) {
  for (Duration t = -500ms; t < 6s; t += 37ms) {
    const std::vector<PeerMask::Ball>& balls = mask.at(kStart + clock + t);
    ASSERT_EQ(balls.size(), 1u);
    ASSERT_EQ(balls[0].center, motion.at(kStart + t).position) << to_seconds(t) << " s after its start";
    ASSERT_NEAR(balls[0].radius_m, 0.35, 1e-6);
  }
}

TEST(PeerMask, RobotsAreWhereTheirTrajectoriesSay) {
  Rng rng(1);
  int with_next = 0;
  for (int i = 0; i < 50; ++i) {
    const Motion motion = random_motion(rng, kStart, 20.0);
    SCOPED_TRACE(testing::Message() << motion);
    PeerMask mask(0.1, 1h);
    EXPECT_TRUE(mask.at(kStart).empty());
    mask.hear(announcement_of(3, random_motion(rng, kStart, 20.0)), kStart);  // until it says something else
    mask.hear(announcement_of(3, motion), kStart);
    expect_at(mask, motion, 0s);
    with_next += motion.next.empty() ? 0 : 1;
  }
  EXPECT_GT(with_next, 10);
}

// What it would like to fly, and may not yet.
TEST(PeerMask, WhatIsOnlyAnnouncedIsNotFlown) {
  Rng rng(2);
  Motion motion = random_motion(rng, kStart, 20.0);
  motion.next = random_trajectory(rng, 7, kStart + 200ms, motion.committed.at(kStart + 200ms), 20.0);
  announcement_t message = announcement_of(3, motion);
  message.pending_state = announcement_t::kAnnounced;
  PeerMask mask(0.1, 1h);
  mask.hear(message, kStart);
  motion.next = {};
  expect_at(mask, motion, 0s);
}

// As soon as a robot flies what was next, it announces that alone; scans that come then are of a moment ago.
TEST(PeerMask, WhatBeganSinceTheScanDoesNotHideWhereItWas) {
  MotionState fast;
  fast.velocity = {2, 0, 0};
  const Utime leaves = kStart + 500ms;
  Motion motion{test::quintic_to(fast, kStart, {3, 0, 0}, 2.5), {}};
  motion.next = test::quintic_to(motion.committed.at(leaves), leaves, {3, 2, 0}, 2.5, 5, 2);
  PeerMask mask(0.1, 1h);
  mask.hear(announcement_of(3, motion), kStart);
  mask.hear(announcement_of(3, {motion.next, {}}), leaves);
  for (const Duration t : {400ms, 499ms, 501ms, 600ms}) {
    const Eigen::Vector3d masked = mask.at(kStart + t).at(0).center, truth = motion.at(kStart + t).position;
    EXPECT_LT((masked - truth).norm(), 1e-6)
        << t.count() << " us: " << masked.transpose() << ", not " << truth.transpose();
  }
}

TEST(PeerMask, EachRobotIsForgottenAfterTheTimeout) {
  PeerMask mask(0.1, 500ms);
  const auto hear = [&](int robot, Duration at) {
    mask.hear(announcement_of(robot, {Trajectory::hover(1, kStart, {1.0 * robot, 0, 1}), {}},
                              0.1f * static_cast<float>(robot)),
              kStart + at);
  };
  hear(2, 0ms), hear(1, 300ms), hear(5, 100ms);
  ASSERT_EQ(mask.at(kStart + 500ms).size(), 3u);
  for (const auto& [i, robot] : {std::pair{0, 1}, {1, 2}, {2, 5}}) {
    const PeerMask::Ball& ball = mask.at(kStart + 500ms)[static_cast<std::size_t>(i)];
    EXPECT_EQ(ball.center, Eigen::Vector3d(robot, 0, 1));
    EXPECT_NEAR(ball.radius_m, 0.1 + 0.1 * robot, 1e-6);
  }
  EXPECT_EQ(mask.at(kStart + 501ms).size(), 2u);
  hear(5, 550ms);
  ASSERT_EQ(mask.at(kStart + 801ms).size(), 1u);
  EXPECT_EQ(mask.at(kStart + 801ms)[0].center.x(), 5.0);
  EXPECT_TRUE(mask.at(kStart + 1051ms).empty());
  hear(2, 2s);  // heard again
  EXPECT_EQ(mask.at(kStart + 2s).size(), 1u);
}

TEST(PeerMask, ClocksMayBeSet) {
  Rng rng(3);
  for (const Duration step : {Duration(-1h), Duration(1h)}) {
    SCOPED_TRACE(to_seconds(step));
    for (int i = 0; i < 20; ++i) {
      const Motion motion = random_motion(rng, kStart, 20.0);
      PeerMask mask(0.1, 7s);
      mask.hear(announcement_of(3, motion), kStart);
      mask.shift(step);
      expect_at(mask, motion, step);
      EXPECT_EQ(mask.at(kStart + step + 7s).size(), 1u);
      EXPECT_TRUE(mask.at(kStart + step + 7001ms).empty());
    }
  }
}

}  // namespace
}  // namespace swarm
