// Where a robot can come to while a frame of the SOGM is in force: the rest need not be worked out.
#pragma once

#include <limits>

#include "map_daemon/sogm.h"

namespace swarm {

// Where something can come to that is at `center` with `velocity` at `utime`, never faster than `speed_mps` along x or
// y, until `horizon_s` later.
struct ReachableSet {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // W [m]
  Utime utime{};
  double speed_mps = 0.0;
  double horizon_s = 0.0;
  double acceleration_mps2 = std::numeric_limits<double>::infinity();  // it turns at once
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();                  // W [m/s]
};

struct Interval {
  double low, high;
};
// Its extent along an axis (0, 1) at any time within [from_s, to_s], 0 <= from_s <= to_s, after `utime`: W [m].
Interval extent(const ReachableSet& reachable, int axis, double from_s, double to_s);

// The columns it comes to while the frame is in force (the last one stays for ever) or up to `linger_s` later; at most
// a voxel more to each side.
Columns reachable_columns(const Sogm& sogm, int frame, const ReachableSet& reachable, double linger_s = 0.0);

}  // namespace swarm
