// `swarm_sim audit`: looks for committed trajectories that meet.
#pragma once

namespace swarm {

// Subcommand; argv[0] is its name. 0: no conflict but with forced motions, 1: conflicts, 2: bad input, after one line
// on stderr.
int audit_command(int argc, const char* const* argv);

}  // namespace swarm
