// Which bus is where: an LCM URL each. Buses differ by port, since LCM's own programs hear all multicast groups of
// theirs.
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

// A checked udpm://ADDRESS:PORT?ttl=N&recv_buf_size=N.
struct UdpmUrl {
  std::string group;              // multicast address, 224.0.0.0 to 239.255.255.255
  int port = 0;                   // [1, 65535]
  int ttl = 0;                    // [0, 255]; 0 stays in this computer both ways, 1 in the local network
  int recv_buf_size = 2'097'152;  // asked of the kernel [bytes], [4096, 2^30]: all fragments of a message must fit

  // Throws std::invalid_argument with the URL and what is wrong with it.
  static UdpmUrl parse(const std::string& url);
  std::string to_string() const;  // names every parameter

  // Whether it connects programs of one computer only: nothing is sent to, or taken from, the network.
  bool is_local() const { return ttl == 0; }
};

}  // namespace swarm
