// Who flies in a seeded world, by which limits, and what else is chosen of it, as options of a command.
#pragma once

#include <Eigen/Core>
#include <string>

#include "lcmtypes/bus/option_set.h"
#include "planner_daemon/trajectory/motion_limits.h"

namespace swarm {

// Who flies, and how what moves there accelerates. The tasks of the paper have four robots at places of their own; on
// the circle each goes to its antipode, in the random task from anywhere in the space to anywhere else, in the hall
// from a room to another one, on a tour to wherever in the building one can get.
struct Fleet {
  // Circle, random and hall: [2, kMaxRobots]; 0: 10, in the hall 8. Tour: from 1 on; 0: 1.
  int robots = 0;
  double circle_m = 0.0;                        // radius of the circle: [0.5, 1000]; 0: 10
  double robot_m = 0.2;                         // radius of each robot
  MotionLimits limits = {};                     // of each robot
  Eigen::Vector3d space_m = {12.0, 12.0, 4.0};  // edges of the random task's space
  int goals = 1;                                // random, tour: of each robot, one after the other: [1, 100]
  double hop_m = 0.0;                           // random only: so far on each axis the next one is at most; 0: anywhere
  std::string people = {};                      // world files, comma-separated: who walks along the hall; one, by seed
  std::string building = {};                    // tour: its OctoMap
  double low_m = 0.5, high_m = 1.7;             // tour: heights of the flight space
  double obstacle_acceleration_mps2 = 0.0;      // of every obstacle: [0, kMaxObstacleAcceleration_mps2]
};

void declare(OptionSet& options, Fleet& fleet);
// What differs from the defaults, as it is given on the command line.
std::string command_line(const Fleet& fleet);

}  // namespace swarm
