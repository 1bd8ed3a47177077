// When an obstacle meets a motion.
#pragma once

#include <cstdint>

#include "map_daemon/sogm.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// First time in [from, until] at which an occupied voxel's centre lies within `radius_m` of the motion, or INT64_MAX;
// looked at every 20 ms. Of the map alone: peers are not in it.
std::int64_t first_touch(const Sogm& sogm, const Motion& motion, double radius_m, std::int64_t from_utime,
                         std::int64_t until_utime);

}  // namespace swarm
