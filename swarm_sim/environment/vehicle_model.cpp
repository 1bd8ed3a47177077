#include "swarm_sim/environment/vehicle_model.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <vector>

#include "lcmtypes/bus/portable_math.h"
#include "planner_daemon/trajectory/vehicle_fit.h"

namespace swarm {
namespace {

// What a controller is told.
struct Told {
  MotionState reference;
  std::optional<Eigen::Vector3d> thrust{};  // then not the reference
};

class PerfectVehicle : public VehicleModel {
 public:
  MotionState follow(const MotionState& reference, const MotionState&) override { return reference; }
};

// Wanders about the reference, within three standard deviations.
class NoisyVehicle : public VehicleModel {
 public:
  NoisyVehicle(double sigma_m, std::uint64_t seed) : sigma_m_(sigma_m), random_(seed), wander_(0.5, &random_) {}

  MotionState follow(const MotionState& reference, const MotionState&) override {
    wander_.step(kStep_s, &random_);
    MotionState state = reference;
    for (int axis = 0; axis < 3; ++axis) {
      const double value = wander_.value()[axis], bounded = std::clamp(value, -3.0, 3.0);
      state.position[axis] += sigma_m_ * bounded;
      if (value == bounded) state.velocity[axis] += sigma_m_ * wander_.rate_per_s()[axis];
    }
    return state;
  }

 private:
  double sigma_m_;
  Random random_;
  Wander wander_;
};

// A multicopter as its position controller sees it: a point that thrust pulls, whose direction follows what is
// commanded with the lag of the attitude loop, its amount with that of the motors. Setpoints take a while to reach the
// controller. Forces per mass.
class Quadrotor : public VehicleModel {
 public:
  Quadrotor(const QuadrotorBody& body, const VehicleOptions& options, const Eigen::Vector3d& start, std::uint64_t seed,
            std::uint64_t wind_seed)
      : body_(body),
        told_(static_cast<std::size_t>(std::ceil(body.delay_s / kStep_s - 1e-9)) + 1),
        carry_on_{static_cast<double>(told_.size() - 1) * kStep_s - body.delay_s, 0.0, 0.0},
        fit_{1e-3 * options.lead_ms, 1e-3 * options.lag_ms, options.drag_per_s},
        random_(seed),
        gusts_(options.wind_mps, &random_),
        gust_mps_(kGust * options.wind_mps),
        shove_mps_(options.shove_mps),
        shoves_(~seed) {
    const auto [sin, cos] = sin_cos(2.0 * std::numbers::pi * Random(wind_seed).uniform());
    along_wind_ << cos, sin, 0.0;
    wind_ = options.wind_mps * along_wind_;
    state_.position = start;
    pull_ = kGravity - drag(wind_);  // as it has hovered for a while
    integral_ = pull_ - kGravity;
    MotionState hover;
    hover.position = start;
    std::ranges::fill(told_, Told{hover});
    thrust_ = pull_.norm();
    direction_ = pull_ / thrust_;
  }

  MotionState follow(const MotionState& reference, const MotionState& error) override {
    return move({fitted(reference, fit_)}, error);
  }
  MotionState push(const Eigen::Vector3d& thrust) override { return move({MotionState(), thrust}, MotionState()); }

 private:
  MotionState move(const Told& told, const MotionState& error) {
    std::shift_left(told_.begin(), told_.end(), 1);
    told_.back() = told;
    if (const Told& now = told_.front(); now.thrust) {
      pull_ = *now.thrust;
    } else {
      control(fitted(now.reference, carry_on_), error);
    }
    limit_pull();
    if (shove_mps_ > 0.0) be_shoved();
    const double pull = pull_.norm();
    gusts_.step(kStep_s, &random_);
    const Eigen::Vector3d gust = gusts_.value();
    const Eigen::Vector3d across(-along_wind_.y(), along_wind_.x(), 0.0);
    const Eigen::Vector3d wind =
        wind_ + gust_mps_ * (gust.x() * along_wind_ + gust.y() * across + gust.z() * Eigen::Vector3d::UnitZ());
    const Eigen::Vector3d before = state_.acceleration;
    constexpr int kSteps = 10;
    constexpr double kDt_s = kStep_s / kSteps;
    for (int i = 0; i < kSteps; ++i) {
      direction_ += kDt_s / body_.attitude_lag_s * (pull_ / pull - direction_);
      direction_ /= direction_.norm();
      thrust_ += kDt_s / body_.thrust_lag_s * (pull - thrust_);
      state_.acceleration = thrust_ * direction_ - kGravity + drag(wind - state_.velocity);
      state_.position += kDt_s * (state_.velocity + 0.5 * kDt_s * state_.acceleration);
      state_.velocity += kDt_s * state_.acceleration;
    }
    state_.jerk = (state_.acceleration - before) / kStep_s;
    return state_;
  }

  static constexpr double kLeastThrust = 2.0, kMostThrust = 20.0, kMostUp = 18.0;  // [m/s^2]
  static constexpr double kMostIntegral = 4.0;                                     // [m/s^2]
  static constexpr double kGust = 0.2;                                             // of the wind
  inline static const Eigen::Vector3d kGravity{0.0, 0.0, 9.81};                    // what holds it up against that

  // Of air that passes at `speed`.
  Eigen::Vector3d drag(const Eigen::Vector3d& speed) const {
    return (body_.linear_drag_per_s + body_.quadratic_drag_per_m * speed.norm()) * speed;
  }

  // The position controller: feed-forward, proportional to what is amiss, and integral.
  void control(const MotionState& reference, const MotionState& error) {
    const Eigen::Vector3d amiss = reference.position - state_.position - error.position;
    const Eigen::Vector3d amiss_mps = reference.velocity - state_.velocity - error.velocity;
    integral_ += kStep_s * body_.integral_per_s3 * amiss;
    integral_ = integral_.cwiseMax(-kMostIntegral).cwiseMin(kMostIntegral);
    pull_ = kGravity + reference.acceleration + body_.position_per_s2 * amiss + body_.velocity_per_s * amiss_mps +
            integral_;
  }

  // Tilts by 45 degrees at most.
  void limit_pull() {
    pull_.z() = std::clamp(pull_.z(), kLeastThrust, kMostUp);
    const double sideways = pull_.head<2>().norm();
    const double most = std::min(pull_.z(), std::sqrt(kMostThrust * kMostThrust - pull_.z() * pull_.z()));
    if (sideways > most) pull_.head<2>() *= most / sideways;
  }

  void be_shoved() {
    constexpr int kPeriod = 1000;  // steps
    if (step_ % kPeriod == 0) shoved_at_ = step_ + static_cast<std::int64_t>(kPeriod * shoves_.uniform());
    if (step_++ != shoved_at_) return;
    const auto [sin, cos] = sin_cos(2.0 * std::numbers::pi * shoves_.uniform());
    state_.velocity += shove_mps_ * Eigen::Vector3d(cos, sin, 0.0);
  }

  QuadrotorBody body_;
  std::vector<Told> told_;  // on its way, the oldest first,
  VehicleFit carry_on_;     // which is so much older than what acts now
  VehicleFit fit_;
  Random random_;
  Gusts gusts_;
  double gust_mps_;
  Eigen::Vector3d along_wind_, wind_;
  double shove_mps_;
  Random shoves_;
  std::int64_t step_ = 0, shoved_at_ = 0;
  MotionState state_;
  Eigen::Vector3d pull_, integral_;  // what the controller wants of the thrust
  double thrust_;
  Eigen::Vector3d direction_;  // of the thrust
};

}  // namespace

MotionState VehicleModel::push(const Eigen::Vector3d&) {
  throw std::logic_error("VehicleModel::push: a vehicle without rotors");
}

QuadrotorBody quadrotor_body(const std::string& gains) {
  QuadrotorBody body;
  if (gains == "soft") body.position_per_s2 = 1.7, body.velocity_per_s = 1.8, body.integral_per_s3 = 0.4;
  return body;
}

std::unique_ptr<VehicleModel> make_quadrotor(const QuadrotorBody& body, const VehicleOptions& options,
                                             const Eigen::Vector3d& start, std::uint64_t seed,
                                             std::uint64_t wind_seed) {
  return std::make_unique<Quadrotor>(body, options, start, seed, wind_seed);
}

std::unique_ptr<VehicleModel> make_vehicle_model(const VehicleOptions& options, const Eigen::Vector3d& start,
                                                 std::uint64_t seed, std::uint64_t wind_seed) {
  if (options.kind == "quadrotor")
    return make_quadrotor(quadrotor_body(options.gains), options, start, seed, wind_seed);
  if (options.kind == "noisy") return std::make_unique<NoisyVehicle>(options.tracking_sigma_m, seed);
  return std::make_unique<PerfectVehicle>();
}

}  // namespace swarm
