// A simulated robot with a perfect flight controller: it is where its newest setpoint says.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "lcmtypes/bus/codec.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

class Vehicle {
 public:
  // At rest at `start`, W [m]; its clock is so much ahead of the world's.
  Vehicle(int robot_id, const Eigen::Vector3d& start, Duration clock_offset);

  // Its clock is set.
  void step_clock(Duration by) { clock_offset_ += by; }

  // A setpoint message that comes at `utime` of the world; anything else, or another robot's, is ignored. A flight
  // controller flies by a clock of its own: what is not of about now is of the moment at which it comes.
  void on_setpoint(Utime utime, std::span<const std::uint8_t> bytes);
  // The robot's own announcement: it follows what it is bound to while there are no setpoints.
  void on_own_trajectory(std::span<const std::uint8_t> bytes);

  // Moves on to `utime` of the world: the newest setpoint, carried on. Stays where it is before the first one.
  void move_to(Utime utime);

  int id() const { return id_; }
  const MotionState& state() const { return state_; }
  double yaw_rad() const { return yaw_rad_; }
  // Of the robot's clock at `utime` of the world.
  Utime own_time(Utime utime) const { return utime + clock_offset_; }

 private:
  int id_;
  Duration clock_offset_;
  Duration controller_offset_;  // of the flight controller's clock, which nobody sets
  Duration setpoints_offset_;   // of the clock by which it is told where to fly
  MotionState state_;
  double yaw_rad_ = 0.0;
  SequenceGate setpoints_;
  std::optional<sogm_swarm::setpoint_t> setpoint_;
  std::optional<Motion> motion_;  // it is bound to
};

}  // namespace swarm
