#include "tools/logs/identification.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <nlopt.hpp>
#include <stdexcept>

#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr double kStep_s = 0.005;
constexpr double kGravity_mps2 = 9.81, kLeastUp_mps2 = 2.0, kMostTilt = 1.0;  // 45 degrees: controllers' usual limit
constexpr double kLeastSeen_s = 5.0;
constexpr int kMaxEvaluations = 1000;
constexpr double kFirstNoise_m = 0.01, kFirstNoise_mps = 0.05;  // before it is known

using Scaled = std::vector<double>;  // logarithms: all parameters are positive, and span decades

Scaled scaled(const VehicleParameters& vehicle) {
  Scaled x;
  for (const VehicleParameter& parameter : vehicle_parameters()) x.push_back(std::log(vehicle.*parameter.member));
  return x;
}

VehicleParameters unscaled(const Scaled& x) {
  VehicleParameters vehicle;
  for (std::size_t i = 0; i < x.size(); ++i) vehicle.*vehicle_parameters()[i].member = std::exp(x[i]);
  return vehicle;
}

// What is told at a time: the newest setpoint until then, carried on; before the first, that.
class Told {
 public:
  Told(const RecordedFlight& flight, const VehicleFit& fit) : setpoints_(flight.setpoints), fit_(fit) {}
  // Times ascend.
  MotionState at(double time_s) {
    while (next_ + 1 < setpoints_.size() && setpoints_[next_ + 1].time_s <= time_s) ++next_;
    const RecordedFlight::Setpoint& newest = setpoints_[next_];
    const double age_s = std::max(0.0, time_s - newest.time_s);
    return fitted(fitted(newest.told, {age_s, 0.0, 0.0}), fit_);  // carried on at constant jerk, then as it was told
  }

 private:
  std::span<const RecordedFlight::Setpoint> setpoints_;
  VehicleFit fit_;
  std::size_t next_ = 0;
};

// Of all flights, after the warm-up: what the model says less what was seen, axis by axis.
struct Residuals {
  std::vector<double> position, velocity;
};

void add_residuals(const RecordedFlight& flight, const VehicleParameters& vehicle, const VehicleFit& told_with,
                   Residuals* residuals) {
  const auto model = simulated(flight, vehicle, told_with);
  const std::size_t first = flight.states.size() - model.size();
  for (std::size_t i = 0; i < model.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      residuals->position.push_back(model[i].position[axis] - flight.states[first + i].position[axis]);
      residuals->velocity.push_back(model[i].velocity[axis] - flight.states[first + i].velocity[axis]);
    }
  }
}

Residuals residuals_of(std::span<const RecordedFlight> flights, const VehicleParameters& vehicle,
                       const VehicleFit& told_with) {
  Residuals all;
  for (const RecordedFlight& flight : flights) add_residuals(flight, vehicle, told_with, &all);
  return all;
}

double mean_square(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value * value;
  return sum / static_cast<double>(std::max<std::size_t>(1, values.size()));
}

// So many neighbours of a series of axes x, y, z, x, ... say the same: what its noise is worth.
double correlation_length(const std::vector<double>& values) {
  const double variance = mean_square(values);
  if (variance <= 0.0) return 1.0;
  double length = 1.0;
  for (std::size_t lag = 1; 3 * lag < values.size() && lag < 400; ++lag) {
    double sum = 0.0;
    for (std::size_t i = 3 * lag; i < values.size(); ++i) sum += values[i] * values[i - 3 * lag];
    const double share = sum / static_cast<double>(values.size() - 3 * lag) / variance;
    if (share <= 0.05) break;
    length += 2.0 * share;
  }
  return length;
}

double p99(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(values.size() - 1));
  std::ranges::nth_element(values, at);
  return *at;
}

// Distances of `where` from the setpoints of its time, of all flights.
template <class Where>
std::vector<double> tracking_errors(std::span<const RecordedFlight> flights, const Where& where) {
  std::vector<double> errors;
  for (const RecordedFlight& flight : flights) {
    Told told(flight, {});
    for (const RecordedFlight::Seen& seen : where(flight))
      errors.push_back((seen.position - told.at(seen.time_s).position).norm());
  }
  return errors;
}

std::vector<double> model_errors(std::span<const RecordedFlight> flights, const VehicleParameters& vehicle,
                                 const VehicleFit& fit) {
  return tracking_errors(flights, [&](const RecordedFlight& flight) { return simulated(flight, vehicle, fit); });
}

using Cost = std::function<double(const std::vector<double>&)>;

// The least of `cost` from `x` on, within bounds.
void minimize(const Cost& cost, const std::vector<double>& low, const std::vector<double>& high, double first_step,
              std::vector<double>* x) {
  nlopt::opt optimizer(nlopt::LN_BOBYQA, static_cast<unsigned>(x->size()));
  optimizer.set_lower_bounds(low);
  optimizer.set_upper_bounds(high);
  optimizer.set_initial_step(std::vector<double>(x->size(), first_step));
  optimizer.set_xtol_abs(1e-5);
  optimizer.set_ftol_rel(1e-9);
  optimizer.set_maxeval(kMaxEvaluations);
  optimizer.set_min_objective([](const std::vector<double>& at, std::vector<double>&,
                                 void* data) { return (*static_cast<const Cost*>(data))(at); },
                              const_cast<void*>(static_cast<const void*>(&cost)));
  double least = 0.0;
  try {
    optimizer.optimize(*x, least);
  } catch (const nlopt::roundoff_limited&) {  // as near as numbers go
  }
}

// What keeps the model nearest to the setpoints, its largest errors first: of the lag only a part. Where the jerk is
// high, all of it would ask for more tilt than there is.
VehicleFit best_fit(std::span<const RecordedFlight> flights, const VehicleParameters& vehicle) {
  constexpr int kShares = 20;
  VehicleFit best;
  double least = std::numeric_limits<double>::infinity();
  for (int share = 0; share <= kShares; ++share) {
    const VehicleFit fit{vehicle.delay_s, vehicle.attitude_lag_s * share / kShares, vehicle.drag_per_s};
    double sum = 0.0;
    for (const double error : model_errors(flights, vehicle, fit)) sum += std::pow(error, 6);
    if (sum < least) best = fit, least = sum;
  }
  return best;
}

}  // namespace

const std::array<VehicleParameter, kNumVehicleParameters>& vehicle_parameters() {
  using P = VehicleParameters;
  static constexpr std::array<VehicleParameter, kNumVehicleParameters> kAll = {{
      {"delay", "s", &P::delay_s, 0.001, 0.3, 0.03},
      {"attitude lag", "s", &P::attitude_lag_s, 0.005, 0.5, 0.07},
      {"thrust lag", "s", &P::thrust_lag_s, 0.005, 0.5, 0.07},
      {"position gain", "1/s^2", &P::position_per_s2, 0.2, 50.0, 5.0},
      {"velocity gain", "1/s", &P::velocity_per_s, 0.2, 30.0, 4.0},
      {"integral gain", "1/s^3", &P::integral_per_s3, 0.001, 30.0, 2.0},
      {"drag", "1/s", &P::drag_per_s, 0.001, 3.0, 0.3},
  }};
  return kAll;
}

std::vector<RecordedFlight::Seen> simulated(const RecordedFlight& flight, const VehicleParameters& vehicle,
                                            const VehicleFit& told_with) {
  std::vector<RecordedFlight::Seen> seen;
  if (flight.setpoints.empty() || flight.states.empty()) return seen;
  Told told(flight, told_with);
  const double begin_s = std::max(flight.setpoints.front().time_s, flight.states.front().time_s);
  double time_s = begin_s;
  const MotionState first = told.at(time_s - vehicle.delay_s);
  Eigen::Vector3d position = first.position, velocity = first.velocity, integral = Eigen::Vector3d::Zero();
  const Eigen::Vector3d gravity(0, 0, kGravity_mps2);
  Eigen::Vector3d pull = gravity + first.acceleration, direction = pull.normalized();
  double thrust = pull.norm();
  for (const RecordedFlight::Seen& state : flight.states) {
    while (time_s < state.time_s) {
      const double dt = std::min(kStep_s, state.time_s - time_s);
      const MotionState reference = told.at(time_s + dt / 2 - vehicle.delay_s);
      const Eigen::Vector3d amiss = reference.position - position;
      integral += dt * vehicle.integral_per_s3 * amiss;
      pull = gravity + reference.acceleration + vehicle.position_per_s2 * amiss +
             vehicle.velocity_per_s * (reference.velocity - velocity) + integral;
      pull.z() = std::max(pull.z(), kLeastUp_mps2);
      pull.head<2>() *= std::min(1.0, kMostTilt * pull.z() / std::max(pull.head<2>().norm(), 1e-9));
      const double amount = pull.norm();
      direction += (1.0 - std::exp(-dt / vehicle.attitude_lag_s)) * (pull / amount - direction);
      direction.normalize();
      thrust += (1.0 - std::exp(-dt / vehicle.thrust_lag_s)) * (amount - thrust);
      const Eigen::Vector3d acceleration = thrust * direction - gravity - vehicle.drag_per_s * velocity;
      position += dt * (velocity + dt / 2 * acceleration);
      velocity += dt * acceleration;
      time_s += dt;
    }
    if (state.time_s >= begin_s + kWarmUp_s) seen.push_back({state.time_s, position, velocity});
  }
  return seen;
}

bool IdentifiedVehicle::well_known(const VehicleParameter& parameter) const {
  return sigma.*parameter.member <= 0.1 * std::max(value.*parameter.member, parameter.scale);
}

IdentifiedVehicle identify(std::span<const RecordedFlight> flights, const VehicleFit& told_with) {
  double seen_s = 0.0;
  for (const RecordedFlight& flight : flights) seen_s += std::max(0.0, flight.duration_s() - kWarmUp_s);
  if (seen_s < kLeastSeen_s)
    throw std::runtime_error("flights of " + fixed(seen_s, 1) + " s beyond the first " + fixed(kWarmUp_s, 1) +
                             " s of each: must be at least " + fixed(kLeastSeen_s, 0) + " s");
  IdentifiedVehicle found;
  double noise_m = kFirstNoise_m, noise_mps = kFirstNoise_mps;
  const Cost cost = [&](const Scaled& x) {
    const Residuals residuals = residuals_of(flights, unscaled(x), told_with);
    const double sum = mean_square(residuals.position) / (noise_m * noise_m) +
                       mean_square(residuals.velocity) / (noise_mps * noise_mps);
    return std::isfinite(sum) ? std::min(sum, 1e12) : 1e12;  // where the loop is not stable
  };
  Scaled x = scaled({}), low, high;
  for (const VehicleParameter& parameter : vehicle_parameters()) {
    low.push_back(std::log(parameter.low));
    high.push_back(std::log(parameter.high));
  }
  for (int round = 0; round < 3; ++round) {  // with what noise the round before has left
    minimize(cost, low, high, round == 0 ? 0.3 : 0.05, &x);
    const Residuals residuals = residuals_of(flights, unscaled(x), told_with);
    noise_m = std::max(1e-5, std::sqrt(mean_square(residuals.position)));
    noise_mps = std::max(1e-4, std::sqrt(mean_square(residuals.velocity)));
  }
  found.value = unscaled(x);
  found.position_noise_m = noise_m;
  found.velocity_noise_mps = noise_mps;

  // Covariance: inverse of the information that the flights hold, by central differences, worth as much less as
  // neighbouring residuals say the same.
  const Residuals at = residuals_of(flights, found.value, told_with);
  const double worth_m = noise_m * std::sqrt(correlation_length(at.position));
  const double worth_mps = noise_mps * std::sqrt(correlation_length(at.velocity));
  const auto rows = static_cast<Eigen::Index>(at.position.size());
  Eigen::MatrixXd jacobian(2 * rows, kNumVehicleParameters);
  for (int i = 0; i < kNumVehicleParameters; ++i) {
    constexpr double kDifference = 0.01;  // of a logarithm
    Scaled more = x, less = x;
    more[static_cast<std::size_t>(i)] += kDifference, less[static_cast<std::size_t>(i)] -= kDifference;
    const Residuals a = residuals_of(flights, unscaled(more), told_with);
    const Residuals b = residuals_of(flights, unscaled(less), told_with);
    for (Eigen::Index row = 0; row < rows; ++row) {
      const auto k = static_cast<std::size_t>(row);
      jacobian(row, i) = (a.position[k] - b.position[k]) / (2 * kDifference * worth_m);
      jacobian(rows + row, i) = (a.velocity[k] - b.velocity[k]) / (2 * kDifference * worth_mps);
    }
  }
  Eigen::MatrixXd information = jacobian.transpose() * jacobian;
  information.diagonal().array() += 1e-6;  // what the flights say nothing of at all
  const Eigen::MatrixXd covariance =
      information.ldlt().solve(Eigen::MatrixXd::Identity(kNumVehicleParameters, kNumVehicleParameters));
  for (int i = 0; i < kNumVehicleParameters; ++i) {
    const VehicleParameter& parameter = vehicle_parameters()[static_cast<std::size_t>(i)];
    found.sigma.*parameter.member = found.value.*parameter.member * std::sqrt(std::max(0.0, covariance(i, i)));
  }

  found.fit = best_fit(flights, found.value);
  found.measured_p99_m = p99(tracking_errors(
      flights, [](const RecordedFlight& flight) -> const auto& { return flight.states; }));
  found.model_p99_m = p99(model_errors(flights, found.value, told_with));
  found.fitted_p99_m = p99(model_errors(flights, found.value, found.fit));
  return found;
}

}  // namespace swarm
