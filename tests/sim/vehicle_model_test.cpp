// Bodies that do not do what they are told: how far they are off, and that they are the same at every run.
#include "swarm_sim/environment/vehicle_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "lcmtypes/bus/portable_math.h"

namespace swarm {
namespace {

const Eigen::Vector3d kPlace(1, 2, 1);

MotionState hover() {
  MotionState state;
  state.position = kPlace;
  return state;
}

// Round and round, 1.5 m/s on a circle of 1 m, begun gently.
MotionState round_and_round(double t_s) {
  const double ramp = std::min(t_s / 4.0, 1.0), rate = 1.5 * ramp, radius = 1.0;
  const double angle = t_s < 4.0 ? 1.5 * t_s * t_s / 8.0 : 1.5 * (t_s - 2.0);
  const auto [sin, cos] = sin_cos(angle);
  const double turn = t_s < 4.0 ? 1.5 / 4.0 : 0.0;  // of the rate
  MotionState state = hover();
  state.position += radius * Eigen::Vector3d(cos - 1.0, sin, 0);
  state.velocity = radius * rate * Eigen::Vector3d(-sin, cos, 0);
  state.acceleration = radius * (turn * Eigen::Vector3d(-sin, cos, 0) - rate * rate * Eigen::Vector3d(cos, sin, 0));
  state.jerk =
      radius * (rate * rate * rate * Eigen::Vector3d(sin, -cos, 0) - 3 * rate * turn * Eigen::Vector3d(cos, sin, 0));
  return state;
}

// Worst distance from the reference [m], from the tenth second on.
double worst_of(const VehicleOptions& options, MotionState (*reference)(double)) {
  const auto model = make_vehicle_model(options, kPlace, 3, 4);
  double worst_m = 0.0;
  for (int k = 1; k <= 3000; ++k) {
    const MotionState told = reference(0.01 * k), state = model->follow(told, {});
    if (k > 1000) worst_m = std::max(worst_m, (state.position - told.position).norm());
  }
  return worst_m;
}
MotionState stand(double) {
  return hover();
}

TEST(VehicleModel, APerfectOneIsWhereItIsTold) {
  const auto model = make_vehicle_model({}, kPlace, 1, 2);
  const MotionState told = round_and_round(5.0), state = model->follow(told, hover());
  EXPECT_EQ(state.position, told.position);
  EXPECT_EQ(state.acceleration, told.acceleration);
}

TEST(VehicleModel, ANoisyOneWandersAsFarAsItIsSaid) {
  const auto model = make_vehicle_model({.kind = "noisy", .tracking_sigma_m = 0.05}, kPlace, 1, 2);
  double sum2 = 0.0, worst_m = 0.0, jump_m = 0.0;
  MotionState before = model->follow(hover(), {});
  constexpr int kSteps = 100'000;
  for (int k = 0; k < kSteps; ++k) {
    const MotionState state = model->follow(hover(), {});
    const Eigen::Vector3d off = state.position - kPlace;
    sum2 += off.squaredNorm() / 3;
    worst_m = std::max(worst_m, off.cwiseAbs().maxCoeff());
    jump_m = std::max(jump_m, (state.position - before.position - 0.005 * (state.velocity + before.velocity)).norm());
    before = state;
  }
  EXPECT_NEAR(std::sqrt(sum2 / kSteps), 0.05, 0.005);
  EXPECT_LE(worst_m, 0.15 + 1e-9);
  EXPECT_GT(worst_m, 0.12);
  EXPECT_LT(jump_m, 0.01);
}

TEST(VehicleModel, AQuadrotorHoversWhereItIsTold) {
  EXPECT_LT(worst_of({.kind = "quadrotor"}, stand), 1e-6);
  EXPECT_LT(worst_of({.kind = "quadrotor", .wind_mps = 3.0}, stand), 0.12);
  EXPECT_LT(worst_of({.kind = "quadrotor", .wind_mps = 6.0}, stand), 0.35);
  EXPECT_GT(worst_of({.kind = "quadrotor", .wind_mps = 3.0}, stand), 0.01);
}

// What setpoints are given on their way makes it follow them; soft gains need it most. By default that is what suits a
// planner's flights, whose jerk is high: on a smooth one all of the lag is better made up for.
TEST(VehicleModel, AQuadrotorLagsUnlessItIsToldWhatItNeeds) {
  for (const char* gains : {"firm", "soft"}) {
    SCOPED_TRACE(gains);
    const double usual_m = worst_of({.kind = "quadrotor", .gains = gains}, round_and_round);
    const double fitted_m = worst_of(
        {.kind = "quadrotor", .gains = gains, .lead_ms = 20, .lag_ms = 70, .drag_per_s = 0.3}, round_and_round);
    const double plain_m =
        worst_of({.kind = "quadrotor", .gains = gains, .lead_ms = 0, .lag_ms = 0, .drag_per_s = 0}, round_and_round);
    EXPECT_LT(fitted_m, 0.05);
    EXPECT_GT(plain_m, 2.0 * fitted_m);
    EXPECT_GT(plain_m, 1.4 * usual_m);
  }
}

// What it believes of itself it follows.
TEST(VehicleModel, AQuadrotorThatErrsAboutItselfIsOffByThat) {
  const auto model = make_vehicle_model({.kind = "quadrotor"}, kPlace, 3, 4);
  MotionState error;
  error.position = {0.1, 0, -0.05};
  MotionState state;
  for (int k = 0; k < 2000; ++k) state = model->follow(hover(), error);
  EXPECT_LT((state.position + error.position - kPlace).norm(), 1e-3);
}

// Asked for the impossible, it does what it can.
TEST(VehicleModel, AQuadrotorHasLimits) {
  const auto model = make_vehicle_model({.kind = "quadrotor"}, kPlace, 3, 4);
  MotionState told = hover();
  told.acceleration = {300, 0, 0};
  double sideways = 0.0;
  for (int k = 0; k < 20; ++k) sideways = std::max(sideways, model->follow(told, {}).acceleration.x());
  EXPECT_GT(sideways, 5.0);
  EXPECT_LT(sideways, 20.0);
}

// What runs into it does so once in ten seconds, to any side; then it comes back.
TEST(VehicleModel, AQuadrotorIsShoved) {
  const auto model = make_vehicle_model({.kind = "quadrotor", .shove_mps = 3.0}, kPlace, 3, 4);
  int shoves = 0;
  double worst_m = 0.0;
  MotionState before = hover();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int k = 0; k < 10'000; ++k) {
    const MotionState state = model->follow(hover(), {});
    const Eigen::Vector3d change = state.velocity - before.velocity;
    if (change.norm() > 2.0) ++shoves, sum += change;
    worst_m = std::max(worst_m, (state.position - kPlace).norm());
    before = state;
  }
  EXPECT_EQ(shoves, 10);
  EXPECT_LT(sum.norm(), 20.0);
  EXPECT_GT(worst_m, 0.5);
  EXPECT_LT(worst_m, 1.5);
}

TEST(VehicleModel, AQuadrotorIsPushedByItsThrust) {
  const auto model = make_vehicle_model({.kind = "quadrotor"}, kPlace, 3, 4);
  MotionState state;
  for (int k = 0; k < 50; ++k) state = model->push({1.0, 0, 9.81});
  EXPECT_NEAR(state.acceleration.x(), 1.0, 0.15);  // lags are over, air does not yet hold it back much
  EXPECT_NEAR(state.acceleration.z(), 0.0, 0.05);
  EXPECT_THROW(make_vehicle_model({}, kPlace, 1, 1)->push({0, 0, 9.81}), std::logic_error);
}

TEST(VehicleModel, TheSameSeedIsTheSameFlight) {
  const VehicleOptions options{.kind = "quadrotor", .wind_mps = 5.0};
  const auto end_of = [&](std::uint64_t seed) {
    const auto model = make_vehicle_model(options, kPlace, seed, 4);
    MotionState state;
    for (int k = 0; k < 500; ++k) state = model->follow(hover(), {});
    return state.position;
  };
  EXPECT_EQ(end_of(1), end_of(1));
  EXPECT_NE(end_of(1), end_of(2));
}

TEST(Wander, HasTheDeviationAndTheMemoryThatItIsSaidToHave) {
  Random random(9);
  Wander wander(0.5, &random);
  Eigen::Vector3d sum2 = Eigen::Vector3d::Zero(), shared = Eigen::Vector3d::Zero();
  constexpr int kSteps = 200'000, kLater = 50;
  std::vector<Eigen::Vector3d> values;
  for (int k = 0; k < kSteps; ++k) {
    wander.step(0.01, &random);
    values.push_back(wander.value());
    sum2 += wander.value().cwiseAbs2();
    if (k >= kLater) shared += wander.value().cwiseProduct(values[static_cast<std::size_t>(k - kLater)]);
  }
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(sum2[axis] / kSteps, 1.0, 0.1);
    EXPECT_NEAR(shared[axis] / kSteps, 3.0 * std::exp(-2.0), 0.1);  // (1 + w t) e^(-w t) of half a second
  }
}

TEST(Gusts, HaveTheDeviationThatTheyAreSaidToHave) {
  Random random(9);
  Gusts gusts(6.0, &random);
  Eigen::Vector3d sum2 = Eigen::Vector3d::Zero();
  constexpr int kSteps = 2'000'000;
  for (int k = 0; k < kSteps; ++k) {
    gusts.step(0.01, &random);
    sum2 += gusts.value().cwiseAbs2();
  }
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(sum2[axis] / kSteps, 1.0, 0.1);
}

TEST(Random, NumbersAreDistributedAsTheyShould) {
  Random random(1);
  double sum = 0.0, sum2 = 0.0, sum4 = 0.0;
  constexpr int kNumbers = 200'000;
  for (int k = 0; k < kNumbers; ++k) {
    const double value = random.normal();
    sum += value, sum2 += value * value, sum4 += value * value * value * value;
  }
  EXPECT_NEAR(sum / kNumbers, 0.0, 0.01);
  EXPECT_NEAR(sum2 / kNumbers, 1.0, 0.02);
  EXPECT_NEAR(sum4 / kNumbers, 3.0, 0.15);
  EXPECT_NE(seed_of("a"), seed_of("b"));
}

}  // namespace
}  // namespace swarm
