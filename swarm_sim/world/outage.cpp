#include "swarm_sim/world/outage.h"

#include <algorithm>

#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/text.h"

namespace swarm {

std::vector<Outage> parse_outages(const std::string& text) {
  std::vector<Outage> outages;
  if (text.empty()) return outages;
  for (const std::string& item : split(text, ',')) {
    const std::vector<std::string> parts = split(item, ':');
    Outage outage;
    if (parts.size() != 3 || !read_amount(parts[0], &outage.robot_id) || !read_amount(parts[1], &outage.from_s) ||
        !read_amount(parts[2], &outage.to_s) || outage.from_s >= outage.to_s) {
      throw OptionError("'" + item + "' must be ROBOT:FROM_S:TO_S with 0 <= FROM_S < TO_S");
    }
    outages.push_back(outage);
  }
  return outages;
}

bool is_out(std::span<const Outage> outages, int robot_id, double t_s) {
  return std::ranges::any_of(outages, [&](const Outage& outage) {
    return outage.robot_id == robot_id && t_s >= outage.from_s && t_s < outage.to_s;
  });
}

}  // namespace swarm
