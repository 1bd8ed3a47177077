// Products with a few long columns, as the active set has them: four rows at a time for the vector units, and sums in
// an order that is the same on every machine.
#pragma once

#include <cstddef>

namespace swarm {

// Columns of `rows` numbers each, one after the other; `rows` is a multiple of 4.
struct LongColumns {
  const double* data;
  std::size_t rows, count;
};

// Of each column with `vector`, to `out`.
void inner_products(const LongColumns& columns, const double* vector, double* out);
// From `vector`, each column as often as `factors` say.
void take_away(const LongColumns& columns, const double* factors, double* vector);

}  // namespace swarm
