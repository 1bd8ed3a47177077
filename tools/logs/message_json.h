// Our messages as JSON, for programs that do not speak LCM. Fields have their LCM names, in the .lcm files' order; all
// numbers are JSON numbers, and a float is the shortest decimal that is that float. Different from the wire are:
// numbers that are not finite become null; trajectory_t.knots are objects (x, y, z [m], vx, vy, vz [m/s], ax, ay, az
// [m/s^2]), only the num_pieces + 1 that say something; voxels are objects (x, y, z); the bytes of sogm_t
// and of packed messages are left out.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "lcmtypes/bus/codec.h"

namespace swarm {

// Instantiated in message_json.cpp for every message of message_list.h.
template <class T>
nlohmann::ordered_json to_json(const T& message);

// A JSON Schema (draft 2020-12) of what to_json gives for numbers that are finite.
template <class T>
nlohmann::ordered_json json_schema();

// "sogm_swarm.goal_t" for example.
template <class T>
std::string schema_name();

}  // namespace swarm
