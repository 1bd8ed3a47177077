// Wider registers where the processor has them, chosen at load time. For loops over integers only: the results are
// identical everywhere.
#pragma once

#include <cstdint>
#include <vector>

#if defined(__x86_64__) && defined(__GNUC__)
#define SWARM_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define SWARM_WIDE
#endif

namespace swarm {

// out = the union of `n` words from each source on.
void or_words(const std::vector<const std::uint64_t*>& sources, std::size_t n, std::uint64_t* out);

}  // namespace swarm
