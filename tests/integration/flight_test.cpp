// Whole flights in lock-step through worlds that matter: the paper's, recorded pedestrians, a real building.
#include <gtest/gtest.h>

#include <filesystem>

#include "lcmtypes/bus/temporary_directory.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/walls.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"

namespace swarm {
namespace {

const std::filesystem::path kData = SWARM_TEST_DATA;

// Flies it and expects success, and eight plans a second: ten are made while nothing comes into the way, fewer where
// they wait for each other.
void fly(const World& world, const OccupiedCubes* static_map = nullptr, const FlightOptions& options = {}) {
  const RunReport report = run_lockstep(world, static_map, options, LockstepDelays(), nullptr, nullptr, nullptr);
  EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
  for (const RobotReport& robot : report.robots) EXPECT_GE(robot.plan_rate_hz, 3.5);
}

TEST(FlightTest, CrossesAmongColumnsAndRings) {
  fly(make_world(Task::kCross, Environment::kMixed, 20, 7, {}));
}

TEST(FlightTest, SwapsSidesAmongColumns) {
  fly(make_world(Task::kBilateral, Environment::kPure, 20, 5, {}));
}

TEST(FlightTest, EightRobotsSwapPlacesOnACircle) {
  fly(make_world(Task::kCircle, Environment::kEmpty, 0, 1, {.robots = 8, .circle_m = 5.0}));
}

TEST(FlightTest, PassesRecordedPedestriansBelowHeadHeight) {
  const auto file = kData / "worlds" / "crowd-zara02-0.json";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is absent";
  fly(read_world(file));
}

// Through doors of about 0.65 m: two pairs swap rooms across a corridor.
TEST(FlightTest, FliesRoomToRoomInARealBuilding) {
  const auto map = kData / "geb079.bt";
  if (!std::filesystem::exists(map)) GTEST_SKIP() << map << " is absent";
  World world;
  world.name = "building";
  world.space = {{-8.0, -7.5, 0.0}, {31.0, 7.5, 2.2}};
  world.static_map = map;
  const Eigen::Vector3d rooms[4] = {{0.5, 3.0, 1.3}, {-4.3, -2.6, 1.3}, {17.1, 3.0, 1.3}, {15.7, -2.8, 1.3}};
  for (int id = 0; id < 4; ++id) world.robots.push_back({id, rooms[id], {{rooms[id ^ 1]}}, 0.12});
  const OccupiedCubes cubes = OccupiedCubes::load(map);
  check_world(world);
  check_starts(world, cubes);
  fly(world, &cubes);
}

// From room to room of a hall among columns that move, in wind, by what their LiDARs see from where they take
// themselves to be, with a radio that loses a tenth.
TEST(FlightTest, FliesThroughAHallByItsOwnEyes) {
  const TemporaryDirectory scratch("swarm_test");
  World world =
      with_walls_in_file(make_world(Task::kHall, Environment::kPure, 15, 79003, {.robots = 4}), scratch.path());
  world.vehicle.kind = "quadrotor";
  world.vehicle.wind_mps = 3.0;
  world.sensor.kind = "lidar";
  world.sensor.pose_noise_m = 0.02;
  world.sensor.pose_noise_deg = 0.3;
  FlightOptions options;
  options.link.delay_ms = 50.0;
  options.link.jitter_ms = 25.0;
  options.link.loss = 0.1;
  const OccupiedCubes cubes = OccupiedCubes::load(world.static_map);
  fly(world, &cubes, options);
}

}  // namespace
}  // namespace swarm
