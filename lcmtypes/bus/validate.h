// What a message must say to be believed: finite values, the ranges of the .lcm files (and the general ones of
// lcmtypes/README.md where they name none), fields that agree with each other.
#pragma once

#include "lcmtypes/bus/codec.h"

namespace swarm {

// kNone, kValue or kInconsistent. The messages' own headers are judged by the first, not by the others.
[[nodiscard]] Refusal validate(const sogm_swarm::header_t& m);
[[nodiscard]] Refusal validate(const sogm_swarm::trajectory_t& m);
#define SWARM_VALIDATE(type, ...) [[nodiscard]] Refusal validate(const sogm_swarm::type& m);
SWARM_MESSAGES(SWARM_VALIDATE)
#undef SWARM_VALIDATE

}  // namespace swarm
