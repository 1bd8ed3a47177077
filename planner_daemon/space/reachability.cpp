#include "planner_daemon/space/reachability.h"

#include <algorithm>

namespace swarm {
namespace {

// Farthest along an axis after `t_s` with this velocity [m].
double farthest(double velocity, double t_s, const ReachableSet& reachable) {
  if (velocity >= reachable.speed_mps) return velocity * t_s;
  const double gain = reachable.speed_mps - velocity, until_s = gain / reachable.acceleration_mps2;
  if (t_s < until_s) return velocity * t_s + reachable.acceleration_mps2 * t_s * t_s / 2;
  return reachable.speed_mps * t_s - gain * until_s / 2;
}

}  // namespace

Interval extent(const ReachableSet& reachable, int axis, double from_s, double to_s) {
  const double v = reachable.velocity[axis];  // the farthest is convex in time: its largest value is at an end
  return {reachable.center[axis] - std::max(farthest(-v, from_s, reachable), farthest(-v, to_s, reachable)),
          reachable.center[axis] + std::max(farthest(v, from_s, reachable), farthest(v, to_s, reachable))};
}

Columns reachable_columns(const Sogm& sogm, int frame, const ReachableSet& reachable, double linger_s) {
  const bool last = frame + 1 == sogm.num_frames;
  const auto since_s = [&](int number) {
    return to_seconds(sogm.start_utime + number * sogm.frame_duration - reachable.utime);
  };
  const double end_s = since_s(frame + 1) + linger_s;
  if (end_s < 0.0 && !last) return {};
  const double to_s = last ? reachable.horizon_s : std::min(end_s, reachable.horizon_s);
  const double from_s = std::clamp(since_s(frame), 0.0, to_s);
  const Interval x = extent(reachable, 0, from_s, to_s), y = extent(reachable, 1, from_s, to_s);
  const Eigen::Vector3d low(x.low, y.low, 0.0), high(x.high, y.high, 0.0);
  const GridGeometry& grid = sogm.geometry;
  const Columns all = all_columns(grid);
  return {grid.voxel_of(low.array() - grid.resolution_m).head<2>().cwiseMax(all.first),
          grid.voxel_of(high.array() + grid.resolution_m).head<2>().cwiseMin(all.last)};
}

}  // namespace swarm
