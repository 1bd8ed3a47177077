#include "swarm_sim/environment/vehicle_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "lcmtypes/bus/portable_math.h"
#include "planner_daemon/trajectory/vehicle_fit.h"

namespace swarm {
namespace {

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
  Quadrotor(const VehicleOptions& options, const Eigen::Vector3d& start, std::uint64_t seed, std::uint64_t wind_seed)
      : gains_(options.gains == "soft" ? kSoft : kFirm),
        fit_{1e-3 * options.lead_ms, 1e-3 * options.lag_ms, options.drag_per_s},
        random_(seed),
        gusts_(options.wind_mps, &random_),
        gust_mps_(kGust * options.wind_mps) {
    const auto [sin, cos] = sin_cos(2.0 * std::numbers::pi * Random(wind_seed).uniform());
    along_wind_ << cos, sin, 0.0;
    wind_ = options.wind_mps * along_wind_;
    state_.position = start;
    pull_ = kGravity - drag(wind_);  // as it has hovered for a while
    integral_ = pull_ - kGravity;
    MotionState hover;
    hover.position = start;
    told_.fill(hover);
    thrust_ = pull_.norm();
    direction_ = pull_ / thrust_;
  }

  MotionState follow(const MotionState& reference, const MotionState& error) override {
    std::shift_left(told_.begin(), told_.end(), 1);
    told_.back() = fitted(reference, fit_);
    control(told_.front(), error);
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
      direction_ += kDt_s / kAttitudeLag_s * (pull_ / pull - direction_);
      direction_ /= direction_.norm();
      thrust_ += kDt_s / kThrustLag_s * (pull - thrust_);
      state_.acceleration = thrust_ * direction_ - kGravity + drag(wind - state_.velocity);
      state_.position += kDt_s * (state_.velocity + 0.5 * kDt_s * state_.acceleration);
      state_.velocity += kDt_s * state_.acceleration;
    }
    state_.jerk = (state_.acceleration - before) / kStep_s;
    return state_;
  }

 private:
  struct Gains {
    double position, velocity, integral;  // [1/s^2], [1/s], [1/s^3]
  };
  static constexpr Gains kFirm{8.0, 5.0, 2.0}, kSoft{1.7, 1.8, 0.4};  // the latter as PX4 has them when it is new
  static constexpr double kAttitudeLag_s = 0.07, kThrustLag_s = 0.04;
  static constexpr int kDelay = 2;                                                 // steps
  static constexpr double kLeastThrust = 2.0, kMostThrust = 20.0, kMostUp = 18.0;  // [m/s^2]
  static constexpr double kMostIntegral = 4.0;                                     // [m/s^2]
  static constexpr double kLinearDrag = 0.25, kQuadraticDrag = 0.02;               // [1/s], [1/m]
  static constexpr double kGust = 0.2;                                             // of the wind
  inline static const Eigen::Vector3d kGravity{0.0, 0.0, 9.81};                    // what holds it up against that

  // Of air that passes at `speed`.
  static Eigen::Vector3d drag(const Eigen::Vector3d& speed) {
    return (kLinearDrag + kQuadraticDrag * speed.norm()) * speed;
  }

  // The position controller: feed-forward, proportional to what is amiss, and integral. Tilts by 45 degrees at most.
  void control(const MotionState& reference, const MotionState& error) {
    const Eigen::Vector3d amiss = reference.position - state_.position - error.position;
    const Eigen::Vector3d amiss_mps = reference.velocity - state_.velocity - error.velocity;
    integral_ += kStep_s * gains_.integral * amiss;
    integral_ = integral_.cwiseMax(-kMostIntegral).cwiseMin(kMostIntegral);
    pull_ = kGravity + reference.acceleration + gains_.position * amiss + gains_.velocity * amiss_mps + integral_;
    pull_.z() = std::clamp(pull_.z(), kLeastThrust, kMostUp);
    const double sideways = pull_.head<2>().norm();
    const double most = std::min(pull_.z(), std::sqrt(kMostThrust * kMostThrust - pull_.z() * pull_.z()));
    if (sideways > most) pull_.head<2>() *= most / sideways;
  }

  Gains gains_;
  VehicleFit fit_;
  Random random_;
  Gusts gusts_;
  double gust_mps_;
  Eigen::Vector3d along_wind_, wind_;
  MotionState state_;
  Eigen::Vector3d pull_, integral_;           // what the controller wants of the thrust
  std::array<MotionState, kDelay + 1> told_;  // setpoints on their way, the oldest first
  double thrust_;
  Eigen::Vector3d direction_;  // of the thrust
};

}  // namespace

std::unique_ptr<VehicleModel> make_vehicle_model(const VehicleOptions& options, const Eigen::Vector3d& start,
                                                 std::uint64_t seed, std::uint64_t wind_seed) {
  if (options.kind == "quadrotor") return std::make_unique<Quadrotor>(options, start, seed, wind_seed);
  if (options.kind == "noisy") return std::make_unique<NoisyVehicle>(options.tracking_sigma_m, seed);
  return std::make_unique<PerfectVehicle>();
}

}  // namespace swarm
