// What the flight controller shall do, 100 times a second: take_setpoints [BUS]
#include <poll.h>

#include <iostream>

#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/lcm_bus.h"

int main(int argc, char** argv) {
  swarm::LcmBus bus(argc > 1 ? argv[1] : swarm::kDefaultOnboardUrl);
  bus.subscribe("SETPOINT", [](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::setpoint_t setpoint;
    if (swarm::decode(bytes, &setpoint) != swarm::Refusal::kNone) return;  // damaged: the next one comes in 10 ms
    const auto& [x, y, z] = setpoint.position;  // W [m]; velocity, acceleration, jerk, yaw, yaw_rate
    std::cout << x << ' ' << y << ' ' << z << std::endl;
  });
  for (pollfd pending{bus.fd(), POLLIN, 0}; ::poll(&pending, 1, -1) >= 0;) bus.drain();
}
