// Four rows at a time for the vector units: in functions that are SWARM_WIDE, one register's worth.
#pragma once

#include <cstddef>
#include <cstring>

namespace swarm {

using FourRows = double __attribute__((vector_size(32)));

[[gnu::always_inline]] inline void load(const double* from, FourRows* rows) {
  std::memcpy(rows, from, sizeof *rows);
}
[[gnu::always_inline]] inline void store(const FourRows& rows, double* to) {
  std::memcpy(to, &rows, sizeof rows);
}

}  // namespace swarm
