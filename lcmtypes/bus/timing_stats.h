// What many durations have in common.
#pragma once

#include <cstdint>
#include <vector>

namespace swarm {

// Percentiles are of the nearest rank; all 0 when there are no samples.
struct TimingStats {
  std::int64_t count = 0;
  double mean_ms = 0.0, p50_ms = 0.0, p95_ms = 0.0, p99_ms = 0.0, max_ms = 0.0;
};
TimingStats timing_stats(std::vector<double> samples_ms);

}  // namespace swarm
