// What moves around the robot, 10 times a second: send_obstacles [BUS [ROBOT]]
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
  for (std::vector<std::uint8_t> bytes;; std::this_thread::sleep_for(std::chrono::milliseconds(100))) {
    sogm_swarm::obstacle_t person{};
    person.id = 7;  // stays the same as long as you track it
    person.shape = sogm_swarm::obstacle_t::kColumn;
    person.position[0] = 1.5, person.position[1] = 0.1, person.position[2] = 0.95;  // W [m]: of its middle
    person.size[0] = 0.6, person.size[1] = 1.9;                                     // diameter, height [m]
    sogm_swarm::obstacles_t all{};
    all.header = headers.next(swarm::wall_utime());
    all.obstacles = {person};
    all.num_obstacles = 1;  // none: an empty message says so
    all.complete = true;    // what is missing is gone; false, for sensors: it may only be out of sight
    swarm::encode(all, &bytes);
    if (!bus.publish("OBSTACLES", bytes)) return 1;
  }
}
