// How many cores this process may use.
#pragma once

namespace swarm {

// Those that it may run on (sched_getaffinity), and no more than Slurm gives its task (SLURM_CPUS_PER_TASK), or its job
// on this computer (SLURM_CPUS_ON_NODE), where a scheduler counts cores and does not bind to them. Throws
// std::runtime_error with name, value and rule where such a variable is no number from 1 on.
int usable_cores();

}  // namespace swarm
