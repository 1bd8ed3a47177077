// Where the robot is, 50 times a second: send_state [BUS [ROBOT]]. This one is where its setpoints say.
#include <algorithm>
#include <array>
#include <chrono>
#include <thread>

#include "arguments.h"
#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node_clock.h"

int main(int argc, char** argv) {
  int robot = 0;
  swarm::LcmBus bus = open_bus(argc, argv, &robot);
  swarm::HeaderSource headers(robot, swarm::new_boot());
  std::array<double, 3> position{0.0, 0.0, 1.0};  // W [m]
  bus.subscribe("SETPOINT", [&](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::setpoint_t setpoint;
    if (swarm::decode(bytes, &setpoint) == swarm::Refusal::kNone && setpoint.header.robot_id == robot)
      std::ranges::copy(setpoint.position, position.begin());
  });
  for (std::vector<std::uint8_t> bytes;; std::this_thread::sleep_for(std::chrono::milliseconds(20))) {
    sogm_swarm::robot_state_t state{};
    bus.drain();
    state.header = headers.next(swarm::wall_utime());  // when this was measured
    std::ranges::copy(position, state.position);       // yours: from odometry or motion capture
    swarm::encode(state, &bytes);
    if (!bus.publish("ROBOT_STATE", bytes)) return 1;
  }
}
