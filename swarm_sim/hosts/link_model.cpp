#include "swarm_sim/hosts/link_model.h"

#include <algorithm>

#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
bool LinkOptions::perfect() const {
  return delay_ms == 0.0 && jitter_ms == 0.0 && loss == 0.0 && duplicate == 0.0 && reorder == 0.0 && outages.empty();
}

std::vector<LinkOutage> parse_outages(const std::string& text) {
  std::vector<LinkOutage> outages;
  if (text.empty()) return outages;
  for (const std::string& item : split(text, ',')) {
    const std::vector<std::string> parts = split(item, ':');
    LinkOutage outage;
    if (parts.size() != 3 || !read_amount(parts[0], &outage.robot_id) || !read_amount(parts[1], &outage.from_s) ||
        !read_amount(parts[2], &outage.to_s) || outage.from_s >= outage.to_s) {
      throw OptionError("'" + item + "' must be ROBOT:FROM_S:TO_S with 0 <= FROM_S < TO_S");
    }
    outages.push_back(outage);
  }
  return outages;
}

LinkModel::LinkModel(const LinkOptions& options, std::uint64_t seed) : options_(options), random_(seed) {}

bool LinkModel::out(int robot_id, double t_s) const {
  return std::any_of(options_.outages.begin(), options_.outages.end(), [&](const LinkOutage& outage) {
    return outage.robot_id == robot_id && t_s >= outage.from_s && t_s < outage.to_s;
  });
}

std::span<const Duration> LinkModel::deliveries(int from_id, int to_id, double t_s) {
  delays_.clear();
  if (out(from_id, t_s) || out(to_id, t_s) || random_.uniform() < options_.loss) return {};
  const int copies = random_.uniform() < options_.duplicate ? 2 : 1;
  for (int copy = 0; copy < copies; ++copy) {
    double delay_ms = std::max(0.0, options_.delay_ms + options_.jitter_ms * (2.0 * random_.uniform() - 1.0));
    if (random_.uniform() < options_.reorder) delay_ms += LinkOptions::kHeldBack_ms * random_.uniform();
    delays_.emplace_back(static_cast<std::int64_t>(1e3 * delay_ms));
  }
  return delays_;
}

}  // namespace swarm
