#include "map_daemon/wide.h"

#include <cstring>

namespace swarm {
namespace {

// Four words in a register, or in as many as it takes.
using Words = std::uint64_t __attribute__((vector_size(32)));
constexpr std::size_t kWords = sizeof(Words) / sizeof(std::uint64_t);

SWARM_WIDE void or_rows(const std::uint64_t* const* sources, std::size_t count, const WordRows& shape,
                        std::uint64_t* out) {
  const std::size_t n = shape.n;
  for (std::size_t row = 0; row < shape.rows; ++row, out += shape.out_stride) {
    const std::size_t begin = row * shape.stride;
    std::size_t i = 0;
    for (; i + 4 * kWords <= n; i += 4 * kWords) {
      Words a{}, b{}, c{}, d{}, in;
      for (std::size_t k = 0; k < count; ++k) {
        const std::uint64_t* from = sources[k] + begin + i;
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
    for (; i < n; i += kWords) {
      if (i + kWords > n) {
        if (n < kWords) break;
        i = n - kWords;  // some of them a second time
      }
      Words a{}, in;
      for (std::size_t k = 0; k < count; ++k) std::memcpy(&in, sources[k] + begin + i, sizeof in), a |= in;
      std::memcpy(out + i, &a, sizeof a);
    }
    for (; i < n; ++i) {  // fewer than a register holds
      std::uint64_t sum = 0;
      for (std::size_t k = 0; k < count; ++k) sum |= sources[k][begin + i];
      out[i] = sum;
    }
  }
}

}  // namespace

void or_words(const std::vector<const std::uint64_t*>& sources, const WordRows& shape, std::uint64_t* out) {
  or_rows(sources.data(), sources.size(), shape, out);
}

}  // namespace swarm
