#include "planner_daemon/optimize/long_columns.h"

#include "lcmtypes/bus/wide.h"
#include "planner_daemon/optimize/four_rows.h"

namespace swarm {
namespace {

constexpr std::size_t kRows = 4;

// Of several columns at once, whose sums do not wait for each other.
template <std::size_t kColumns>
[[gnu::always_inline]] inline void some_products(const double* columns, std::size_t rows, const double* vector,
                                                 double* out) {
  FourRows sums[kColumns] = {};
  for (std::size_t i = 0; i < rows; i += kRows) {
    FourRows of_vector;
    load(vector + i, &of_vector);
    for (std::size_t k = 0; k < kColumns; ++k) {
      FourRows of_column;
      load(columns + k * rows + i, &of_column);
      sums[k] += of_column * of_vector;
    }
  }
  for (std::size_t k = 0; k < kColumns; ++k) out[k] = (sums[k][0] + sums[k][1]) + (sums[k][2] + sums[k][3]);
}

// Several rows at once, likewise.
template <std::size_t kBlocks>
[[gnu::always_inline]] inline void take_away_rows(const LongColumns& columns, std::size_t first, const double* factors,
                                                  double* vector) {
  FourRows rest[kBlocks];
  for (std::size_t b = 0; b < kBlocks; ++b) load(vector + first + b * kRows, &rest[b]);
  for (std::size_t k = 0; k < columns.count; ++k) {
    for (std::size_t b = 0; b < kBlocks; ++b) {
      FourRows of_column;
      load(columns.data + k * columns.rows + first + b * kRows, &of_column);
      rest[b] -= of_column * factors[k];
    }
  }
  for (std::size_t b = 0; b < kBlocks; ++b) store(rest[b], vector + first + b * kRows);
}

}  // namespace

SWARM_WIDE void inner_products(const LongColumns& columns, const double* vector, double* out) {
  std::size_t k = 0;
  for (; k + 4 <= columns.count; k += 4)
    some_products<4>(columns.data + k * columns.rows, columns.rows, vector, out + k);
  for (; k < columns.count; ++k) some_products<1>(columns.data + k * columns.rows, columns.rows, vector, out + k);
}

SWARM_WIDE void take_away(const LongColumns& columns, const double* factors, double* vector) {
  std::size_t first = 0;
  for (; first + 4 * kRows <= columns.rows; first += 4 * kRows) take_away_rows<4>(columns, first, factors, vector);
  for (; first < columns.rows; first += kRows) take_away_rows<1>(columns, first, factors, vector);
}

}  // namespace swarm
