// How times look in messages of failed tests; in every test file, by the precompiled header.
#pragma once

#include <ostream>

#include "lcmtypes/bus/time.h"

namespace swarm {

inline void PrintTo(Utime utime, std::ostream* out) {
  *out << to_us(utime) << " us";
}

}  // namespace swarm
