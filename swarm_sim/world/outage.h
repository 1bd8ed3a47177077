// When something of a robot is silent.
#pragma once

#include <span>
#include <string>
#include <vector>

namespace swarm {

// Of one robot, in [from_s, to_s) of world time.
struct Outage {
  int robot_id = 0;
  double from_s = 0.0, to_s = 0.0;
};

// "ROBOT:FROM_S:TO_S,..."; empty: none. Throws OptionError with the part that is wrong.
std::vector<Outage> parse_outages(const std::string& text);

bool is_out(std::span<const Outage> outages, int robot_id, double t_s);

}  // namespace swarm
