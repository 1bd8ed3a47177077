// Whole flights in lock-step through worlds that matter: the paper's, recorded pedestrians, a real building.
#include <gtest/gtest.h>

#include <filesystem>

#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"

namespace swarm {
namespace {

const std::filesystem::path kData = SWARM_TEST_DATA;

// Flies it and expects success at 10 plans a second or more.
void fly(const World& world, const OccupiedCubes* static_map = nullptr) {
  const RunReport report =
      run_lockstep(world, static_map, FlightOptions(), LockstepDelays(), nullptr, nullptr, nullptr);
  EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
  for (const RobotReport& robot : report.robots) EXPECT_GE(robot.plan_rate_hz, 10.0);
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

}  // namespace
}  // namespace swarm
