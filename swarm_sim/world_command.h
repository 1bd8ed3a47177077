// `swarm_sim world`: writes a generated world file.
#pragma once

namespace swarm {

// argv[0] is the subcommand's name. Options: see --help. Returns the exit code: 0, or 2 with one line on standard error
// and nothing written.
int world_command(int argc, const char* const* argv);

}  // namespace swarm
