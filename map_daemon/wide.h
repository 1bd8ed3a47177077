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

// Rows of `n` words each, `stride` words apart in all sources, `out_stride` words apart in `out`: out = their union.
struct WordRows {
  std::size_t rows = 1, n = 0, stride = 0, out_stride = 0;
};
void or_words(const std::vector<const std::uint64_t*>& sources, const WordRows& shape, std::uint64_t* out);

}  // namespace swarm
