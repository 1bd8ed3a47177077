// Which robots shall do what, or go where, as an operator writes it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "lcmtypes/bus/option_set.h"
#include "planner_daemon/trajectory/mission.h"
#include "sogm_swarm/order_t.hpp"

namespace swarm {

struct GoalOrder {
  int robot_id = 0;
  Mission mission;                    // empty: there is an order
  std::optional<std::int16_t> order;  // one of order_t's
  double height_m = 0.0;              // of a take-off
  int other_id = 0;                   // of "without"
};

// Of every place.
struct GoalOptions {
  double tolerance_m = Waypoint::kUsualTolerance_m;
  double speed_mps = 0.0;  // 0: the robot's
  double wait_s = 0.0;
  int times = 1;          // the places, one after the other, so often
  double height_m = 1.5;  // of take-offs
};

// "take-off", or "?"; and the other way round.
const char* name_of_order(std::int16_t order);
std::optional<std::int16_t> find_order(const std::string& name);

// "0 3 2 1.5": robot 0 to a place; "0 3,2,1.5 5,2,1 4,5 hold": robot 0 to one place after the other, robots 4 and 5
// stay where they are; "0,1 without 2": robots 0 and 1 go on without robot 2. Throws OptionError with the word and the
// rule.
std::vector<GoalOrder> read_orders(const std::vector<std::string>& words, const GoalOptions& options);

}  // namespace swarm
