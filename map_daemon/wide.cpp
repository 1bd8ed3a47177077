#include "map_daemon/wide.h"

#include <cstring>

namespace swarm {
namespace {

// Four words in a register, or in as many as it takes.
using Words = std::uint64_t __attribute__((vector_size(32)));
constexpr std::size_t kWords = sizeof(Words) / sizeof(std::uint64_t);

SWARM_WIDE void or_rows(const std::uint64_t* const* sources, std::size_t count, std::size_t n, std::uint64_t* out) {
  std::size_t i = 0;
  for (; i + 4 * kWords <= n; i += 4 * kWords) {
    Words a{}, b{}, c{}, d{}, in;
    for (std::size_t k = 0; k < count; ++k) {
      const std::uint64_t* from = sources[k] + i;
      std::memcpy(&in, from, sizeof in), a |= in;
      std::memcpy(&in, from + kWords, sizeof in), b |= in;
      std::memcpy(&in, from + 2 * kWords, sizeof in), c |= in;
      std::memcpy(&in, from + 3 * kWords, sizeof in), d |= in;
    }
    std::memcpy(out + i, &a, sizeof a);
    std::memcpy(out + i + kWords, &b, sizeof b);
    std::memcpy(out + i + 2 * kWords, &c, sizeof c);
    std::memcpy(out + i + 3 * kWords, &d, sizeof d);
  }
  for (; i < n; ++i) {
    std::uint64_t sum = 0;
    for (std::size_t k = 0; k < count; ++k) sum |= sources[k][i];
    out[i] = sum;
  }
}

}  // namespace

void or_words(const std::vector<const std::uint64_t*>& sources, std::size_t n, std::uint64_t* out) {
  or_rows(sources.data(), sources.size(), n, out);
}

}  // namespace swarm
