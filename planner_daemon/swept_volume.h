// Shared trajectories in the SOGM (paper section III-C): what a peer sweeps during a frame is occupied in that frame.
#pragma once

#include "map_daemon/partial_sogm.h"
#include "planner_daemon/trajectory.h"

namespace swarm {

// Marks in the written columns of every frame the voxels whose centre comes within `radius_m` of the motion during the
// frame's interval, hover tail included. Conservative: each span of the curve is covered by its chord, widened by how
// far its control points lie from the chord, so the hull of the span and with it the curve is inside.
void mark_swept_volume(const Motion& motion, double radius_m, PartialSogm* sogm);

}  // namespace swarm
