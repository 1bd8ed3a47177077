// What a robot is about, and the first thing that is not as it should be, in words: for operators.
#pragma once

#include <string>

#include "tools/viewer/swarm_picture.h"

namespace swarm {

// "planning", "no map": as the daemons' statuses say.
const char* state_name(const sogm_swarm::map_status_t& status);
const char* state_name(const sogm_swarm::planner_status_t& status);
const char* state_name(const sogm_swarm::broadcast_status_t& status);
const char* state_name(const sogm_swarm::perception_status_t& status);

// "flying to [3,2,1.5] (2 of 5)", "on the ground", "flying home: the battery is low".
std::string activity_of(const RobotPicture& robot);
// "planner daemon silent", "waiting for a peer"; empty: nothing.
std::string trouble_of(const RobotPicture& robot, Utime now);

}  // namespace swarm
