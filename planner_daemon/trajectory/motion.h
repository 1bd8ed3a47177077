// What a robot is bound to fly, as its announcement says it.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>

#include "planner_daemon/trajectory/trajectory.h"
#include "sogm_swarm/announcement_t.hpp"

namespace swarm {

// What a robot is bound to: it flies `committed`, and from the start of `next` on (when there is one) flies that.
struct Motion {
  Trajectory committed;
  Trajectory next;  // empty, or starts on `committed`

  MotionState at(Utime utime) const {
    return !next.empty() && utime >= next.start_utime() ? next.at(utime) : committed.at(utime);
  }
  // First time later than `utime` at which the polynomial changes, or kNever.
  Utime next_knot_after(Utime utime) const;
  // Of the trajectory it ends with.
  std::int32_t seq() const { return next.empty() ? committed.seq() : next.seq(); }
  // The robot hovers from here on.
  Utime end_utime() const { return next.empty() ? committed.end_utime() : next.end_utime(); }
};

// What an announcement says its robot is bound to, and what it would like to be bound to: that is pending, and empty
// when nothing waits for acknowledgements. From a message that passed decode().
Motion motion_of(const sogm_swarm::announcement_t& message);
Trajectory pending_of(const sogm_swarm::announcement_t& message);

// An announcement as it is by a clock that is `ahead`. Times stay within what a message may say: a peer may say any.
void shift(Duration ahead, sogm_swarm::announcement_t* message);

// Control points of the motion during [from, to], which must hold no knot inside.
ControlPoints control_points_between(const Motion& motion, Utime from, Utime to);

// A box that who flies one after the other, or some of it, stays in: the hull of all pieces, W [m].
Eigen::AlignedBox3d space_of(const Motion& motion, const Trajectory& pending);

}  // namespace swarm
