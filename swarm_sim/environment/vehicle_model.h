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
};

// One that hovers at `start`, W. `seed`: of its noise and its gusts; `wind_seed`: of the wind's direction.
std::unique_ptr<VehicleModel> make_vehicle_model(const VehicleOptions& options, const Eigen::Vector3d& start,
                                                 std::uint64_t seed, std::uint64_t wind_seed);

}  // namespace swarm
