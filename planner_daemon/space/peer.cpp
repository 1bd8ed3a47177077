#include "planner_daemon/space/peer.h"

namespace swarm {

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
