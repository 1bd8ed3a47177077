// Vehicles drawn at random are found again from their flights, and fly better with what is found.
#include "tools/logs/identification.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "swarm_sim/environment/vehicle_model.h"
#include "tests/support/harness.h"
#include "tests/support/quintic_to.h"

namespace swarm::test {
namespace {

constexpr double kStep_s = VehicleModel::kStep_s;

bool is_within_limits(const Trajectory& leg) {
  for (Utime t = leg.start_utime(); t < leg.end_utime(); t += 20ms) {
    const MotionState state = leg.at(t);
    if (state.velocity.cwiseAbs().maxCoeff() > 2.0 || state.acceleration.cwiseAbs().maxCoeff() > 6.0) return false;
  }
  return true;
}

// From place to place as a planner flies: up to 2 m/s and 6 m/s^2 on an axis, without a stop; or slowly.
std::vector<RecordedFlight::Setpoint> setpoints(std::uint64_t seed, double seconds, double haste = 1.0) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(-2.0, 2.0);
  std::vector<RecordedFlight::Setpoint> all;
  MotionState from;
  from.position = {0, 0, 1.5};
  Utime now = kStart + 1s;
  Trajectory leg = Trajectory::hover(1, kStart, from.position);
  for (int i = 0; i < std::lround(seconds / kStep_s); ++i) {
    const Utime utime = kStart + to_duration(i * kStep_s);
    if (utime >= now) {
      from = leg.at(utime);
      const Eigen::Vector3d to = from.position + Eigen::Vector3d(place(random), place(random), place(random) / 8);
      double duration_s = 0.5;
      do {
        duration_s *= 1.1;
        leg = quintic_to(from, utime, to, duration_s);
      } while (!is_within_limits(leg));
      duration_s /= haste;
      leg = quintic_to(from, utime, to, duration_s);
      now = utime + to_duration(0.8 * duration_s);
    }
    all.push_back({i * kStep_s, leg.at(utime)});
  }
  return all;
}

// States with `noise_m` of white noise on each axis, and five times as much of the velocity.
RecordedFlight fly(const QuadrotorBody& body, const VehicleFit& fit, double noise_m, std::uint64_t seed, double seconds,
                   double haste = 1.0) {
  VehicleOptions options;
  options.lead_ms = 1e3 * fit.lead_s, options.lag_ms = 1e3 * fit.lag_s, options.drag_per_s = fit.drag_per_s;
  RecordedFlight flight{setpoints(seed, seconds, haste), {}};
  const auto vehicle = make_quadrotor(body, options, flight.setpoints.front().told.position, 1, 1);
  std::mt19937_64 random(seed + 1000);
  std::normal_distribution<double> noise;
  for (const RecordedFlight::Setpoint& setpoint : flight.setpoints) {
    const MotionState state = vehicle->follow(setpoint.told, {});
    const auto noisy = [&](const Eigen::Vector3d& value, double sigma) -> Eigen::Vector3d {
      return value + sigma * Eigen::Vector3d(noise(random), noise(random), noise(random));
    };
    flight.states.push_back({setpoint.time_s, noisy(state.position, noise_m), noisy(state.velocity, 5 * noise_m)});
  }
  return flight;
}

QuadrotorBody random_body(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto between = [&](double low, double high) {
    return low * std::pow(high / low, std::uniform_real_distribution<double>(0, 1)(random));
  };
  QuadrotorBody body;
  body.position_per_s2 = between(2.0, 12.0);
  body.velocity_per_s = 2.0 * between(0.7, 1.2) * std::sqrt(body.position_per_s2);
  body.integral_per_s3 = 0.2 * body.position_per_s2 * between(0.5, 1.5);
  body.delay_s = between(0.01, 0.05);
  body.attitude_lag_s = between(0.04, 0.12);
  body.thrust_lag_s = between(0.03, 0.06);
  body.linear_drag_per_s = between(0.15, 0.6);
  body.quadratic_drag_per_m = 0.0;
  return body;
}

double p99_m(const RecordedFlight& flight) {
  std::vector<double> errors;
  for (std::size_t i = 150; i < flight.states.size(); ++i)
    errors.push_back((flight.states[i].position - flight.setpoints[i].told.position).norm());
  std::ranges::sort(errors);
  return errors[errors.size() * 99 / 100];
}

TEST(Identification, FindsVehiclesDrawnAtRandom) {
  const int num_vehicles = kSanitized ? 4 : 50;
  double as_told_m = 0.0, fitted_m = 0.0;
  for (int k = 0; k < num_vehicles; ++k) {
    SCOPED_TRACE(k);
    const auto seed = static_cast<std::uint64_t>(k);
    const QuadrotorBody body = random_body(seed);
    std::vector<RecordedFlight> flights;
    for (std::uint64_t flight = 0; flight < 4; ++flight)
      flights.push_back(fly(body, {}, 0.01, 100 * seed + flight, 10));
    const IdentifiedVehicle found = identify(flights, {});
    const auto near = [](double value, double truth) { return std::abs(value / truth - 1.0); };
    // The controller looks every 10 ms and holds what it then tells: half of that comes earlier in the simulation.
    EXPECT_NEAR(found.value.delay_s, body.delay_s - kStep_s / 2, 0.005);
    EXPECT_LT(near(found.value.attitude_lag_s, body.attitude_lag_s), 0.12);
    EXPECT_LT(near(found.value.position_per_s2, body.position_per_s2), 0.12);
    EXPECT_LT(near(found.value.velocity_per_s, body.velocity_per_s), 0.12);
    EXPECT_LT(near(found.value.drag_per_s, body.linear_drag_per_s), 0.12);
    EXPECT_NEAR(found.position_noise_m, 0.01, 0.003);
    for (const VehicleParameter& parameter : vehicle_parameters()) {
      EXPECT_TRUE(parameter.member == &VehicleParameters::integral_per_s3 || found.well_known(parameter))
          << parameter.name;
    }
    as_told_m += p99_m(fly(body, {}, 0.0, 100 * seed + 50, 20));
    fitted_m += p99_m(fly(body, found.fit, 0.0, 100 * seed + 50, 20));
  }
  EXPECT_LT(fitted_m, 0.37 * as_told_m) << fitted_m / num_vehicles << " and " << as_told_m / num_vehicles << " m";
}

// Setpoints that were fitted on their way tell the same vehicle.
TEST(Identification, KnowsWhatTheSetpointsWereGiven) {
  const VehicleFit fit{0.02, 0.05, 0.3};
  const std::vector<RecordedFlight> plain = {fly({}, {}, 0.002, 1, 15)}, given = {fly({}, fit, 0.002, 1, 15)};
  const VehicleParameters a = identify(plain, {}).value, b = identify(given, fit).value;
  EXPECT_NEAR(a.delay_s, b.delay_s, 0.003);
  EXPECT_NEAR(a.attitude_lag_s, b.attitude_lag_s, 0.005);
  EXPECT_NEAR(a.position_per_s2, b.position_per_s2, 0.5);
}

TEST(Identification, SaysWhatFlightsDoNotTell) {
  const IdentifiedVehicle found = identify(std::vector{fly({}, {}, 0.01, 3, 10, 0.1)}, {});
  int unknown = 0;
  for (const VehicleParameter& parameter : vehicle_parameters()) unknown += !found.well_known(parameter);
  EXPECT_GE(unknown, 2);
  EXPECT_THROW(identify(std::vector{fly({}, {}, 0.01, 3, 4)}, {}), std::runtime_error);
  EXPECT_THROW(identify({}, {}), std::runtime_error);
}

// How far off it may be, by what it says of itself: two deviations in nineteen of twenty.
TEST(Identification, IsAsSureAsItMayBe) {
  int inside = 0, all = 0;
  for (std::uint64_t seed = 0; seed < (kSanitized ? 2 : 12); ++seed) {
    const QuadrotorBody body = random_body(seed);
    const IdentifiedVehicle found = identify(std::vector{fly(body, {}, 0.02, 7 * seed, 12)}, {});
    const IdentifiedVehicle other = identify(std::vector{fly(body, {}, 0.02, 7 * seed + 1, 12)}, {});
    for (const VehicleParameter& parameter : vehicle_parameters()) {
      const auto at = parameter.member;
      const double sigma = std::hypot(found.sigma.*at, other.sigma.*at);
      inside += std::abs(found.value.*at - other.value.*at) <= 2.5 * sigma;
      ++all;
    }
  }
  EXPECT_GE(inside, all * 8 / 10) << all;
}

}  // namespace
}  // namespace swarm::test
