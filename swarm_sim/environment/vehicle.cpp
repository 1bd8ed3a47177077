#include "swarm_sim/environment/vehicle.h"

#include <utility>

#include "lcmtypes/bus/receive.h"

namespace swarm {
namespace {

constexpr Duration kSetpointTimeout = 50ms, kTargetTimeout = 500ms;

}  // namespace

Vehicle::Vehicle(int robot_id, const Eigen::Vector3d& start, Duration clock_offset, const VehicleOptions& options,
                 const std::string& world, std::optional<PoseDrift> drift)
    : id_(robot_id),
      clock_offset_(clock_offset),
      controller_offset_(clock_offset),
      setpoints_offset_(clock_offset),
      model_(make_vehicle_model(options, start, seed_of(world + " vehicle " + std::to_string(robot_id)),
                                seed_of(world + " wind"))),
      drift_(std::move(drift)),
      own_noise_m_(options.own_noise_m),
      random_(seed_of(world + " robot " + std::to_string(robot_id))),
      own_error_(&random_) {
  state_.position = start;
  body_ = estimate_ = reference_ = state_;
}

void Vehicle::on_setpoint(Utime utime, std::span<const std::uint8_t> bytes) {
  sogm_swarm::setpoint_t setpoint;
  if (receive(bytes, FromRobot{id_}, {}, setpoints_, &setpoint) != Refusal::kNone) return;
  const Utime then = to_utime(setpoint.header.utime);
  const auto is_of_now = [&](Duration offset) { return std::chrono::abs(utime + offset - then) <= kSetpointTimeout; };
  if (is_of_now(controller_offset_)) {
    setpoints_offset_ = controller_offset_;
  } else if (!is_of_now(setpoints_offset_)) {
    setpoints_offset_ = then - utime;
  }
  setpoint_ = setpoint;
}

void Vehicle::on_own_trajectory(std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  if (receive(bytes, FromRobot{id_}, {}, AnyOrder{}, &message) == Refusal::kNone) motion_ = motion_of(message);
}

void Vehicle::move_to(Utime utime, double t_s) {
  const MotionState error = own_error();
  if (setpoint_) {
    reference_ = reference_at(utime);
    const bool pushes = target_ && target_->thrust && utime - target_->heard <= kTargetTimeout;
    body_ = pushes ? model_->push(*target_->thrust) : model_->follow(told_at(utime), error);
    yaw_rad_ = target_ ? target_->yaw_rad : setpoint_->yaw;
  }
  estimate_ = state_ = body_;
  if (drift_) {
    drifted_ = drift_->at(t_s);
    state_ = drift_->truth_of(body_, t_s);
  }
  if (own_noise_m_ == 0.0) return;
  estimate_.position += error.position;
  estimate_.velocity += error.velocity;
}

void Vehicle::on_target(Utime utime, const MotionState& told, double yaw_rad) {
  target_ = {utime, told, yaw_rad};
}

void Vehicle::on_thrust(Utime utime, const Eigen::Vector3d& thrust, double yaw_rad) {
  MotionState here;
  here.position = estimate_.position;
  target_ = {utime, here, yaw_rad, thrust};
}

MotionState Vehicle::told_at(Utime utime) const {
  if (!target_) return reference_;
  MotionState told = target_->told;
  if (utime - target_->heard > kTargetTimeout) told.velocity.setZero(), told.acceleration.setZero();
  return told;
}

MotionState Vehicle::reference_at(Utime utime) const {
  const Utime now = utime + setpoints_offset_;
  const Duration age = now - to_utime(setpoint_->header.utime);
  if (age > kSetpointTimeout && motion_) return motion_->at(now);
  const double dt = to_seconds(age);
  const Eigen::Vector3d p(setpoint_->position), v(setpoint_->velocity);
  const Eigen::Vector3d a(setpoint_->acceleration), j(setpoint_->jerk);
  return {p + dt * (v + dt / 2 * (a + dt / 3 * j)), v + dt * (a + dt / 2 * j), a + dt * j, j};
}

MotionState Vehicle::own_error() {
  MotionState error;
  if (own_noise_m_ == 0.0) return error;
  own_error_.step(VehicleModel::kStep_s, &random_);
  error.position = own_error_.value(own_noise_m_);
  error.velocity = own_error_.rate_per_s(own_noise_m_);
  return error;
}

}  // namespace swarm
