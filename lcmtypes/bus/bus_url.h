// Which bus is where: an LCM URL each. Buses differ by port, since LCM hears all multicast groups of its port.
#pragma once

#include <string>

namespace swarm {

// On a robot's own computer the defaults will do; where several robots share one, robot k uses port 7700 + k onboard.
inline constexpr int kDefaultBasePort = 7667;
inline constexpr char kDefaultOnboardUrl[] = "udpm://239.255.76.67:7700?ttl=0";
inline constexpr char kDefaultSwarmUrl[] = "udpm://239.255.76.68:7667?ttl=1";

// The buses of a swarm on one computer: `base_port` for the one between the robots, base_port + 33 + k for the one
// inside robot k. `ttl` 0 never leaves the computer.
std::string swarm_bus_url(int base_port, int ttl = 0);
std::string onboard_bus_url(int base_port, int robot_id);

}  // namespace swarm
