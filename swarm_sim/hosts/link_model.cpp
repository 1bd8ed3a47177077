#include "swarm_sim/hosts/link_model.h"

#include <algorithm>

namespace swarm {

bool LinkOptions::perfect() const {
  return delay_ms == 0.0 && jitter_ms == 0.0 && loss == 0.0 && duplicate == 0.0 && reorder == 0.0 && outages.empty();
}

LinkModel::LinkModel(const LinkOptions& options, std::uint64_t seed) : options_(options), random_(seed) {}

std::span<const Duration> LinkModel::deliveries(int from_id, int to_id, double t_s) {
  delays_.clear();
  if (is_out(options_.outages, from_id, t_s) || is_out(options_.outages, to_id, t_s)) return {};
  if (random_.uniform() < options_.loss) return {};
  const int copies = random_.uniform() < options_.duplicate ? 2 : 1;
  for (int copy = 0; copy < copies; ++copy) {
    double delay_ms = std::max(0.0, options_.delay_ms + options_.jitter_ms * (2.0 * random_.uniform() - 1.0));
    if (random_.uniform() < options_.reorder) delay_ms += LinkOptions::kHeldBack_ms * random_.uniform();
    delays_.emplace_back(static_cast<std::int64_t>(1e3 * delay_ms));
  }
  return delays_;
}

}  // namespace swarm
