#include "swarm_sim/environment/vehicle.h"

#include "lcmtypes/bus/receive.h"

namespace swarm {
namespace {

constexpr Duration kSetpointTimeout = 50ms;

}  // namespace

Vehicle::Vehicle(int robot_id, const Eigen::Vector3d& start, Duration clock_offset)
    : id_(robot_id), clock_offset_(clock_offset), controller_offset_(clock_offset), setpoints_offset_(clock_offset) {
  state_.position = start;
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

void Vehicle::move_to(Utime utime) {
  if (!setpoint_) return;
  const Utime now = utime + setpoints_offset_;
  const Duration age = now - to_utime(setpoint_->header.utime);
  if (age > kSetpointTimeout && motion_) {
    state_ = motion_->at(now);
    return;
  }
  const double dt = to_seconds(age);
  const Eigen::Vector3d p(setpoint_->position), v(setpoint_->velocity);
  const Eigen::Vector3d a(setpoint_->acceleration), j(setpoint_->jerk);
  state_.position = p + dt * (v + dt / 2 * (a + dt / 3 * j));
  state_.velocity = v + dt * (a + dt / 2 * j);
  state_.acceleration = a + dt * j;
  state_.jerk = j;
  yaw_rad_ = setpoint_->yaw;
}

}  // namespace swarm
