// When simulated time begins in the tests.
#pragma once

#include "lcmtypes/bus/time.h"

namespace swarm {

inline constexpr Utime kStart = to_utime(1'700'000'000'000'000);

}  // namespace swarm
