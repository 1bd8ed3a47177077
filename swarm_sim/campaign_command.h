// `swarm_sim campaign` flies many worlds, `swarm_sim merge` joins what shards of a campaign have found.
#pragma once

namespace swarm {

// Subcommands; argv[0] is their name. 0: done, 2: bad input, after one line on stderr; 130 when interrupted.
int campaign_command(int argc, const char* const* argv);
int merge_command(int argc, const char* const* argv);

}  // namespace swarm
