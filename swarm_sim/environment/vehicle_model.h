// The body of a robot and its flight controller: how it moves when it is told where to be.
#pragma once

#include <memory>

#include "planner_daemon/trajectory/bezier.h"
#include "swarm_sim/environment/wander.h"
#include "swarm_sim/world/imperfections.h"

namespace swarm {

class VehicleModel {
 public:
  static constexpr double kStep_s = 0.01;

  virtual ~VehicleModel() = default;
  VehicleModel() = default;
  VehicleModel(const VehicleModel&) = delete;
  VehicleModel& operator=(const VehicleModel&) = delete;

  // Moves on by kStep_s to the moment of which `reference` is; the controller takes itself to be where it is plus
  // `error` (position and velocity). True state, W.
  virtual MotionState follow(const MotionState& reference, const MotionState& error) = 0;
  // The same where the controller is told the force per mass of the rotors instead, W [m/s^2]. Throws std::logic_error
  // when the vehicle has none.
  virtual MotionState push(const Eigen::Vector3d& thrust);
};

// A multicopter and its position controller. Lags of first order; drag per mass, of a speed v: (linear + quadratic v)
// v.
struct QuadrotorBody {
  double position_per_s2 = 8.0, velocity_per_s = 5.0, integral_per_s3 = 2.0;  // gains of the controller
  double delay_s = 0.02;                                                      // from a setpoint until it acts
  double attitude_lag_s = 0.07, thrust_lag_s = 0.04;
  double linear_drag_per_s = 0.25, quadratic_drag_per_m = 0.02;
};
// Firm or soft, the latter as PX4's gains are when it is new.
QuadrotorBody quadrotor_body(const std::string& gains);
std::unique_ptr<VehicleModel> make_quadrotor(const QuadrotorBody& body, const VehicleOptions& options,
                                             const Eigen::Vector3d& start, std::uint64_t seed, std::uint64_t wind_seed);

// One that hovers at `start`, W. `seed`: of its noise and its gusts; `wind_seed`: of the wind's direction.
std::unique_ptr<VehicleModel> make_vehicle_model(const VehicleOptions& options, const Eigen::Vector3d& start,
                                                 std::uint64_t seed, std::uint64_t wind_seed);

}  // namespace swarm
