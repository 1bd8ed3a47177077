// Wider registers where the processor has them, chosen at load time. For loops over integers and over basic operations
// on doubles (each on its own, no sums): the results are identical everywhere.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__)
#define SWARM_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define SWARM_WIDE
#endif
