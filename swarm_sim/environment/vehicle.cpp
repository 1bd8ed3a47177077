#include "swarm_sim/environment/vehicle.h"

namespace swarm {
namespace {

constexpr std::int64_t kSetpointTimeout_us = 50'000;

}  // namespace

Vehicle::Vehicle(int robot_id, const Eigen::Vector3d& start, std::int64_t clock_offset_us)
    : id_(robot_id), clock_offset_us_(clock_offset_us) {
  state_.position = start;
}

void Vehicle::on_setpoint(std::span<const std::uint8_t> bytes) {
  sogm_swarm::setpoint_t setpoint;
  if (decode(bytes, &setpoint) != Refusal::kNone || setpoint.header.robot_id != id_) return;
  if (setpoint_ && setpoint.header.utime <= setpoint_->header.utime) return;
  setpoint_ = setpoint;
}

void Vehicle::on_own_trajectory(std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  if (decode(bytes, &message) != Refusal::kNone || message.header.robot_id != id_) return;
  motion_ = motion_of(message);
}

void Vehicle::move_to(std::int64_t utime) {
  if (!setpoint_) return;
  const std::int64_t age_us = own_time(utime) - setpoint_->header.utime;
  if (age_us > kSetpointTimeout_us && motion_) {
    state_ = motion_->at(own_time(utime));
    return;
  }
  const double dt = 1e-6 * static_cast<double>(age_us);
  const Eigen::Vector3d p(setpoint_->position), v(setpoint_->velocity);
  const Eigen::Vector3d a(setpoint_->acceleration), j(setpoint_->jerk);
  state_.position = p + dt * (v + dt / 2 * (a + dt / 3 * j));
  state_.velocity = v + dt * (a + dt / 2 * j);
  state_.acceleration = a + dt * j;
  state_.jerk = j;
  yaw_rad_ = setpoint_->yaw;
}

}  // namespace swarm
