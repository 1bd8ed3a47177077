// Seeded worlds: the three tasks of the paper's evaluation (section V), the circle, random goals, and a hall with
// rooms, among columns and rings; and tours through a building that somebody has mapped.
#pragma once

#include <cstdint>
#include <string>

#include "swarm_sim/world/fleet.h"
#include "swarm_sim/world/world.h"

namespace swarm {

enum class Task { kCross, kBilateral, kUnilateral, kCircle, kRandom, kHall, kTour };
enum class Environment { kEmpty, kPure, kMixed };  // nothing; columns only; half columns (rounded up), half rings
const char* to_string(Task task);
const char* to_string(Environment environment);
// Throw WorldError on any other text.
Task task_from(const std::string& text);
Environment environment_from(const std::string& text);

// The hall is 24 x 8 x 3 m, with three rooms of 8 x 5 m along each side, whose doors of 1.2 to 1.6 m have places of
// their own in each world; obstacles move inside the hall or inside a room, off the walls however they sway; people
// (walkers.h) walk along the hall. Elsewhere there are no walls. Obstacles start anywhere in obstacle_bounds but not
// within 0.7 m of a robot's start (surface to surface); space and bounds grow with the circle. The same arguments give
// the same world on every machine: values are drawn in multiples of 1 um, um/s, urad; the acceleration of obstacles
// changes nothing else outside the hall. `obstacles` in [0, 500], 0 in the empty environment. Throws WorldError, also
// when no place is found for an obstacle or a robot.
World make_world(Task task, Environment environment, int obstacles, std::uint64_t seed, const Fleet& fleet = {});

}  // namespace swarm
