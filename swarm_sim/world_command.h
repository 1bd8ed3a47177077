// `swarm_sim world`: writes a generated world file.
#pragma once

namespace swarm {

// argv[0] is the subcommand's name. Options: --task --env --obstacles --seed --robots --radius and -o/--out FILE ("-":
// standard output). Returns the exit code: 0, or 2 with one line on standard error and nothing written.
int world_command(int argc, const char* const* argv);

}  // namespace swarm
