// What a flight controller is to be told, so that its vehicle is where the trajectory says.
#pragma once

#include "planner_daemon/trajectory/bezier.h"

namespace swarm {

// A vehicle answers late: commands take `lead_s` to reach it, then its acceleration follows with a first-order lag; and
// air holds it back. All zero: it is told the trajectory itself.
struct VehicleFit {
  double lead_s = 0.0;
  double lag_s = 0.0;
  double drag_per_s = 0.0;  // deceleration per velocity
  bool operator==(const VehicleFit&) const = default;
};

// The state of `lead_s` later, at constant jerk, with the acceleration that it takes to have the state's own in spite
// of lag and drag. Jerk as in `state`.
inline MotionState fitted(const MotionState& state, const VehicleFit& fit) {
  const double t = fit.lead_s;
  MotionState told = state;
  told.position += t * (state.velocity + t / 2 * (state.acceleration + t / 3 * state.jerk));
  told.velocity += t * (state.acceleration + t / 2 * state.jerk);
  told.acceleration += t * state.jerk + fit.lag_s * state.jerk + fit.drag_per_s * told.velocity;
  return told;
}

}  // namespace swarm
