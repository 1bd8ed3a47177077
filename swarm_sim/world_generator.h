// Seeded worlds of the paper's evaluation (section V): its three tasks and the circle, among columns and rings.
#pragma once

#include <cstdint>
#include <string>

#include "swarm_sim/world.h"

namespace swarm {

enum class Task { kCross, kBilateral, kUnilateral, kCircle };
enum class Environment { kEmpty, kPure, kMixed };  // nothing; columns only; half columns (rounded up), half rings
const char* to_string(Task task);
const char* to_string(Environment environment);
// Throw WorldError on any other text.
Task task_from(const std::string& text);
Environment environment_from(const std::string& text);

// Only for the circle: robots evenly on it, each to its antipode.
struct Circle {
  int robots = 10;         // [2, 40]
  double radius_m = 10.0;  // [0.5, 1000]
};

// Obstacles start anywhere in obstacle_bounds but not within 0.7 m of a robot's start (surface to surface); space and
// bounds grow with the circle. The same arguments give the same world on every machine: values are drawn in multiples
// of 1 um, um/s, urad. `obstacles` in [0, 500], 0 in the empty environment. Throws WorldError, also when no place is
// found for an obstacle.
World make_world(Task task, Environment environment, int obstacles, std::uint64_t seed, const Circle& circle = {});

}  // namespace swarm
