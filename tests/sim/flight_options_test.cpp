// What of a world and of its options becomes of a robot's daemons: who knows the map, and where maps are kept.
#include "swarm_sim/hosts/flight_options.h"

#include <octomap/octomap.h>

#include "lcmtypes/bus/option_set.h"
#include "map_daemon/octomap_file.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

World ranging_world(const std::string& known_map) {
  World world;
  world.space = {{-4, -4, 0}, {4, 4, 3}};
  world.robots.resize(2);
  for (int k = 0; k < 2; ++k) {
    WorldRobot& robot = world.robots[static_cast<std::size_t>(k)];
    robot.id = 3 + k;
    robot.start = {-2.0, k == 0 ? -1.0 : 1.0, 1.0};
    robot.mission[0].position = {2.0, robot.start.y(), 1.0};
  }
  world.sensor.kind = "lidar";
  world.sensor.known_map = known_map;
  world.static_map = "wall.bt";
  return world;
}

// Whoever knows the map is told that all else may move; whoever does not finds out.
TEST(FlightOptions, WhoKnowsTheMapDoesNotExplore) {
  for (const bool known : {true, false}) {
    SCOPED_TRACE(known);
    const World world = ranging_world(known ? "whole" : "none");
    const std::string map = known ? "wall.bt" : "";
    const FlightOptions options;
    const WorldRobot& robot = world.robots[0];
    EXPECT_EQ(perception_config(world, robot, options).perception.explores, !known);
    EXPECT_EQ(perception_config(world, robot, options).perception.static_map, map);
    EXPECT_EQ(perception_config(world, robot, options).map, "");
    EXPECT_EQ(map_config(world, robot, options).static_map, map);
    EXPECT_EQ(planner_config(world, robot, options).planner.static_map, map);
    EXPECT_EQ(map_config(world, robot, options).explores, !known);
    EXPECT_EQ(planner_config(world, robot, options).planner.explores, !known);
  }
}

TEST(FlightOptions, MapsAreKeptByRangeSensorsOnly) {
  FlightOptions options;
  options.kept_maps = "maps";
  World world = ranging_world("none");
  check_robots(world, options);
  EXPECT_EQ(perception_config(world, world.robots[1], options).map, "maps/robot4.bt");
  world.sensor.kind = "perfect";
  EXPECT_THROW(check_robots(world, options), OptionError);
}

// What a robot saw of a wall in one flight, its guidance knows in the next one; the other robot's is its own.
TEST(FlightOptions, MapsAreKeptFromFlightToFlight) {
  if (kSanitized) GTEST_SKIP() << "scans take too long";
  TemporaryDirectory directory;
  octomap::OcTree wall(0.1);
  for (float y = -3.95f; y < 4; y += 0.1f) {
    for (float z = 0.05f; z < 3; z += 0.1f) wall.updateNode(octomap::point3d(0.05f, y, z), true);
  }
  wall.updateInnerOccupancy();
  ASSERT_TRUE(wall.writeBinary((directory / "wall.bt").string()));
  World world = ranging_world("none");
  world.static_map = directory / "wall.bt";
  FlightOptions options;
  options.kept_maps = directory / "maps";
  std::filesystem::create_directory(options.kept_maps);
  const std::string kept = directory / "maps/robot3.bt";
  EXPECT_EQ(planner_config(world, world.robots[0], options).planner.static_map, "");
  options.time_limit_s = 1.5;
  const OccupiedCubes cubes = OccupiedCubes::load(world.static_map);
  (void)run_lockstep(world, &cubes, options, {}, nullptr, nullptr, nullptr);

  for (const WorldRobot& robot : world.robots)
    EXPECT_EQ(planner_config(world, robot, options).planner.static_map, perception_config(world, robot, options).map);
  const auto map = read_octomap(kept);
  const auto* stands = map->search(0.05, -1.0, 1.0);
  ASSERT_NE(stands, nullptr) << "the wall straight ahead is not known";
  EXPECT_TRUE(map->isNodeOccupied(stands));
  const auto* free = map->search(-1.0, -1.0, 1.0);
  ASSERT_NE(free, nullptr);
  EXPECT_FALSE(map->isNodeOccupied(free));
  EXPECT_EQ(map->search(1.0, -1.0, 1.0), nullptr) << "nothing is known behind the wall";
}

// By one roster or in cells.
TEST(FlightOptions, ManyRobotsFlyInCells) {
  World world = make_world(Task::kRandom, Environment::kEmpty, 0, 1, {.robots = 61, .space_m = {40, 40, 4}});
  FlightOptions options;
  EXPECT_THROW(check_robots(world, options), OptionError);
  options.cells_m = 8;
  check_robots(world, options);
  EXPECT_EQ(broadcast_config(world, world.robots[0], options).cell_m, 8);
  EXPECT_TRUE(broadcast_config(world, world.robots[0], options).roster.empty());
  const KeeperConfig keeper = keeper_config(world, options);
  EXPECT_TRUE((keeper.space_min.array() < -20).head(2).all() && (keeper.space_max.array() > 20).head(2).all());
}

}  // namespace
}  // namespace swarm::test
