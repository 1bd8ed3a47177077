// When an obstacle meets a motion.
#pragma once

#include <vector>

#include "map_daemon/sogm.h"
#include "planner_daemon/space/peer.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// Whether an occupied voxel's centre lies within `radius_m` of `place` in a frame. Of the map alone: peers are not in
// it.
bool touches(const Sogm& sogm, int frame, const Eigen::Vector3d& place, double radius_m);

// First time in [from, until] at which an occupied voxel's centre lies within `radius_m` of the motion, or kNever;
// looked at every 20 ms.
Utime first_touch(const Sogm& sogm, const Motion& motion, double radius_m, Utime from, Utime until);

// From `from` on no obstacle blocks the motion, and no peer is bound to meet it: what a peer merely plans it cannot
// commit. Looked at every 20 ms.
bool keeps_clear(const Motion& motion, const Sogm& sogm, const std::vector<Peer>& peers, double blocked_m, Utime from);

}  // namespace swarm
