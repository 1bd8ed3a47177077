// The number of a program's start, header_t.boot.
#pragma once

#include <cstdint>

namespace swarm {

// Of what is heard on this computer only, the onboard buses: grows at every start, whatever becomes of the wall clock.
// Not across a restart of the computer: then the listeners are new as well.
// Twentieths of a second since the computer was started: of twenty starts in a second each has its own, and 31 bits
// last for 3.4 years. It waits for the next one to begin, at most 0.05 s, so that no two calls of one program
// get the same.
std::int32_t new_boot();

// Of what other computers hear, for whoever keeps no number of its own: the seconds of the wall clock. It waits for the
// next one to begin, at most 1 s. A wall clock that is set back makes it fall.
std::int32_t new_boot_by_wall_clock();

}  // namespace swarm
