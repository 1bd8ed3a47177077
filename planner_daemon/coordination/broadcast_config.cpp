#include "planner_daemon/coordination/broadcast_config.h"

#include <iterator>
#include <set>

#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr double kLeastCell_m = 1.0;  // smaller ones are so many that no announcement holds them

}  // namespace

void declare(OptionSet& options, BroadcastConfig& config) {
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("roster", &config.roster, 0, 32767, "ids of all robots that fly; this one may be among them");
  options.add("cells", &config.cell_m, 0, 1000, "m",
              "flies in cells with edges of this, each with a keeper, and by no roster; 0: by the roster");
  options.add("radius", &config.radius_m, 0.01, 10, "m", "of the sphere that holds the robot");
  declare(options, config.limits);
  options.add("separation", &config.separation_m, 0, 10, "m", "kept between the surfaces of committed motions");
  options.add("announce-period", &config.announce_s, 0.005, 10, "s", "repetition of the announcement");
  options.add("rest-period", &config.rest_s, 0.005, 10, "s", "repetition of the announcement while the robot hovers");
  options.add("lively-period", &config.lively_s, 0.005, 10, "s",
              "repetition right after news, as long as peers wait for them: they may get lost");
  options.add("swarm-rate", &config.swarm_rate_hz, 1, 100'000, "Hz",
              "announcements of all robots of the roster together, in cells of the robot and its peers, at most");
  options.add("give-up-after", &config.give_up_after_s, 0, 1e6, "s",
              "a peer that was not heard for so long, 10 s after the start one that was never heard: once the majority "
              "of robots did not hear it, the others go on around it; 0: they wait for it for ever");
  options.add("setpoint-rate", &config.setpoint_rate_hz, 1, 1000, "Hz", "of setpoints");
  options.add("yaw-rate-max", &config.yaw_rate_max_radps, 0, 100, "rad/s",
              "how fast the robot turns to where it will be in 1.5 s, for there its camera has to look");
  options.add("error-bound", &config.error_bound_m, 0, 5, "m",
              "that the robot's radius grows by at most, by how far it lately was from its motion");
  options.add("off-course", &config.off_course_m, 0.05, 100, "m",
              "farther from its motion the robot has lost it: it brakes and goes on from where it is");
  options.add("space-min", &config.flight.space_min, -1e5, 1e5, "m",
              "flight space of the robot's centre, lower corner: who leaves it is led home");
  options.add("space-max", &config.flight.space_max, -1e5, 1e5, "m",
              "flight space of the robot's centre, upper corner");
  options.add("fence", &config.flight.fence_m, 0, 100, "m", "so far out of the flight space it is left");
  options.add("vertical-speed", &config.flight.vertical_mps, 0.1, 5, "m/s",
              "straight up from the ground and down to it, at most");
  options.add("battery-home", &config.flight.battery_home, 0, 1, "", "with less of it the robot flies home and lands");
  options.add("battery-land", &config.flight.battery_land, 0, 1, "", "with less of it the robot lands where it is");
  options.add("clock-error", &config.clock_error_s, 0, 1, "s",
              "clocks of two robots differ by at most this: motions are kept apart for it, and nothing is committed "
              "beyond it");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s",
              "the robot's own messages from further in the future are refused");
  options.add("state-dir", &config.state_dir,
              "directory, in memory as /run, where the robot's promises survive a crash of the daemon; none: they do "
              "not");
}

void verify(const BroadcastConfig& config) {
  verify(config.limits);
  for (int axis = 0; axis < 3; ++axis) {
    if (config.flight.space_min[axis] >= config.flight.space_max[axis])
      throw OptionError("--space-min: must be below --space-max on every axis");
  }
  if (config.flight.battery_land > config.flight.battery_home)
    throw OptionError("--battery-land: must be at most --battery-home");
  if (config.cell_m > 0.0 && !config.roster.empty())
    throw OptionError("--cells: who flies in cells must have no --roster");
  if (config.cell_m > 0.0 && config.cell_m < kLeastCell_m)
    throw OptionError("--cells: " + text_of(config.cell_m) + " m; must be at least " + text_of(kLeastCell_m) +
                      " m, or 0");
  std::set<int> robots(config.roster.begin(), config.roster.end());
  robots.insert(config.robot_id);
  if (std::ssize(robots) > kMaxRosterRobots) {
    throw OptionError("--roster: " + std::to_string(robots.size()) + " robots; at most " +
                      std::to_string(kMaxRosterRobots));
  }
}

}  // namespace swarm
