// What a message must say to be believed: finite values, the ranges of the .lcm files (and the general ones of
// lcmtypes/README.md where they name none), fields that agree with each other.
#pragma once

#include "lcmtypes/bus/codec.h"

namespace swarm {

// kNone, kValue or kInconsistent. The messages' own headers are judged by the first, not by the others.
[[nodiscard]] Refusal validate(const sogm_swarm::header_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::announcement_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::broadcast_status_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::candidate_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::corridors_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::goal_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::map_status_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::obstacle_voxels_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::obstacles_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::planner_status_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::robot_state_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::setpoint_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::sogm_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::trajectory_t& m);

}  // namespace swarm
