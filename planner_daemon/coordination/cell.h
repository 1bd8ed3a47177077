// Cells: squares of the ground, as high as the space, with a keeper each (cell_protocol.h).
#pragma once

#include <cstdint>
#include <set>
#include <utility>

#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// Of cells with edges of `edge_m` that from x * edge_m to (x + 1) * edge_m, likewise y; W.
struct Cell {
  std::int32_t x = 0, y = 0;
  bool operator==(const Cell&) const = default;
  bool operator<(const Cell& other) const { return std::pair(x, y) < std::pair(other.x, other.y); }
};

// All cells that the motion comes closer to than `reach_m` from `from` on, hover tail included, and perhaps some more:
// of each piece those that the bounding box of its control points touches.
std::set<Cell> cells_touched(const Motion& motion, Utime from, double reach_m, double edge_m);

}  // namespace swarm
