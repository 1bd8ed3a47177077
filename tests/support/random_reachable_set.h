// What a robot may reach, for the tests of maps that are worked out there only.
#pragma once

#include "planner_daemon/space/reachability.h"
#include "tests/support/random_motion.h"

namespace swarm {

// In or near the window, from before the map's start to its third frame; turning at once or not.
inline ReachableSet random_reachable_set(Rng& rng, const Sogm& sogm) {
  const GridGeometry& grid = sogm.geometry;
  const double frame_s = to_seconds(sogm.frame_duration);
  ReachableSet reach;
  reach.center = grid.center_of(grid.size / 2) +
                 (0.6 * grid.resolution_m * grid.size.cast<double>()).cwiseProduct(in_cube(rng, 1.0));
  reach.utime = sogm.start_utime + to_duration(frame_s * uniform(rng, -1, 3));
  reach.speed_mps = uniform(rng, 0.0, 0.3 * grid.resolution_m * grid.size.x() / frame_s / sogm.num_frames);
  reach.horizon_s = frame_s * uniform(rng, 1.0, sogm.num_frames + 1);
  if (uniform(rng, 0, 1) < 0.7) {
    reach.acceleration_mps2 = uniform(rng, 0.1, 4.0) * reach.speed_mps / frame_s;
    reach.velocity = in_cube(rng, 1.01 * reach.speed_mps);  // rounding may have made it a little too fast
  }
  return reach;
}

}  // namespace swarm
