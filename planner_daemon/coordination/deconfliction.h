// Deconfliction between robots (paper section IV-D): two motions are free of conflict when, at every instant from now
// to for ever, their positions are separated by a plane at a distance of at least the sum of the radii.
#pragma once

#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// True when the origin is farther than `radius_m` from the convex hull of `points`, shown by a separating plane. A
// plane that exists only just may be missed (the answer is then false): callers subdivide.
bool linearly_separable(const ControlPoints& points, double radius_m);

// True when the two motions keep their centres at least `distance_m` apart from `start` on, hover tails included.
// Exact up to the subdivision limit (below a millisecond), where it errs towards conflict; so it does where motions
// come so close for so long that to show their distance takes more than a thousand subdivisions. Works on the
// difference of the two curves, which is a Bezier curve itself, so robots that pass the same place at different times
// do not conflict. `clock_error_s`: and they do so as well when `b` comes earlier or later by up to this; on the safe
// side there: b is kept off by as far as it gets in that time.
[[nodiscard]] bool motions_separated(const Motion& a, const Motion& b, Utime start, double distance_m,
                                     double clock_error_s = 0.0);

}  // namespace swarm
