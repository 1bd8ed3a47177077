#include "swarm_sim/hosts/flight_options.h"

#include <algorithm>

#include "lcmtypes/bus/option_set.h"

namespace swarm {
namespace {

constexpr double kSideRoom_m = 1.0;
constexpr double kCellRoom_m = 5.0;  // beyond the space, where who steps aside may be

std::string known_map(const World& world) {
  return world.sensor.known_map == "none" ? std::string() : world.static_map.string();
}

// Where the robot keeps its map.
std::string kept_map(const WorldRobot& robot, const FlightOptions& options) {
  return options.kept_maps.empty() ? std::string()
                                   : (options.kept_maps / ("robot" + std::to_string(robot.id) + ".bt")).string();
}

// The map that the robot's guidance begins with: of an earlier flight, where it knows no other.
std::string map_of_guidance(const World& world, const WorldRobot& robot, const FlightOptions& options) {
  const std::string known = known_map(world), kept = kept_map(robot, options);
  return known.empty() && !kept.empty() && std::filesystem::exists(kept) ? kept : known;
}

}  // namespace

MapConfig map_config(const World& world, const WorldRobot& robot, const FlightOptions& options) {
  MapConfig config = options.map;
  config.robot_id = robot.id;
  config.static_map = known_map(world);
  config.v_max_mps = limits_of(world, robot).v_max_mps;
  config.a_max_mps2 = limits_of(world, robot).stopping_mps2();
  config.perception = config.perception || world.sensor.is_ranging();
  config.explores = world.sensor.known_map == "none";
  return config;
}

PerceptionNodeConfig perception_config(const World& world, const WorldRobot& robot, const FlightOptions& options) {
  PerceptionNodeConfig config = options.perception;
  config.robot_id = robot.id;
  config.map = kept_map(robot, options);
  config.perception.static_map = known_map(world);
  config.perception.explores = world.sensor.known_map == "none";
  return config;
}

PlannerNodeConfig planner_config(const World& world, const WorldRobot& robot, const FlightOptions& options) {
  PlannerNodeConfig config = options.planner;
  config.robot_id = robot.id;
  config.planner.space.radius_m = robot.radius_m;
  config.planner.static_map = map_of_guidance(world, robot, options);
  config.planner.explores = world.sensor.known_map == "none";
  SearchLimits& limits = config.planner.limits;
  static_cast<MotionLimits&>(limits) = limits_of(world, robot);
  // The ground and the ceiling are solid. The sides are not: starts and goals may lie on them, and a robot needs room
  // to step back.
  limits.space_min = world.space.min + Eigen::Vector3d(-kSideRoom_m, -kSideRoom_m, robot.radius_m);
  limits.space_max = world.space.max + Eigen::Vector3d(kSideRoom_m, kSideRoom_m, -robot.radius_m);
  return config;
}

BroadcastConfig broadcast_config(const World& world, const WorldRobot& robot, const FlightOptions& options) {
  BroadcastConfig config = options.broadcast;
  config.robot_id = robot.id;
  config.radius_m = robot.radius_m;
  config.limits = limits_of(world, robot);
  config.roster.clear();
  config.cell_m = options.cells_m;
  if (config.cell_m > 0.0) return config;
  const auto is_stranger = [&options](int id) {
    return std::ranges::find(options.strangers, id) != options.strangers.end();
  };
  for (const WorldRobot& other : world.robots)
    if (!is_stranger(other.id) && !is_stranger(robot.id)) config.roster.push_back(other.id);
  return config;
}

KeeperConfig keeper_config(const World& world, const FlightOptions& options) {
  KeeperConfig config;
  config.cell_m = options.cells_m;
  config.space_min = world.space.min.array() - kCellRoom_m;
  config.space_max = world.space.max.array() + kCellRoom_m;
  config.clock_error_s = options.broadcast.clock_error_s;
  return config;
}

std::size_t index_of_robot(const World& world, int id, const char* option) {
  const auto robot = std::ranges::find(world.robots, id, &WorldRobot::id);
  if (robot == world.robots.end())
    throw OptionError(std::string(option) + ": the world has no robot " + std::to_string(id));
  return static_cast<std::size_t>(robot - world.robots.begin());
}

std::span<const char* const> daemons_in(const World& world) {
  return std::span(kDaemons).first(kDaemons.size() - (world.sensor.is_ranging() ? 0 : 1));
}

void check_robots(const World& world, const FlightOptions& options) {
  if (!options.kept_maps.empty() && !world.sensor.is_ranging())
    throw OptionError("keep-maps: robots make no maps without --sensor lidar or depth");
  if (options.cells_m == 0.0 && std::ssize(world.robots) > kMaxRosterRobots) {
    throw OptionError("cells: " + std::to_string(world.robots.size()) + " robots; by one roster fly at most " +
                      std::to_string(kMaxRosterRobots) + ", more with --cells");
  }
  for (const Kill& kill : options.kills) {
    if (kill.daemon == Kill::kKeeper && options.cells_m == 0.0)
      throw OptionError("kill: there is no keeper without --cells");
    if (kill.daemon == Kill::kKeeper) continue;
    (void)index_of_robot(world, kill.robot_id, "kill");
    if (kill.daemon >= daemons_in(world).size())
      throw OptionError("kill: robots have no perception_daemon without --sensor lidar or depth");
  }
  for (const ClockStep& step : options.clock_steps) (void)index_of_robot(world, step.robot_id, "clock-step");
  for (const Outage& outage : options.link.outages) (void)index_of_robot(world, outage.robot_id, "link-outage");
  for (const Outage& outage : options.state_outages) (void)index_of_robot(world, outage.robot_id, "state-outage");
  if (options.cells_m > 0.0 && !options.strangers.empty())
    throw OptionError("strangers: with --cells there are no rosters");
  for (const int id : options.strangers) (void)index_of_robot(world, id, "strangers");
}

}  // namespace swarm
