// What the broadcast daemon is told at its start.
#pragma once

#include <string>
#include <vector>

#include "lcmtypes/bus/option_set.h"
#include "planner_daemon/coordination/flight_state.h"
#include "planner_daemon/trajectory/motion_limits.h"

namespace swarm {

struct BroadcastConfig {
  int robot_id = 0;
  double radius_m = 0.2;
  std::vector<int> roster;      // ids of all robots that fly: nothing is committed before each was heard
  double cell_m = 0.0;          // edge of the cells that it flies in, instead of by a roster; 0: by the roster
  MotionLimits limits;          // candidates beyond are rejected
  double separation_m = 0.02;   // kept between surfaces of committed motions
  double announce_s = 0.05;     // repetition of the announcement
  double rest_s = 0.1;          // the same while the robot hovers
  double lively_s = 0.008;      // the same right after news, while somebody waits for them
  double swarm_rate_hz = 2000;  // announcements of all robots together, in cells of the robot and its peers, at most
  double give_up_after_s = 5;   // a peer that was not heard for so long; 0: never
  double setpoint_rate_hz = 100;
  double yaw_rate_max_radps = 1.5;
  double error_bound_m = 0.3;  // at most: so far from its motion the robot is expected to be
  double off_course_m = 0.5;   // farther from its motion it has lost it
  FlightRules flight;
  double clock_error_s = 0.01;  // clocks of two robots differ by at most this
  double clock_limit_s = 0.1;   // the robot's own messages from further in the future are refused
  std::string state_dir;        // where promises survive a crash; empty: nowhere
};

void declare(OptionSet& options, BroadcastConfig& config);
// Throws OptionError on combinations that cannot work.
void verify(const BroadcastConfig& config);

}  // namespace swarm
