// A simulated robot: it takes setpoints and follows them as a vehicle of its kind does (vehicle_model.h).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "lcmtypes/bus/codec.h"
#include "planner_daemon/trajectory/motion.h"
#include "swarm_sim/environment/pose_drift.h"
#include "swarm_sim/environment/vehicle_model.h"

namespace swarm {

class Vehicle {
 public:
  // At rest at `start`, W [m]; its clock is so much ahead of the world's. Noise and wind are those of the world's name.
  // With `drift` it flies in the frame of its odometry.
  Vehicle(int robot_id, const Eigen::Vector3d& start, Duration clock_offset, const VehicleOptions& options = {},
          const std::string& world = "", std::optional<PoseDrift> drift = {});

  // Its clock is set.
  void step_clock(Duration by) { clock_offset_ += by; }

  // A setpoint message that comes at `utime` of the world; anything else, or another robot's, is ignored. A flight
  // controller flies by a clock of its own: what is not of about now is of the moment at which it comes.
  void on_setpoint(Utime utime, std::span<const std::uint8_t> bytes);
  // What its flight controller is told, where that comes another way than on the bus (Autopilot): then setpoints are
  // only where it should be. It holds the newest one, and without any for half a second that place.
  void on_target(Utime utime, const MotionState& told, double yaw_rad);
  // The same for the force per mass of its rotors, W [m/s^2]. Without any more it holds the place where it took itself
  // to be.
  void on_thrust(Utime utime, const Eigen::Vector3d& thrust, double yaw_rad);
  // The robot's own announcement: it follows what it is bound to while there are no setpoints.
  void on_own_trajectory(std::span<const std::uint8_t> bytes);

  // Moves on by VehicleModel::kStep_s to `utime` of the world: after the newest setpoint, carried on. Stays where it is
  // before the first one. `t_s`: of the world, negative before the flight.
  void move_to(Utime utime, double t_s = -1.0);

  int id() const { return id_; }
  // Where it is, where it takes itself to be, and where it was told to be.
  const MotionState& state() const { return state_; }
  const MotionState& estimate() const { return estimate_; }
  const MotionState& reference() const { return reference_; }
  double yaw_rad() const { return yaw_rad_; }  // as it takes itself to be turned
  // From truth to where it takes things to be.
  const Pose& drifted() const { return drifted_; }
  // Of the robot's clock at `utime` of the world.
  Utime own_time(Utime utime) const { return utime + clock_offset_; }

 private:
  // What its controller follows at `utime` of the world.
  MotionState told_at(Utime utime) const;
  // Where it is told to be at `utime` of the world; there is a setpoint.
  MotionState reference_at(Utime utime) const;
  // How far it errs about where it is.
  MotionState own_error();

  int id_;
  Duration clock_offset_;
  Duration controller_offset_;  // of the flight controller's clock, which nobody sets
  Duration setpoints_offset_;   // of the clock by which it is told where to fly
  MotionState body_;            // in the frame of its odometry
  MotionState state_, estimate_, reference_;
  double yaw_rad_ = 0.0;
  std::unique_ptr<VehicleModel> model_;
  std::optional<PoseDrift> drift_;
  Pose drifted_;
  double own_noise_m_;
  Random random_;
  EstimateError own_error_;
  SequenceGate setpoints_;
  std::optional<sogm_swarm::setpoint_t> setpoint_;
  std::optional<Motion> motion_;  // it is bound to
  struct Target {
    Utime heard;
    MotionState told;
    double yaw_rad;
    std::optional<Eigen::Vector3d> thrust{};
  };
  std::optional<Target> target_;
};

}  // namespace swarm
