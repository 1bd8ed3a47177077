// What a planner knows of another robot.
#pragma once

#include <Eigen/Geometry>

#include "planner_daemon/trajectory/motion.h"

namespace swarm {

struct Peer {
  Motion motion;
  Trajectory pending;  // waits for acknowledgements: occupied too; may be empty
  double radius_m = 0.2;
  bool silent = false;  // has not been heard for a while
  // Its centre stays within, whichever it flies, W [m]; peers elsewhere cost a look at this.
  Eigen::AlignedBox3d space{Eigen::Vector3d::Constant(-1e6), Eigen::Vector3d::Constant(1e6)};
  int id = 0;
};

}  // namespace swarm
