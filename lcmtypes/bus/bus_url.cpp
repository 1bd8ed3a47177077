#include "lcmtypes/bus/bus_url.h"

namespace swarm {

std::string swarm_bus_url(int base_port, int ttl) {
  return "udpm://239.255.76.68:" + std::to_string(base_port) + "?ttl=" + std::to_string(ttl);
}

std::string onboard_bus_url(int base_port, int robot_id) {
  return "udpm://239.255.76.67:" + std::to_string(base_port + 33 + robot_id) + "?ttl=0";
}

}  // namespace swarm
