// Which robots shall go where, as an operator writes it.
#pragma once

#include <string>
#include <vector>

#include "lcmtypes/bus/option_set.h"
#include "planner_daemon/trajectory/mission.h"

namespace swarm {

struct GoalOrder {
  int robot_id = 0;
  Mission mission;  // empty: to stay where it is
};

// Of every place.
struct GoalOptions {
  double tolerance_m = Waypoint::kUsualTolerance_m;
  double speed_mps = 0.0;  // 0: the robot's
  double wait_s = 0.0;
  int times = 1;  // the places, one after the other, so often
};

// "0 3 2 1.5": robot 0 to a place; "0 3,2,1.5 5,2,1 4 hold": robot 0 to one place after the other, robot 4 stays where
// it is. Throws OptionError with the word and the rule.
std::vector<GoalOrder> read_orders(const std::vector<std::string>& words, const GoalOptions& options);

}  // namespace swarm
