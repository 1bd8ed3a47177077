// What becomes of obstacles that are seen badly: noise, gaps, turns, ids that jump, velocities that nobody measured.
#include "map_daemon/tracker.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/start_time.h"

namespace swarm {
namespace {

using sogm_swarm::obstacle_t;
using sogm_swarm::obstacles_t;

const Eigen::Vector3d kRest = Eigen::Vector3d::Zero();

obstacle_t column(int id, const Eigen::Vector3d& position, const Eigen::Vector3d& velocity, float position_sigma = 0.0f,
                  float velocity_sigma = 0.0f) {
  obstacle_t message{};
  message.id = id;
  message.shape = obstacle_t::kColumn;
  message.size[0] = 0.5, message.size[1] = 2.0;
  Eigen::Map<Eigen::Vector3d>(message.position) = position;
  Eigen::Map<Eigen::Vector3d>(message.velocity) = velocity;
  message.position_sigma = position_sigma;
  message.velocity_sigma = velocity_sigma;
  return message;
}

obstacles_t report(Duration at, std::vector<obstacle_t> obstacles, bool complete = false) {
  obstacles_t message{};
  message.header.utime = to_us(kStart + at);
  message.complete = complete;
  message.num_obstacles = static_cast<std::int32_t>(obstacles.size());
  message.obstacles = std::move(obstacles);
  return message;
}

TEST(Tracker, WhatIsExactIsTakenAsItIs) {
  Tracker tracker({});
  tracker.update(report(0ms, {column(7, {1, 2, 1}, {0.3, -0.1, 0})}));
  auto turned = column(7, {1.0151, 1.9949, 1}, {-0.3, 0.7, 0});
  turned.age_s = 0.02;
  tracker.update(report(50ms, {turned}));
  ASSERT_EQ(tracker.tracks().size(), 1u);
  const Track& track = tracker.tracks()[0];
  EXPECT_EQ(track.obstacle.position, Eigen::Vector3d(1.0151, 1.9949, 1));
  EXPECT_EQ(track.obstacle.velocity, Eigen::Vector3d(-0.3, 0.7, 0));
  EXPECT_EQ(track.obstacle.utime, kStart + 30ms);
  EXPECT_EQ(position_sigma_m(track, kStart + 500ms), 0.0);
  EXPECT_EQ(velocity_sigma_mps(track), 0.0);
}

TEST(Tracker, WhatIsMissingIsGoneWhereNothingElseIsThere) {
  Tracker tracker({});
  for (const Duration at : {0ms, 500ms})
    tracker.update(report(at, {column(1, {0, 0, 1}, kRest), column(2, {3, 0, 1}, kRest)}));
  tracker.update(report(550ms, {column(2, {3, 0, 1}, kRest)}, true));
  ASSERT_EQ(tracker.tracks().size(), 1u);
  EXPECT_EQ(tracker.tracks()[0].id, 2);
  tracker.update(report(600ms, {}, true));
  EXPECT_TRUE(tracker.tracks().empty());
}

// As long as it was seen, or nearly so, and no longer than the timeout: what was there once may be nothing.
TEST(Tracker, WhatIsNotSeenGoesOn) {
  Tracker tracker({.timeout_s = 1.0});
  for (int k = 0; k < 20; ++k) tracker.update(report(k * 50ms, {column(1, {0.05 * k, 0, 1}, {1, 0, 0})}));
  tracker.update(report(1000ms, {column(2, {5, 5, 1}, kRest)}));  // once
  EXPECT_EQ(tracker.tracks().size(), 2u);
  tracker.update(report(1100ms, {}));
  EXPECT_EQ(tracker.tracks().size(), 2u);
  tracker.update(report(1150ms, {}));
  ASSERT_EQ(tracker.tracks().size(), 1u);
  EXPECT_EQ(tracker.tracks()[0].id, 1);
  EXPECT_DOUBLE_EQ(tracker.tracks()[0].obstacle.position.x(), 0.95);  // as of then
  tracker.update(report(1950ms, {}));
  EXPECT_EQ(tracker.tracks().size(), 1u);
  tracker.update(report(1951ms, {}));
  EXPECT_TRUE(tracker.tracks().empty());
}

TEST(Tracker, SilenceIsForgottenAfterTheTimeout) {
  Tracker tracker({.timeout_s = 0.5});
  tracker.update(report(0ms, {column(1, {0, 0, 1}, kRest)}));
  tracker.forget(kStart + 500ms, 100ms);
  EXPECT_EQ(tracker.tracks().size(), 1u);
  tracker.shift(-1s);
  EXPECT_EQ(tracker.tracks()[0].obstacle.utime, kStart - 1s);
  tracker.forget(kStart - 500ms, 100ms);
  EXPECT_EQ(tracker.tracks().size(), 1u);
  tracker.forget(kStart - 499ms, 100ms);
  EXPECT_TRUE(tracker.tracks().empty());
}

// Errors shrink, and the filter knows how large they are.
TEST(Tracker, NoiseIsFiltered) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  double seen2 = 0.0, estimated2 = 0.0, speed2 = 0.0, of_sigma2 = 0.0, of_speed_sigma2 = 0.0;
  int count = 0;
  for (int flight = 0; flight < 50; ++flight) {
    Tracker tracker({});
    for (int k = 0; k < 60; ++k) {
      const Eigen::Vector3d truth(0.03 * k, 1.0, 1.0), noise(normal(random), normal(random), normal(random));
      const Eigen::Vector3d speed_noise(normal(random), normal(random), normal(random));
      const Eigen::Vector3d velocity = Eigen::Vector3d(0.6, 0, 0) + 0.2 * speed_noise;
      tracker.update(report(k * 50ms, {column(3, truth + 0.05 * noise, velocity, 0.05f, 0.2f)}));
      if (k < 20) continue;
      ASSERT_EQ(tracker.tracks().size(), 1u);
      const Track& track = tracker.tracks()[0];
      const double sigma = position_sigma_m(track, track.obstacle.utime), speed_sigma = velocity_sigma_mps(track);
      seen2 += (0.05 * noise).squaredNorm();
      estimated2 += (track.obstacle.position - truth).squaredNorm();
      speed2 += (track.obstacle.velocity - Eigen::Vector3d(0.6, 0, 0)).squaredNorm();
      of_sigma2 += (track.obstacle.position - truth).squaredNorm() / (3 * sigma * sigma);
      of_speed_sigma2 +=
          (track.obstacle.velocity - Eigen::Vector3d(0.6, 0, 0)).squaredNorm() / (3 * speed_sigma * speed_sigma);
      ++count;
    }
  }
  EXPECT_LT(estimated2, 0.5 * seen2);
  EXPECT_LT(std::sqrt(speed2 / count / 3), 0.12);
  EXPECT_LT(of_sigma2 / count, 1.2);  // obstacles that accelerate would make it 1
  EXPECT_GT(of_sigma2 / count, 0.3);
  EXPECT_LT(of_speed_sigma2 / count, 1.2);
}

// Ten obstacles for five seconds, seen every 50 ms as badly as `position_sigma` and `velocity_sigma` (below 0: not
// measured) say: what their tracks take their accelerations for never exceeds `high_mps2`, and reaches `low_mps2`.
void expect_learned(double low_mps2, double high_mps2, double acceleration_mps2, float position_sigma,
                    float velocity_sigma) {
  SCOPED_TRACE(testing::Message() << acceleration_mps2 << " m/s^2, velocity sigma " << velocity_sigma);
  constexpr double kRate_radps = 1.5;  // each goes round a circle, on top of a uniform motion
  std::mt19937 random(9);
  std::normal_distribution<double> normal;
  const auto noise = [&] { return Eigen::Vector3d(normal(random), normal(random), normal(random)); };
  for (int id = 0; id < 10; ++id) {
    Tracker tracker({});
    double learned = 0.0;
    for (int k = 0; k < 100; ++k) {
      const double angle = kRate_radps * 0.05 * k + id;
      const Eigen::Vector3d out(std::cos(angle), std::sin(angle), 0), along(-std::sin(angle), std::cos(angle), 0);
      const Eigen::Vector3d center(0.03 * k, id, 1), drift(0.6, 0, 0);
      const Eigen::Vector3d place = center + acceleration_mps2 / kRate_radps / kRate_radps * out;
      const Eigen::Vector3d velocity = drift + acceleration_mps2 / kRate_radps * along;
      tracker.update(report(
          k * 50ms, {column(id, place + position_sigma * noise(), velocity + std::max(velocity_sigma, 0.0f) * noise(),
                            position_sigma, velocity_sigma)}));
      learned = tracker.tracks().at(0).obstacle.acceleration_mps2;
      ASSERT_LE(learned, high_mps2) << "obstacle " << id << " after " << 0.05 * k << " s";
    }
    EXPECT_GE(learned, low_mps2);
  }
}

TEST(Tracker, AccelerationsAreToldFromNoise) {
  expect_learned(0.0, 0.4, 0.0, 0.05f, 0.2f);
  expect_learned(0.7, 1.4, 1.0, 0.05f, 0.2f);
  expect_learned(1.4, 2.7, 2.0, 0.05f, 0.2f);
  expect_learned(0.0, 0.7, 0.0, 0.05f, -1.0f);
  expect_learned(0.4, 1.4, 1.0, 0.05f, -1.0f);
}

TEST(Tracker, WhatIsSeenExactlyIsTakenNotToAccelerate) {
  expect_learned(0.0, 0.0, 1.0, 0.0f, 0.0f);
}

// It flies straight, the clock is set back by an hour, it speeds up, and then it is seen exactly.
TEST(Tracker, AccelerationsAreLearnedWhateverTheClockDoes) {
  Tracker tracker({});
  const auto learned = [&] { return tracker.tracks().at(0).obstacle.acceleration_mps2; };
  const auto see = [&](int k, Duration clock, float sigma) {
    const double t_s = 0.05 * std::max(k - 40, 0);
    tracker.update(report(k * 50ms + clock, {column(1, {t_s * t_s / 2, 0, 1}, {t_s, 0, 0}, sigma, sigma)}));
  };
  for (int k = 0; k <= 40; ++k) see(k, 0ms, 0.1f);
  EXPECT_EQ(learned(), 0.0);
  tracker.shift(-1h);
  for (int k = 41; k < 80; ++k) see(k, -1h, 0.1f);
  EXPECT_GT(learned(), 0.7);
  see(80, -1h, 0.0f);
  EXPECT_EQ(learned(), 0.0);
}

TEST(Tracker, ATurnIsNoAcceleration) {
  Tracker tracker({});
  for (int k = 0; k < 60; ++k) {
    const bool has_turned = k >= 30;
    const Eigen::Vector3d place(has_turned ? 1.5 - 0.05 * (k - 30) : 0.05 * k, 0, 1);
    tracker.update(report(k * 50ms, {column(1, place, {has_turned ? -1.0 : 1.0, 0, 0}, 0.05f, 0.2f)}));
    EXPECT_EQ(tracker.tracks().at(0).obstacle.acceleration_mps2, 0.0) << k;
  }
}

TEST(Tracker, ATurnIsBelievedAtOnce) {
  Tracker tracker({});
  for (int k = 0; k < 20; ++k) tracker.update(report(k * 50ms, {column(1, {0.05 * k, 0, 1}, {1, 0, 0}, 0.05f, 0.1f)}));
  tracker.update(report(1000ms, {column(1, {0.95, 0, 1}, {-1, 0, 0}, 0.05f, 0.1f)}));
  ASSERT_EQ(tracker.tracks().size(), 1u);
  EXPECT_EQ(tracker.tracks()[0].obstacle.velocity.x(), -1.0);
  EXPECT_NEAR(velocity_sigma_mps(tracker.tracks()[0]), 0.1, 1e-6);
}

TEST(Tracker, AVelocityThatNobodyMeasuresIsFound) {
  std::mt19937 random(6);
  std::normal_distribution<double> normal;
  Tracker tracker({});
  for (int k = 0; k < 40; ++k) {
    const Eigen::Vector3d noise(normal(random), normal(random), normal(random));
    const Eigen::Vector3d position = Eigen::Vector3d(0.05 * k, -0.025 * k, 1.0) + 0.02 * noise;
    tracker.update(report(k * 50ms, {column(1, position, {50, 50, 50}, 0.02f, -1.0f)}));
    if (k == 0) {
      EXPECT_EQ(tracker.tracks()[0].obstacle.velocity.norm(), 0.0);
      EXPECT_GE(velocity_sigma_mps(tracker.tracks()[0]), 0.5);
    }
  }
  ASSERT_EQ(tracker.tracks().size(), 1u);
  EXPECT_LT((tracker.tracks()[0].obstacle.velocity - Eigen::Vector3d(1, -0.5, 0)).norm(), 0.35);
  EXPECT_LT(velocity_sigma_mps(tracker.tracks()[0]), 0.25);
}

// A tracker that loses an obstacle and finds it again under another id: one obstacle, whose velocity is still known.
TEST(Tracker, AnIdThatJumpsIsTheSameObstacle) {
  Tracker tracker({});
  const auto seen = [](int id, int k) { return column(id, {0.05 * k, 0, 1}, kRest, 0.02f, -1.0f); };
  for (int k = 0; k < 40; ++k)
    tracker.update(report(k * 50ms, {seen(1, k), column(9, {0, 4, 1}, kRest, 0.02f, -1.0f)}));
  const double speed = tracker.tracks()[0].obstacle.velocity.x();
  EXPECT_NEAR(speed, 1.0, 0.1);
  tracker.update(report(2000ms, {seen(5, 40), column(9, {0, 4, 1}, kRest, 0.02f, -1.0f)}));
  ASSERT_EQ(tracker.tracks().size(), 2u);
  EXPECT_EQ(tracker.tracks()[0].id, 5);
  EXPECT_NEAR(tracker.tracks()[0].obstacle.velocity.x(), speed, 0.1);
  auto other = seen(6, 41);
  other.size[0] = 3.0;  // something else
  tracker.update(report(2050ms, {other, column(9, {0, 4, 1}, kRest, 0.02f, -1.0f)}));
  EXPECT_EQ(tracker.tracks().size(), 3u);
}

TEST(Tracker, NothingIsLostWhereIdsAreNotUnique) {
  Tracker tracker({});
  for (const Duration at : {0ms, 50ms})
    tracker.update(
        report(at, {column(0, {0, 0, 1}, kRest), column(0, {3, 0, 1}, kRest), column(0, {6, 0, 1}, kRest)}, true));
  EXPECT_EQ(tracker.tracks().size(), 3u);
}

TEST(Tracker, AReportThatDoesNotKnowItsAgeIsAsOldAsItWasSaid) {
  Tracker tracker({.latency_s = 0.08});
  auto knows = column(2, {3, 0, 1}, kRest);
  knows.age_s = 0.03;
  tracker.update(report(1000ms, {column(1, {0, 0, 1}, kRest), knows}));
  ASSERT_EQ(tracker.tracks().size(), 2u);
  EXPECT_EQ(tracker.tracks()[0].obstacle.utime, kStart + 920ms);
  EXPECT_EQ(tracker.tracks()[1].obstacle.utime, kStart + 970ms);
}

}  // namespace
}  // namespace swarm
