#include "planner_daemon/trajectory/motion.h"

#include <algorithm>

#include "lcmtypes/bus/limits.h"

namespace swarm {

using sogm_swarm::announcement_t;

Utime Motion::next_knot_after(Utime utime) const {
  if (!next.empty() && utime >= next.start_utime()) return next.next_knot_after(utime);
  const Utime knot = committed.next_knot_after(utime);
  return next.empty() ? knot : std::min(knot, next.start_utime());
}

Motion motion_of(const announcement_t& message) {
  const bool is_bound = message.pending_state == announcement_t::kCommitted;
  return {Trajectory::from_wire(message.committed), is_bound ? Trajectory::from_wire(message.pending) : Trajectory()};
}

Trajectory pending_of(const announcement_t& message) {
  return message.pending_state == announcement_t::kAnnounced ? Trajectory::from_wire(message.pending) : Trajectory();
}

void shift(Duration ahead, announcement_t* message) {
  const auto later = [ahead](std::int64_t* utime) {
    *utime = std::clamp<std::int64_t>(*utime + ahead.count(), 0, to_us(kMaxUtime));
  };
  later(&message->header.utime);
  later(&message->committed.start_utime);
  if (message->pending_state == announcement_t::kNone) return;
  later(&message->pending.start_utime);
  later(&message->pending_stamp);
}

ControlPoints control_points_between(const Motion& motion, Utime from, Utime to) {
  // Both ends must come from the trajectory in force during the interval: its right end may be the start of the next.
  const bool on_next = !motion.next.empty() && from >= motion.next.start_utime();
  const Trajectory& trajectory = on_next ? motion.next : motion.committed;
  return quintic_control_points(trajectory.state_at(from), trajectory.state_at(to), to_seconds(to - from));
}

Eigen::AlignedBox3d space_of(const Motion& motion, const Trajectory& pending) {
  Eigen::AlignedBox3d space;
  for (const Trajectory* trajectory : {&motion.committed, &motion.next, &pending}) {
    for (int k = 0; k < trajectory->num_pieces(); ++k) {
      const ControlPoints points =
          quintic_control_points(trajectory->knot(k), trajectory->knot(k + 1), trajectory->piece_s());
      space.extend(points.rowwise().minCoeff()).extend(points.rowwise().maxCoeff());
    }
  }
  return space;
}

}  // namespace swarm
