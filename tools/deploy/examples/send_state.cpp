// Where the robot is, 50 times a second: send_state [BUS [ROBOT]]
#include <chrono>
#include <cstdlib>
#include <thread>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/node_clock.h"

int main(int argc, char** argv) {
  swarm::LcmBus bus(argc > 1 ? argv[1] : swarm::kDefaultOnboardUrl);
  swarm::HeaderSource headers(argc > 2 ? std::atoi(argv[2]) : 0, swarm::new_boot());
  for (std::vector<std::uint8_t> bytes;; std::this_thread::sleep_for(std::chrono::milliseconds(20))) {
    sogm_swarm::robot_state_t state{};
    state.header = headers.next(swarm::wall_utime());  // when this was measured
    state.position[2] = 1.0;                           // W [m]: from your odometry or motion capture
    swarm::encode(state, &bytes);
    if (!bus.publish("ROBOT_STATE", bytes)) return 1;
  }
}
