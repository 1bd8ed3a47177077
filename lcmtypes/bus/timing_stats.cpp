#include "lcmtypes/bus/timing_stats.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace swarm {

TimingStats timing_stats(std::vector<double> samples_ms) {
  if (samples_ms.empty()) return {};
  std::ranges::sort(samples_ms);
  const auto n = static_cast<double>(samples_ms.size());
  const auto percentile = [&](double p) {
    return samples_ms[static_cast<std::size_t>(std::max(1.0, std::ceil(p / 100.0 * n))) - 1];
  };
  const double mean = std::accumulate(samples_ms.begin(), samples_ms.end(), 0.0) / n;
  return {static_cast<std::int64_t>(samples_ms.size()),
          mean,
          percentile(50),
          percentile(95),
          percentile(99),
          samples_ms.back()};
}

}  // namespace swarm
