// Circles through points of one side of a column: exact, noisy, few, and with points that are not of it.
#include "map_daemon/perception/round_fit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "tests/support/random_motion.h"

namespace swarm {
namespace {

constexpr double kRoundNoise_m = 0.02;
constexpr double kRightAngle = std::numbers::pi / 2;
const RadiusPrior kNothingKnown;

Eigen::Vector2d towards(double angle) {
  return {std::cos(angle), std::sin(angle)};
}

// A column, and a sensor that sees its side as far as so much to the left and right of the line between them.
struct Round {
  Eigen::Vector2d center, sensor;
  double radius_m, side, half;  // [rad]

  Round(Rng& rng, double radius, double away_m, double half_angle)
      : center(in_cube(rng, 10.0).head<2>()), radius_m(radius), side(uniform(rng, -3.2, 3.2)), half(half_angle) {
    sensor = center + away_m * towards(side);
  }
  // As much of it as is seen from there.
  Round(Rng& rng, double radius, double away_m) : Round(rng, radius, away_m, std::acos(radius / away_m)) {}

  // Where the ray meets it that is so far from the middle of what is seen, -1 to 1.
  Eigen::Vector2d way(double share) const {
    const double away_m = (center - sensor).norm();
    const double last = std::atan2(radius_m * std::sin(half), away_m - radius_m * std::cos(half));
    const double beside_m = away_m * std::sin(share * last);
    const double length_m =
        away_m * std::cos(share * last) - std::sqrt(std::max(radius_m * radius_m - beside_m * beside_m, 0.0));
    return -length_m * towards(side + share * last);
  }
  std::vector<Eigen::Vector2d> exact(int count) const {
    std::vector<Eigen::Vector2d> points;
    points.reserve(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i) points.push_back(sensor + way(2.0 * i / (count - 1) - 1.0));
    return points;
  }
  // By rays whose lengths err.
  std::vector<Eigen::Vector2d> noisy(Rng& rng, int count) const {
    std::normal_distribution<double> noise(0.0, kRoundNoise_m);
    std::vector<Eigen::Vector2d> points;
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector2d ray = way(uniform(rng, -1, 1));
      points.push_back(sensor + ray + noise(rng) * ray.normalized());
    }
    return points;
  }
  double error_m(const RoundFit& fit) const { return (fit.center - center).norm(); }
};

// Where nothing is known of the radius, it is taken for half the width that is seen until points say more: with an arc
// of 180 degrees it is.
TEST(RoundFit, ExactArcsAreFound) {
  Rng rng(1);
  for (const double radius_m : {0.1, 0.2, 0.4, 0.7}) {
    for (const double half : {0.4, 0.6, 0.8, 1.0, 1.2, 1.4, kRightAngle}) {
      for (const int count : {5, 30, 300}) {
        SCOPED_TRACE(testing::Message() << radius_m << " m, " << half << " rad to each side, " << count << " points");
        const Round round(rng, radius_m, 3.0, std::min(half, std::acos(radius_m / 3.0)));
        const RoundFit known = fit_round(round.exact(count), round.sensor, {radius_m, 50.0}, kRoundNoise_m);
        EXPECT_LT(round.error_m(known), 1e-3);
        EXPECT_NEAR(known.radius.radius_m, radius_m, 1e-3);
        EXPECT_TRUE(known.converged);
        EXPECT_EQ(known.on_circle, count);
        EXPECT_LT(known.rms_m, 3e-3);
        const RoundFit found = fit_round(round.exact(count), round.sensor, kNothingKnown, kRoundNoise_m);
        EXPECT_LT(round.error_m(found), 1.2 * radius_m * (1.0 - std::sin(round.half)) + 0.05 * radius_m);
        EXPECT_NEAR(found.radius.radius_m, radius_m, 1.0 * radius_m * (1.0 - std::sin(round.half)) + 0.05 * radius_m);
      }
    }
  }
}

// Within 4 standard deviations or little more, and on the whole about as far off as it says.
void expect_errors_as_said(double radius_m, double away_m, int count, const RadiusPrior& prior) {
  SCOPED_TRACE(testing::Message() << radius_m << " m, " << away_m << " m away, " << count << " points");
  Rng rng(2);
  constexpr int kSeeds = 200;
  double squares = 0.0, most = 0.0, rms_m = 0.0, on_circle = 0.0;
  int converged = 0;
  for (int seed = 0; seed < kSeeds; ++seed) {
    const Round round(rng, radius_m, away_m);
    const RoundFit fit = fit_round(round.noisy(rng, count), round.sensor, prior, kRoundNoise_m);
    const double error = round.error_m(fit) / fit.sigma_m;
    squares += error * error / kSeeds;
    most = std::max(most, error);
    rms_m += fit.rms_m / kSeeds;
    on_circle += 1.0 * fit.on_circle / count / kSeeds;
    converged += fit.converged ? 1 : 0;
  }
  EXPECT_LT(most, 4.5);
  EXPECT_LT(std::sqrt(squares), 1.6);
  EXPECT_GT(std::sqrt(squares), 0.25);                           // neighbouring points may err as one, here they do not
  EXPECT_NEAR(rms_m, 0.8 * kRoundNoise_m, 0.1 * kRoundNoise_m);  // less at its edges
  EXPECT_GT(on_circle, 0.99);
  EXPECT_GE(converged, 0.98 * kSeeds);
}

template <class Visit>
void for_each_sight(const Visit& visit) {
  for (const double radius_m : {0.1, 0.2, 0.4})
    for (const double away_m : {1.5, 3.0, 6.0})
      for (const int count : {60, 250}) visit(radius_m, away_m, count);
}

TEST(RoundFit, WhatIsKnownErrsAsMuchAsItSays) {
  for_each_sight([](double radius_m, double away_m, int count) {
    expect_errors_as_said(radius_m, away_m, count, {radius_m, 50.0});
  });
}

TEST(RoundFit, WhatIsNewErrsAsMuchAsItSays) {
  for_each_sight(
      [](double radius_m, double away_m, int count) { expect_errors_as_said(radius_m, away_m, count, kNothingKnown); });
}

TEST(RoundFit, AKnownRadiusMakesASmallArcPrecise) {
  Rng rng(3);
  double known2 = 0.0, unknown2 = 0.0;
  for (int seed = 0; seed < 100; ++seed) {
    const Round round(rng, 0.3, 3.0, 0.5);
    const std::vector<Eigen::Vector2d> points = round.noisy(rng, 100);
    const RoundFit known = fit_round(points, round.sensor, {0.3, 100.0}, kRoundNoise_m);
    const RoundFit unknown = fit_round(points, round.sensor, kNothingKnown, kRoundNoise_m);
    known2 += round.error_m(known) * round.error_m(known);
    unknown2 += round.error_m(unknown) * round.error_m(unknown);
    EXPECT_LT(round.error_m(known), 4.0 * known.sigma_m) << seed;
    EXPECT_LT(known.sigma_m, 0.02) << seed;
    EXPECT_GT(known.radius.weight, 100.0) << seed;
  }
  EXPECT_LT(std::sqrt(known2 / 100), 0.01);
  EXPECT_GT(std::sqrt(unknown2 / 100), 0.05);  // which is why
}

// From scan to scan, the more the more of the column is seen; but it stays correctable.
TEST(RoundFit, RadiiAreLearned) {
  Rng rng(4);
  for (const double radius_m : {0.1, 0.2, 0.4}) {
    SCOPED_TRACE(radius_m);
    RadiusPrior half_seen, seen;
    for (int k = 0; k < 300; ++k) {
      const Round part(rng, radius_m, 3.0, 1.0), round(rng, radius_m, 3.0);
      half_seen = fit_round(part.noisy(rng, 100), part.sensor, half_seen, kRoundNoise_m).radius;
      seen = fit_round(round.noisy(rng, 100), round.sensor, seen, kRoundNoise_m).radius;
      EXPECT_TRUE(k > 50 || seen.weight > half_seen.weight) << k;
    }
    EXPECT_NEAR(seen.radius_m, radius_m, 0.01);
    EXPECT_GT(seen.weight, 300.0);
    EXPECT_LE(seen.weight, 400.0);
    for (int k = 0; k < 300; ++k) {
      const Round other(rng, radius_m + 0.1, 3.0);
      seen = fit_round(other.noisy(rng, 100), other.sensor, seen, kRoundNoise_m).radius;
    }
    EXPECT_NEAR(seen.radius_m, radius_m + 0.1, 0.06);
  }
}

// Every tenth point is of something else, a hand's breadth away or further: behind it, beside it, or anywhere around.
std::vector<Eigen::Vector2d> with_strangers(Rng& rng, const Round& round, std::vector<Eigen::Vector2d> points,
                                            int where) {
  const double aside = uniform_int(rng, 0, 1) == 0 ? -kRightAngle : kRightAngle;
  for (std::size_t i = 0; i < points.size(); i += 10) {
    const double angle = where == 0 ? 2 * kRightAngle : where == 1 ? aside : uniform(rng, -3.2, 3.2);
    const double away_m = round.radius_m + uniform(rng, 0.3, 0.7);
    points[i] = round.center + away_m * towards(round.side + angle + uniform(rng, -0.3, 0.3));
  }
  return points;
}

TEST(RoundFit, StrangersDoNotPullWhatIsKnown) {
  Rng rng(5);
  for (int i = 0; i < 600; ++i) {
    SCOPED_TRACE(testing::Message() << "column " << i);
    const Round round(rng, uniform(rng, 0.1, 0.4), uniform(rng, 1.5, 5.0));
    const std::vector<Eigen::Vector2d> points = with_strangers(rng, round, round.noisy(rng, 100), i % 3);
    const RoundFit fit = fit_round(points, round.sensor, {round.radius_m, 50.0}, kRoundNoise_m);
    EXPECT_LT(round.error_m(fit), 4.0 * fit.sigma_m);
    EXPECT_NEAR(fit.on_circle, 90, 2);
  }
}

// Where nothing is known of the radius they may, but then the fit says so: it finds no circle, or one that many points
// are not on.
TEST(RoundFit, WhatIsNewIsNotPulledUnnoticed) {
  Rng rng(6);
  int pulled = 0;
  double most_m = 0.0;
  for (int i = 0; i < 600; ++i) {
    const Round round(rng, uniform(rng, 0.1, 0.4), uniform(rng, 1.5, 5.0));
    const std::vector<Eigen::Vector2d> points = with_strangers(rng, round, round.noisy(rng, 100), i % 3);
    const RoundFit fit = fit_round(points, round.sensor, kNothingKnown, kRoundNoise_m);
    if (!fit.converged || fit.on_circle < 80 || round.error_m(fit) < std::max(5.0 * fit.sigma_m, 0.1)) continue;
    ++pulled;
    most_m = std::max(most_m, round.error_m(fit));
  }
  EXPECT_LE(pulled, 18) << "by up to " << most_m << " m";
}

// Also where little of them is seen, or the radius was thought to be another.
TEST(RoundFit, CirclesAreBehindTheirPoints) {
  Rng rng(7);
  for (int i = 0; i < 1000; ++i) {
    const Round round(rng, uniform(rng, 0.08, 0.3), uniform(rng, 1.0, 5.0), uniform(rng, 0.6, 1.3));
    const RadiusPrior prior{uniform(rng, 0.1, 0.3), i % 2 == 0 ? 50.0 : 0.0};
    const RoundFit fit = fit_round(round.noisy(rng, 60), round.sensor, prior, kRoundNoise_m);
    const double behind_m = (fit.center - round.center).dot(-towards(round.side)) + round.radius_m;
    EXPECT_GT(behind_m, 0.3 * std::min(round.radius_m, fit.radius.radius_m)) << i;
  }
}

// Half a circle varies around a line by 0.3 of its radius.
TEST(RoundFit, ColumnsAreCurvedAndBoardsAreNot) {
  Rng rng(11);
  std::normal_distribution<double> noise(0.0, kRoundNoise_m);
  for (int i = 0; i < 300; ++i) {
    const Round round(rng, uniform(rng, 0.15, 0.4), uniform(rng, 1.5, 5.0));
    const std::vector<Eigen::Vector2d> points = round.noisy(rng, 80);
    EXPECT_GT(curvature(points, fit_round(points, round.sensor, kNothingKnown, kRoundNoise_m)), 2.5) << i;
    std::vector<Eigen::Vector2d> board;
    const Eigen::Vector2d along = towards(round.side + kRightAngle + uniform(rng, -0.4, 0.4));
    for (int k = 0; k < 80; ++k) {
      const Eigen::Vector2d at = round.center + uniform(rng, -0.5, 0.5) * along;
      board.push_back(at + noise(rng) * (at - round.sensor).normalized());
    }
    EXPECT_LT(curvature(board, fit_round(board, round.sensor, kNothingKnown, kRoundNoise_m)), 1.5) << i;
  }
}

// Every third point is of a second column, which touches the first, or of a wall behind it, or anywhere around.
TEST(FindRound, FindsTheColumnThatMostPointsLieOn) {
  Rng rng(8);
  constexpr int kColumns = 300;
  int found = 0;
  for (int i = 0; i < kColumns; ++i) {
    const Round round(rng, uniform(rng, 0.15, 0.35), uniform(rng, 1.5, 5.0));
    std::vector<Eigen::Vector2d> points = round.noisy(rng, 120);
    const Eigen::Vector2d ahead = -towards(round.side), aside(-ahead.y(), ahead.x());
    Round beside = round;
    beside.center += 2.0 * round.radius_m * aside;
    const std::vector<Eigen::Vector2d> other = beside.noisy(rng, 120);
    for (std::size_t k = 0; k < points.size(); k += 3) {
      const Eigen::Vector2d wall = round.center + (round.radius_m + 0.1) * ahead + uniform(rng, -0.6, 0.6) * aside;
      points[k] = i % 3 == 0 ? other[k] : i % 3 == 1 ? wall : round.center + in_cube(rng, 0.8).head<2>();
    }
    const std::optional<RoundFit> fit = find_round(points, round.sensor, kRoundNoise_m);
    found += fit && round.error_m(*fit) < 0.1 && std::abs(fit->radius.radius_m - round.radius_m) < 0.1 ? 1 : 0;
  }
  EXPECT_GT(found, 0.9 * kColumns);
}

TEST(FindRound, FindsNothingInAHandful) {
  Rng rng(9);
  for (int i = 0; i < 100; ++i) {
    const Round round(rng, uniform(rng, 0.2, 0.4), uniform(rng, 1.5, 5.0));
    EXPECT_FALSE(find_round(round.exact(11), round.sensor, kRoundNoise_m).has_value()) << i;
    EXPECT_TRUE(find_round(round.exact(30), round.sensor, kRoundNoise_m).has_value()) << i;
  }
}

TEST(RoundFit, FewPointsGiveNumbers) {
  const Eigen::Vector2d sensor(1, 2), place(3, 4);
  const std::vector<std::vector<Eigen::Vector2d>> sets = {
      {place, {3.1, 4.2}},      {place, place},
      {place, place, place},    std::vector<Eigen::Vector2d>(50, place),
      {sensor, sensor, sensor}, {place, {3.1, 4.1}, {3.2, 4.2}},
      {place, sensor},          {{2.9, 4.0}, {3.1, 4.0}, {3.0, 3.9}}};
  for (std::size_t i = 0; i < sets.size(); ++i) {
    for (const RadiusPrior& prior : {kNothingKnown, RadiusPrior{0.3, 20.0}}) {
      SCOPED_TRACE(testing::Message() << "set " << i << " weight " << prior.weight);
      const RoundFit fit = fit_round(sets[i], sensor, prior, kRoundNoise_m);
      EXPECT_TRUE(fit.center.allFinite() && (fit.center - place).norm() < 5.0) << fit.center.transpose();
      EXPECT_TRUE(std::isfinite(fit.sigma_m) && fit.sigma_m > 0.0) << fit.sigma_m;
      EXPECT_TRUE(std::isfinite(fit.radius.radius_m) && fit.radius.radius_m > 0.0) << fit.radius.radius_m;
      EXPECT_TRUE(std::isfinite(fit.radius.weight) && fit.radius.weight > 0.0) << fit.radius.weight;
      EXPECT_TRUE(std::isfinite(fit.rms_m)) << fit.rms_m;
    }
  }
}

}  // namespace
}  // namespace swarm
