#include "planner_daemon/coordination/cell.h"

#include <algorithm>
#include <cmath>

namespace swarm {
namespace {

void add_cells(const Eigen::Vector3d& low, const Eigen::Vector3d& high, double edge_m, std::set<Cell>* cells) {
  const auto index = [edge_m](double value) { return static_cast<std::int32_t>(std::floor(value / edge_m)); };
  for (std::int32_t x = index(low.x()); x <= index(high.x()); ++x)
    for (std::int32_t y = index(low.y()); y <= index(high.y()); ++y) cells->insert({x, y});
}

}  // namespace

std::set<Cell> cells_touched(const Motion& motion, Utime from, double reach_m, double edge_m) {
  std::set<Cell> cells;
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(reach_m);
  const Utime end = motion.end_utime();
  while (from < end) {
    const Utime to = std::min(motion.next_knot_after(from), end);
    const ControlPoints points = control_points_between(motion, from, to);
    add_cells(points.rowwise().minCoeff() - reach, points.rowwise().maxCoeff() + reach, edge_m, &cells);
    from = to;
  }
  const Eigen::Vector3d rest = motion.at(from).position;
  add_cells(rest - reach, rest + reach, edge_m, &cells);
  return cells;
}

}  // namespace swarm
