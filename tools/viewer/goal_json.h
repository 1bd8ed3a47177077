// A goal as the page sends it.
#pragma once

#include "tools/operator/goal_order.h"
#include "tools/viewer/picture_frame.h"

namespace swarm {

// {"robot": id, "waypoints": [{"position": [x, y, z] in W [m], "wait_s": 0}, ...], "times": 1}: so often one waypoint
// after the other. wait_s and times may be left out; nothing else may be there. Throws std::runtime_error, one line,
// with the value and the rule that it breaks.
GoalOrder read_goal(const Json& goal);

}  // namespace swarm
