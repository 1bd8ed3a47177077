// Seeded worlds: the three tasks of the paper's evaluation (section V), the circle, random goals, and a hall with
// rooms, among columns and rings.
#pragma once

#include <cstdint>
#include <string>

#include "lcmtypes/bus/option_set.h"
#include "swarm_sim/world/world.h"

namespace swarm {

enum class Task { kCross, kBilateral, kUnilateral, kCircle, kRandom, kHall };
enum class Environment { kEmpty, kPure, kMixed };  // nothing; columns only; half columns (rounded up), half rings
const char* to_string(Task task);
const char* to_string(Environment environment);
// Throw WorldError on any other text.
Task task_from(const std::string& text);
Environment environment_from(const std::string& text);

// Who flies, and how what moves there accelerates. The tasks of the paper have four robots at places of their own; on
// the circle each goes to its antipode, in the random task from anywhere in the space to anywhere else, in the hall
// from a room to another one.
struct Fleet {
  int robots = 0;                               // circle, random and hall only: [2, kMaxRobots]; 0: 10, in the hall 8
  double circle_m = 0.0;                        // radius of the circle: [0.5, 1000]; 0: 10
  double robot_m = 0.2;                         // radius of each robot
  MotionLimits limits = {};                     // of each robot
  Eigen::Vector3d space_m = {12.0, 12.0, 4.0};  // edges of the random task's space
  int goals = 1;                                // random only: of each robot, one after the other: [1, 100]
  double hop_m = 0.0;                           // random only: so far on each axis the next one is at most; 0: anywhere
  std::string people = {};                      // world files, comma-separated: who walks along the hall; one, by seed
  double obstacle_acceleration_mps2 = 0.0;      // of every obstacle: [0, kMaxObstacleAcceleration_mps2]
};

void declare(OptionSet& options, Fleet& fleet);
// What differs from the defaults, as it is given on the command line.
std::string command_line(const Fleet& fleet);

// The hall is 24 x 8 x 3 m, with three rooms of 8 x 5 m along each side, whose doors of 1.2 to 1.6 m have places of
// their own in each world; obstacles move inside the hall or inside a room, off the walls however they sway; people
// (walkers.h) walk along the hall. Elsewhere there are no walls. Obstacles start anywhere in obstacle_bounds but not
// within 0.7 m of a robot's start (surface to surface); space and bounds grow with the circle. The same arguments give
// the same world on every machine: values are drawn in multiples of 1 um, um/s, urad; the acceleration of obstacles
// changes nothing else outside the hall. `obstacles` in [0, 500], 0 in the empty environment. Throws WorldError, also
// when no place is found for an obstacle or a robot.
World make_world(Task task, Environment environment, int obstacles, std::uint64_t seed, const Fleet& fleet = {});

}  // namespace swarm
