// What goes wrong with robots in flight: daemons that are killed, and started again by a supervisor, as systemd would
// do it; clocks that are set.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "swarm_sim/world/clocks.h"

namespace swarm {

// Those of a robot; the last one flies with a depth camera or a LiDAR alone.
inline constexpr std::array<const char*, 4> kDaemons = {"map", "planner", "broadcast", "perception"};

struct Kill {
  static constexpr std::size_t kKeeper = kDaemons.size();  // the keeper_daemon of all cells, of no robot

  std::size_t daemon = 0;  // index into kDaemons, or kKeeper
  int robot_id = 0;
  double at_s = 0.0, back_s = 0.0;  // world times: killed, started again
};

inline constexpr double kRestart_s = 0.1;  // the supervisor's delay

// "DAEMON:ROBOT@AT_S" or "DAEMON:ROBOT@AT_S-BACK_S", and "keeper" in the place of DAEMON:ROBOT, several separated by
// commas; empty: none. Throws OptionError with the part that is wrong.
std::vector<Kill> parse_kills(const std::string& text);

// "ROBOT,...", each once; empty: none. Throws OptionError with the part that is wrong.
std::vector<int> parse_robots(const std::string& text);

// "ROBOT:AT_S:BY_S,...", BY_S below 0 to set it back; empty: none. Throws OptionError with the part that is wrong.
std::vector<ClockStep> parse_clock_steps(const std::string& text);

}  // namespace swarm
