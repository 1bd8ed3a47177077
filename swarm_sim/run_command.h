// `swarm_sim run`: flies one world and writes what came of it.
#pragma once

namespace swarm {

// argv[0] is "run". Returns 0: success, 1: flown but not successful, 2: bad input, after one line on stderr; 130 when
// interrupted.
int run_command(int argc, const char* const* argv);

}  // namespace swarm
