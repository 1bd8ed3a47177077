// What the flight controller shall do, 100 times a second: take_setpoints [BUS [ROBOT]]
#include <poll.h>

#include <iostream>

#include "arguments.h"
#include "lcmtypes/bus/codec.h"

int main(int argc, char** argv) {
  int robot = 0;
  swarm::LcmBus bus = open_bus(argc, argv, &robot);
  bus.subscribe("SETPOINT", [robot](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::setpoint_t setpoint;
    if (swarm::decode(bytes, &setpoint) != swarm::Refusal::kNone) return;  // damaged: the next one comes in 10 ms
    if (setpoint.header.robot_id != robot) return;
    const auto& [x, y, z] = setpoint.position;  // W [m]; velocity, acceleration, jerk, yaw, yaw_rate
    std::cout << x << ' ' << y << ' ' << z << std::endl;
  });
  for (pollfd pending{bus.fd(), POLLIN, 0}; ::poll(&pending, 1, -1) >= 0;) bus.drain();
}
