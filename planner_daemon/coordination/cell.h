// Which cells a motion has to do with (cell_protocol.h).
#pragma once

#include <set>

#include "lcmtypes/bus/cell_messages.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// All cells that the motion comes closer to than `reach_m` from `from` on, hover tail included, and perhaps some more:
// of each piece those that the bounding box of its control points touches.
std::set<Cell> cells_touched(const Motion& motion, Utime from, double reach_m, double edge_m);

}  // namespace swarm
