#include "swarm_sim/world/fleet.h"

#include "lcmtypes/bus/text.h"
#include "swarm_sim/world/world.h"

namespace swarm {

void declare(OptionSet& options, Fleet& fleet) {
  options.add("robots", &fleet.robots, 0, kMaxRobots, "",
              "robots of the tasks circle, random, hall and tour; 0: 10, in the hall 8, on a tour 1");
  options.add("radius", &fleet.circle_m, 0, 1000, "m", "of the circle; 0: 10 m");
  options.add("robot-radius", &fleet.robot_m, 0.01, 10, "m", "of each robot");
  options.add("speed", &fleet.limits.v_max_mps, 0.01, 100, "m/s", "limit of every robot, per axis");
  options.add("acceleration", &fleet.limits.a_max_mps2, 0.01, 1000, "m/s^2", "limit of every robot, per axis");
  options.add("jerk", &fleet.limits.j_max_mps3, 0, 1e5, "m/s^3", "limit of every robot, per axis; 0: none");
  declare_thrust(options, fleet.limits);
  options.add("space", &fleet.space_m, 1, 1000, "m", "edges of the space of the task random");
  options.add("goals", &fleet.goals, 1, 100, "", "of each robot of the tasks random and tour, one after the other");
  options.add("hop", &fleet.hop_m, 0, 1000, "m",
              "so far on each axis a robot's next goal of the task random is at most; 0: anywhere");
  options.add("people", &fleet.people,
              "hall: who walks along it, besides: the columns that follow tracks in this world file, or in one of "
              "several FILE,..., "
              "each seed another");
  options.add("building", &fleet.building, "tour: the building, an OctoMap file (.bt or .ot)");
  options.add("low", &fleet.low_m, -1000, 1000, "m", "tour: where the flight space begins");
  options.add("high", &fleet.high_m, -1000, 1000, "m", "tour: and where it ends");
  options.add("obstacle-acceleration", &fleet.obstacle_acceleration_mps2, 0, kMaxObstacleAcceleration_mps2, "m/s^2",
              "of every obstacle, at any time: it goes round a circle in 4 s on top of its uniform motion");
}

std::string command_line(const Fleet& fleet) {
  const auto values = [](const Fleet& f) {
    return NamedValues{{"robots", std::to_string(f.robots)},
                       {"radius", text_of(f.circle_m)},
                       {"robot-radius", text_of(f.robot_m)},
                       {"speed", text_of(f.limits.v_max_mps)},
                       {"acceleration", text_of(f.limits.a_max_mps2)},
                       {"jerk", text_of(f.limits.j_max_mps3)},
                       {"limits", f.limits.kind},
                       {"thrust-min", text_of(f.limits.thrust.least_mps2)},
                       {"thrust-max", text_of(f.limits.thrust.most_mps2)},
                       {"tilt-max", text_of(f.limits.thrust.tilt_deg)},
                       {"space", text_of(f.space_m.x()) + "," + text_of(f.space_m.y()) + "," + text_of(f.space_m.z())},
                       {"goals", std::to_string(f.goals)},
                       {"hop", text_of(f.hop_m)},
                       {"people", f.people},
                       {"building", f.building},
                       {"low", text_of(f.low_m)},
                       {"high", text_of(f.high_m)},
                       {"obstacle-acceleration", text_of(f.obstacle_acceleration_mps2)}};
  };
  return given_options(values(fleet), values({}));
}

}  // namespace swarm
