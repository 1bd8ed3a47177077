// Where the robot shall go: send_goal [BUS [ROBOT]]
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
  for (std::vector<std::uint8_t> bytes;; std::this_thread::sleep_for(std::chrono::seconds(1))) {
    sogm_swarm::goal_t goal{};
    goal.header = headers.next(swarm::wall_utime());
    sogm_swarm::waypoint_t& place = goal.waypoints.emplace_back();
    place.position[0] = 3.0, place.position[2] = 1.0;  // W [m]; may change at any time
    goal.num_waypoints = static_cast<std::int32_t>(goal.waypoints.size());
    swarm::encode(goal, &bytes);
    if (!bus.publish("GOAL", bytes)) return 1;  // again and again: a planner may start later
  }
}
