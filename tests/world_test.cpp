// Worlds: motion, files, generator and command. Long because it serves four sources that share its world files.
#include "swarm_sim/world.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numbers>
#include <random>

#include "swarm_sim/occupied_cubes.h"
#include "swarm_sim/world_command.h"
#include "swarm_sim/world_generator.h"
#include "swarm_sim/world_json.h"

namespace swarm {
namespace {

namespace fs = std::filesystem;

// A directory of its own for each test, gone afterwards.
class WorldFiles : public testing::Test {
 protected:
  void SetUp() override {
    directory_ =
        fs::temp_directory_path() / ("swarm_world_test_" + std::to_string(::getpid()) +
                                     std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(directory_);
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }

  fs::path put(const std::string& name, const std::string& text) const {
    std::ofstream(directory_ / name) << text;
    return directory_ / name;
  }
  std::string get(const std::string& name) const {
    std::ifstream in(directory_ / name);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  fs::path directory_;
};

const char* const kGood = R"({"name": "good", "space": {"min": [-8,-8,0], "max": [8,8,4]},
 "limits": {"speed": 2, "acceleration": 6.0},
 "robots": [{"id": 0, "start": [-8,0,1], "goal": [8,0,1], "radius": 0.2}, {"id": 1, "start": [8,1,1], "goal": [-8,1,1.0], "radius": 0.2}],
 "obstacles": [{"shape": "column", "center": [1,2], "diameter": 0.8, "height": 4.0, "velocity": [0.3,-0.2]},
  {"shape": "ring", "center": [0,3,1.2], "radius": 1.5, "width": 0.1, "yaw": 0.4, "velocity": [0.1,0.6]},
  {"shape": "column", "diameter": 0.5, "height": 1.8, "track": [[0.0,1.0,2.0],[0.4,1.3,2.0]]},
  {"shape": "box", "center": [0,-3,1], "size": [1,0.5,2], "yaw": 0.4},
  {"shape": "sphere", "center": [2,-3,1], "diameter": 0.5}]})";

std::string replaced(const std::string& from, const std::string& to) {
  std::string text = kGood;
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

std::string error_of(const std::string& text) {
  try {
    parse_world(text, "w.json", "");
  } catch (const WorldError& error) {
    return error.what();
  }
  return "no error";
}

// Moves in small steps and turns at the border: the meaning of "reflects", without the closed form.
struct Stepped {
  double position, velocity;
  void advance(double low, double high, double dt) {
    position += velocity * dt;
    if (position > high) position = 2 * high - position, velocity = -velocity;
    if (position < low) position = 2 * low - position, velocity = -velocity;
  }
};

TEST(Motion, ReflectionEqualsSteppedSimulation) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int trial = 0; trial < 50; ++trial) {
    World world;
    world.obstacle_bounds = {{-7, -3}, {7, 2}};
    WorldObstacle obstacle;
    obstacle.center = {-7 + 14 * unit(random), -3 + 5 * unit(random), 2.0};
    obstacle.velocity_mps = {4 * unit(random) - 2, 20 * unit(random) - 10};
    Stepped x{obstacle.center.x(), obstacle.velocity_mps.x()}, y{obstacle.center.y(), obstacle.velocity_mps.y()};
    SCOPED_TRACE(testing::Message() << "trial " << trial << " centre " << obstacle.center.transpose() << " velocity "
                                    << obstacle.velocity_mps.transpose());
    constexpr double kDt = 0.01;
    for (int step = 0; step <= 3000; ++step) {
      const auto state = state_at(obstacle, world, step * kDt);
      ASSERT_TRUE(state);
      ASSERT_NEAR(state->position.x(), x.position, 1e-9);
      ASSERT_NEAR(state->position.y(), y.position, 1e-9);
      ASSERT_EQ(state->position.z(), 2.0);
      ASSERT_EQ(state->velocity, Eigen::Vector3d(x.velocity, y.velocity, 0.0)) << "step " << step;
      x.advance(-7, 7, kDt);
      y.advance(-3, 2, kDt);
    }
  }
}

TEST(Motion, ReflectsForwardsBackwardsAndFarAway) {
  World world;
  world.obstacle_bounds = {{-7, -7}, {7, 7}};
  WorldObstacle obstacle;
  obstacle.center = {6, 0, 1};
  obstacle.velocity_mps = {1, 0};
  EXPECT_DOUBLE_EQ(state_at(obstacle, world, 1.5)->position.x(), 6.5);
  EXPECT_EQ(state_at(obstacle, world, 1.5)->velocity.x(), -1.0);
  EXPECT_EQ(state_at(obstacle, world, 1.0)->velocity.x(), -1.0)
      << "at the border the velocity is the one after the turn";
  EXPECT_DOUBLE_EQ(state_at(obstacle, world, -14.0)->position.x(), -6.0);
  EXPECT_NEAR(state_at(obstacle, world, 28e6 + 1.5)->position.x(), 6.5, 1e-8);
  obstacle.velocity_mps = {0, 0};
  obstacle.center = {20, 0, 1};  // stands outside the bounds: stays there
  EXPECT_EQ(state_at(obstacle, world, 5.0)->position, obstacle.center);
}

TEST(Motion, TrackIsLinearBetweenItsPointsAndExistsOnlyThere) {
  WorldObstacle obstacle;
  obstacle.center = {0, 0, 0.9};
  obstacle.track = {{-1, {0, 0}}, {1, {2, 4}}, {3, {2, 0}}};
  const World world;
  EXPECT_FALSE(state_at(obstacle, world, -1.001));
  EXPECT_FALSE(state_at(obstacle, world, 3.001));
  EXPECT_EQ(state_at(obstacle, world, -1)->position, Eigen::Vector3d(0, 0, 0.9));
  EXPECT_EQ(state_at(obstacle, world, 0)->position, Eigen::Vector3d(1, 2, 0.9));
  EXPECT_EQ(state_at(obstacle, world, 0)->velocity, Eigen::Vector3d(1, 2, 0));
  EXPECT_EQ(state_at(obstacle, world, 1)->position, Eigen::Vector3d(2, 4, 0.9));
  EXPECT_EQ(state_at(obstacle, world, 1)->velocity, Eigen::Vector3d(0, -2, 0));
  EXPECT_EQ(state_at(obstacle, world, 3)->position, Eigen::Vector3d(2, 0, 0.9));
  EXPECT_EQ(state_at(obstacle, world, 3)->velocity, Eigen::Vector3d(0, -2, 0));
}

TEST(WorldJson, ReadsEveryField) {
  const World world = parse_world(kGood, "w.json", "");
  EXPECT_EQ(world.name, "good");
  EXPECT_EQ(world.space.max, Eigen::Vector3d(8, 8, 4));
  EXPECT_EQ(world.obstacle_bounds.min, Eigen::Vector2d(-8, -8));
  EXPECT_EQ(world.speed_mps, 2.0);
  EXPECT_EQ(world.acceleration_mps2, 6.0);
  EXPECT_EQ(world.sensing_radius_m, 5.0);
  EXPECT_TRUE(world.static_map.empty());
  ASSERT_EQ(world.robots.size(), 2u);
  EXPECT_EQ(world.robots[1], (WorldRobot{1, {8, 1, 1}, {-8, 1, 1}, 0.2}));
  ASSERT_EQ(world.obstacles.size(), 5u);
  const WorldObstacle& column = world.obstacles[0];
  EXPECT_EQ(column.shape.kind, Shape::Kind::kColumn);
  EXPECT_EQ(column.center, Eigen::Vector3d(1, 2, 2)) << "a column stands on the ground";
  EXPECT_EQ(column.velocity_mps, Eigen::Vector2d(0.3, -0.2));
  EXPECT_EQ(world.obstacles[1].shape.size, Eigen::Vector3d(1.5, 0.1, 0));
  EXPECT_EQ(world.obstacles[1].shape.yaw_rad, 0.4);
  EXPECT_EQ(world.obstacles[2].center, Eigen::Vector3d(1, 2, 0.9));
  EXPECT_EQ(world.obstacles[2].track[1], (TrackPoint{0.4, {1.3, 2.0}}));
  EXPECT_EQ(world.obstacles[3].shape.size, Eigen::Vector3d(1, 0.5, 2));
  EXPECT_EQ(world.obstacles[4].shape.kind, Shape::Kind::kSphere);
}

TEST(WorldJson, OptionalFieldsAndOtherSpellings) {
  World world = parse_world(
      replaced("\"limits\"", R"("obstacle_bounds": {"min": [-7,-6], "max": [7,6]}, "sensing_radius": 4, "limits")"),
      "w.json", "");
  EXPECT_EQ(world.obstacle_bounds.min, Eigen::Vector2d(-7, -6));
  EXPECT_EQ(world.sensing_radius_m, 4.0);
  EXPECT_EQ(parse_world(replaced("\"id\": 1", "\"id\": 7.0"), "w.json", "").robots[1].id, 7);
  EXPECT_EQ(parse_world(replaced("[1,2]", "[1,2,3]"), "w.json", "").obstacles[0].center.z(), 3.0);
  EXPECT_EQ(parse_world(replaced("\"track\"", "\"center\": [1,2,3], \"track\""), "w.json", "").obstacles[2].center.z(),
            3.0);
  EXPECT_NEAR(parse_world(replaced("\"yaw\": 0.4", "\"yaw\": 6"), "w.json", "").obstacles[1].shape.yaw_rad,
              6 - 2 * std::numbers::pi, 1e-15);
}

struct BadCase {
  std::string from, to, error;
};

TEST(WorldJson, RefusesBadInputWithOneClearLine) {
  const std::string robot0 = R"({"id": 0, "start": [-8,0,1], "goal": [8,0,1], "radius": 0.2})";
  std::string crowd;
  for (int i = 0; i < 41; ++i) {
    const std::string id = std::to_string(i), x = std::to_string(i * 0.39 - 8);
    crowd.append(i == 0 ? "[" : ",").append(R"({"id": )").append(id).append(R"(, "start": [)").append(x);
    crowd.append(R"(, 0, 1], "goal": [)").append(x).append(R"(, 1, 1], "radius": 0.1})");
  }
  const std::vector<BadCase> cases = {
      {"\"name\": \"good\"", "\"name\": 3", "name: 3 must be a text of 1 to 100 characters without control characters"},
      {"\"name\": \"good\"", "\"name\": \"a\\nb\"",
       R"(name: "a\nb" must be a text of 1 to 100 characters without control characters)"},
      {"\"name\": \"good\", ", "", "name: is missing and must be given"},
      {"\"name\"", "\"nam\"",
       "\"nam\" is an unknown key; known are name, space, obstacle_bounds, limits, sensing_radius, static_map, robots, "
       "obstacles"},
      {"\"name\"", "\"name\": \"first\", \"name\"", "\"name\": a key must not be given twice"},
      {"\"min\": [-8,-8,0]", "\"min\": [-8,-8]", "space.min: [-8,-8] must be an array of 3 numbers"},
      {"\"min\": [-8,-8,0]", "\"min\": [-8,-8,4]",
       "space: {\"max\":[8,8,4],\"min\":[-8,-8,4]} must be a box with min below max along every axis"},
      {"\"min\": [-8,-8,0]", "\"min\": [-8,NaN,0]", "must be JSON: "},
      {"\"min\": [-8,-8,0]", "\"min\": [-8,1e999,0]", "must be JSON: "},
      {"\"min\": [-8,-8,0]", "\"min\": [-8,-1e9,0]", "space.min[1]: -1000000000.0 must be a number in [-10000, 10000]"},
      {"\"speed\": 2", "\"speed\": 0", "limits.speed: 0 must be a number in (0, 100]"},
      {"\"speed\": 2", "\"speed\": \"2\"", "limits.speed: \"2\" must be a number in (0, 100]"},
      {"\"speed\": 2", "\"speed\": true", "limits.speed: true must be a number in (0, 100]"},
      {"\"acceleration\": 6.0", "\"acceleration\": -6", "limits.acceleration: -6 must be a number in (0, 1000]"},
      {"{\"speed\": 2, \"acceleration\": 6.0}", "[2, 6]", "limits: [2,6] must be an object"},
      {"\"limits\"", "\"obstacle_bounds\": {\"min\": [1,1], \"max\": [0,2]}, \"limits\"",
       "obstacle_bounds: {\"max\":[0,2],\"min\":[1,1]} must be a box with min below max along every axis"},
      {"\"limits\"", "\"obstacle_bounds\": {\"min\": [-1,-1], \"max\": [1,1]}, \"limits\"",
       "obstacles[0].center: [1,2,2] must be inside obstacle_bounds because the obstacle moves"},
      {"\"limits\"", "\"static_map\": \"no.bt\", \"limits\"",
       "static_map: \"no.bt\" must be an existing file, relative to the world file"},
      {"\"limits\"", "\"sensing_radius\": 0, \"limits\"", "sensing_radius: 0 must be a number in (0, 1000]"},
      {"\"radius\": 0.2", "\"radius\": 0", "robots[0].radius: 0 must be a number in (0, 10]"},
      {"\"radius\": 0.2", "\"radius\": -0.2", "robots[0].radius: -0.2 must be a number in (0, 10]"},
      {"\"id\": 1", "\"id\": 0", "robots[1].id: 0 is taken by robots[0]: ids must be unique"},
      {"\"id\": 1", "\"id\": 100", "robots[1].id: 100 must be an integer in [0, 99]"},
      {"\"id\": 1", "\"id\": -1", "robots[1].id: -1 must be an integer in [0, 99]"},
      {"\"id\": 1", "\"id\": 1.5", "robots[1].id: 1.5 must be an integer in [0, 99]"},
      {"\"start\": [8,1,1]", "\"start\": [-7.7,0,1]",
       "robots[1].start: [-7.7,0,1] must be at least the sum of radii from robots[0]"},
      {"\"goal\": [-8,1,1.0]", "\"goal\": [8,0.1,1]",
       "robots[1].goal: [8,0.1,1] must be at least the sum of radii from robots[0]"},
      {"\"start\": [8,1,1]", "\"start\": [8.001,1,1]", "robots[1].start: [8.001,1,1] must be inside space"},
      {"\"goal\": [-8,1,1.0]", "\"goal\": [-8,1,4.1]", "robots[1].goal: [-8,1,4.1] must be inside space"},
      {"\"start\": [8,1,1]", "\"start\": [1.5,2,1]", "robots[1].start: [1.5,2,1] must not touch obstacles[0] at t = 0"},
      {"\"start\": [8,1,1]", "\"start\": [8,1,null]", "robots[1].start[2]: null must be a number in [-10000, 10000]"},
      {"\"start\": [8,1,1]", "\"begin\": [8,1,1]",
       "robots[1]: \"begin\" is an unknown key; known are id, start, goal, radius"},
      {"\"shape\": \"column\"", "\"shape\": \"cone\"",
       "obstacles[0].shape: \"cone\" must be one of column, ring, box, sphere"},
      {"\"diameter\": 0.8", "\"diameter\": -0.8", "obstacles[0].diameter: -0.8 must be a number in (0, 1000]"},
      {"\"diameter\": 0.8, ", "", "obstacles[0].diameter: is missing and must be given"},
      {"\"diameter\": 0.8", "\"width\": 0.8",
       "obstacles[0]: \"width\" is an unknown key; known are shape, center, diameter, height, velocity, track"},
      {"\"width\": 0.1", "\"width\": 3.1", "obstacles[1].width: 3.1 must be at most twice the ring's radius"},
      {"\"center\": [0,3,1.2]", "\"center\": [0,3]", "obstacles[1].center: [0,3] must be an array of 3 numbers"},
      {"\"center\": [1,2], ", "", "obstacles[0].center: is missing and must be given"},
      {"[0.3,-0.2]", "[300,-0.2]", "obstacles[0].velocity[0]: 300 must be a number in [-100, 100]"},
      {"[0.4,1.3,2.0]", "[0.0,1.3,2.0]", "obstacles[2].track[1]: 0 must be later than the point before"},
      {",[0.4,1.3,2.0]", "", "obstacles[2].track: [[0.0,1.0,2.0]] must be an array of at least two points (t, x, y)"},
      {"[0.4,1.3,2.0]", "[0.4,1.3]", "obstacles[2].track[1]: [0.4,1.3] must be an array of 3 numbers"},
      {"\"track\"", "\"velocity\": [0,0], \"track\"",
       "obstacles[2].velocity: [0,0] must be absent: the track tells the motion"},
      {"\"track\"", "\"center\": [0,2,1], \"track\"",
       "obstacles[2].center: [0,2,1] must be at the first point of the track"},
      {"\"shape\": \"sphere\"", "\"shape\": 1",
       "obstacles[4].shape: 1 must be a text of 1 to 100 characters without control characters"},
      {"{\"shape\": \"sphere\", \"center\": [2,-3,1], \"diameter\": 0.5}", "7", "obstacles[4]: 7 must be an object"},
      {"[" + robot0 + R"(, {"id": 1, "start": [8,1,1], "goal": [-8,1,1.0], "radius": 0.2}])", "[]",
       "robots: 0 robots must be in [1, 40]"},
      {"[" + robot0 + R"(, {"id": 1, "start": [8,1,1], "goal": [-8,1,1.0], "radius": 0.2}])", crowd + "]",
       "robots: 41 robots must be in [1, 40]"},
      {"[" + robot0, "{}, [" + robot0, "must be JSON: "},
      {kGood, "[]", "[] must be an object"},
      {kGood, "", "must be JSON: "},
  };
  for (const BadCase& bad : cases) {
    const std::string error = error_of(replaced(bad.from, bad.to));
    const bool syntax = bad.error == "must be JSON: ";  // what follows is the library's own wording
    EXPECT_EQ(syntax ? error.substr(0, 22) : error, "w.json: " + bad.error) << bad.from << " -> " << bad.to;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  }
}

TEST(WorldJson, BordersAndTouchingAreAllowed) {
  EXPECT_NO_THROW(parse_world(replaced("[8,1,1]", "[8,-8,4]"), "w.json", ""));
  EXPECT_NO_THROW(parse_world(replaced("\"start\": [8,1,1]", "\"start\": [-7.6,0,1]"), "w.json", ""));
}

TEST(WorldJson, LongValuesAreCutInMessages) {
  const std::string error = error_of(replaced("\"good\"", "\"" + std::string(5000, 'x') + "\""));
  EXPECT_LT(error.size(), 200u);
  EXPECT_EQ(error.find('\n'), std::string::npos);
}

TEST_F(WorldFiles, MissingFilesAndDirectoriesAreRefusedByName) {
  const std::string rule = ": must be a readable world file";
  for (const fs::path& path : {directory_ / "none.json", directory_}) {
    try {
      read_world(path);
      FAIL();
    } catch (const WorldError& error) {
      EXPECT_EQ(error.what(), path.string() + rule);
    }
  }
}

TEST_F(WorldFiles, StaticMapIsRelativeToTheWorldFile) {
  put("map.bt", "x");
  fs::create_directories(directory_ / "deep");
  const fs::path path = put("deep/w.json", replaced("\"limits\"", "\"static_map\": \"../map.bt\", \"limits\""));
  const World world = read_world(path);
  EXPECT_EQ(world.static_map, directory_ / "map.bt");
  const std::string elsewhere = to_json_text(world, directory_);
  EXPECT_NE(elsewhere.find("\"static_map\": \"map.bt\""), std::string::npos) << elsewhere;
  EXPECT_EQ(parse_world(elsewhere, "again", directory_), world);
}

TEST_F(WorldFiles, WritingReadsBackAsTheSameWorld) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int trial = 0; trial < 100; ++trial) {
    World world = parse_world(kGood, "w.json", "");
    world.space = {{-9 + unit(random), -9 + unit(random), unit(random) - 1},
                   {9 + unit(random), 9 + unit(random), 5 + unit(random)}};
    world.obstacle_bounds = {{-7 + unit(random), -7}, {7 + unit(random), 7}};
    world.speed_mps = 2 + unit(random);
    world.sensing_radius_m = 2 + unit(random);
    for (WorldObstacle& obstacle : world.obstacles) {
      obstacle.shape.size *= 1 + 0.1 * unit(random);
      const bool on_ground = unit(random) < 0 && obstacle.shape.kind == Shape::Kind::kColumn;
      obstacle.center.z() = on_ground ? 0.5 * obstacle.shape.size.y() : 1 + unit(random);
      if (obstacle.shape.kind == Shape::Kind::kRing || obstacle.shape.kind == Shape::Kind::kBox)
        obstacle.shape.yaw_rad = 3 * unit(random);
      if (obstacle.track.empty()) obstacle.velocity_mps = {unit(random), unit(random)};
    }
    const std::string text = to_json_text(world, directory_);
    EXPECT_EQ(parse_world(text, "again", directory_), world) << text;
    EXPECT_EQ(to_json_text(parse_world(text, "again", directory_), directory_), text);
  }
  World a = parse_world(kGood, "w.json", ""), b = a;
  b.obstacles[1].shape.yaw_rad = std::nextafter(b.obstacles[1].shape.yaw_rad, 1.0);
  EXPECT_FALSE(a == b) << "the comparison itself must see a last bit";
}

TEST_F(WorldFiles, ExampleWorldsAreAccepted) {
  const fs::path examples = fs::path(SWARM_SHARED_DIR) / "data/worlds";
  if (!fs::exists(examples)) GTEST_SKIP() << "no example worlds at " << examples;
  int count = 0;
  for (const auto& entry : fs::directory_iterator(examples)) {
    const World world = read_world(entry.path());
    EXPECT_EQ(world.robots.size(), 4u) << entry.path();
    EXPECT_GT(world.obstacles.size(), 10u) << entry.path();
    EXPECT_EQ(parse_world(to_json_text(world, directory_), "again", directory_), world) << entry.path();
    ++count;
  }
  EXPECT_GT(count, 0);
}

TEST_F(WorldFiles, StartsInTheStaticMapAreRefused) {
  const World world = parse_world(kGood, "w.json", "");
  const OccupiedCubes touching({{{8, 1.25, 1}, 0.08}}), clear({{{8, 1.29, 1}, 0.08}});
  EXPECT_NO_THROW(check_starts(world, clear));
  try {
    check_starts(world, touching);
    FAIL();
  } catch (const WorldError& error) {
    EXPECT_STREQ(error.what(), "robots[1].start: [8,1,1] must not touch the static map");
  }
}

TEST(Generator, TasksHaveThePapersPositions) {
  const auto ends = [](Task task) {
    std::vector<std::array<double, 4>> all;
    for (const WorldRobot& r : make_world(task, Environment::kEmpty, 0, 1).robots) {
      EXPECT_EQ(r.start.z(), 1.0);
      EXPECT_EQ(r.goal.z(), 1.0);
      EXPECT_EQ(r.radius_m, 0.2);
      EXPECT_EQ(r.id, static_cast<int>(all.size()));
      all.push_back({r.start.x(), r.start.y(), r.goal.x(), r.goal.y()});
    }
    return all;
  };
  using Ends = std::vector<std::array<double, 4>>;
  EXPECT_EQ(ends(Task::kCross), (Ends{{-8, 0, 8, 0}, {8, 0, -8, 0}, {0, 8, 0, -8}, {0, -8, 0, 8}}));
  EXPECT_EQ(ends(Task::kBilateral), (Ends{{-8, 3, 8, -3}, {-8, -3, 8, 3}, {8, -3, -8, 3}, {8, 3, -8, -3}}));
  EXPECT_EQ(ends(Task::kUnilateral), (Ends{{-8, 6, 8, -6}, {-8, 2, 8, -2}, {-8, -2, 8, 2}, {-8, -6, 8, 6}}));
}

TEST(Generator, CircleSendsEachRobotToItsAntipode) {
  for (const auto& [n, radius] : {std::pair{2, 4.0}, {7, 8.0}, {10, 10.0}, {40, 12.5}}) {
    const World world = make_world(Task::kCircle, Environment::kMixed, 20, 5, {n, radius});
    ASSERT_EQ(world.robots.size(), static_cast<std::size_t>(n));
    for (const WorldRobot& robot : world.robots) {
      EXPECT_NEAR(robot.start.head<2>().norm(), radius, 2e-6);
      EXPECT_EQ(Eigen::Vector2d(robot.goal.head<2>()), Eigen::Vector2d(-robot.start.head<2>()));
    }
    EXPECT_EQ(world.space.max.x(), std::max(8.0, radius + 1));
    EXPECT_EQ(world.obstacle_bounds.max.y(), std::max(7.0, radius - 1));
  }
  EXPECT_THROW(make_world(Task::kCircle, Environment::kEmpty, 0, 0, {41, 10.0}), WorldError);
  EXPECT_THROW(make_world(Task::kCircle, Environment::kEmpty, 0, 0, {40, 2.0}), WorldError) << "they would overlap";
}

// Collects values that should be uniform on [low, high].
struct Uniformity {
  double low, high;
  double smallest = 1e9, largest = -1e9, sum = 0;
  int count = 0;
  void add(double value) {
    smallest = std::min(smallest, value), largest = std::max(largest, value), sum += value, ++count;
  }
  void check(const char* what) const {
    const double width = high - low, sigma = width / std::sqrt(12.0 * count);
    EXPECT_GE(smallest, low) << what;
    EXPECT_LE(largest, high) << what;
    EXPECT_LT(smallest, low + 0.01 * width) << what;
    EXPECT_GT(largest, high - 0.01 * width) << what;
    EXPECT_NEAR(sum / count, 0.5 * (low + high), 4 * sigma) << what;
  }
};

TEST(Generator, DrawsThePapersRanges) {
  Uniformity diameter{0.5, 1.0}, radius{0.7, 2.5}, height{0.8, 2.0}, yaw{0, std::numbers::pi}, speed{0, 1 + 1e-6},
      heading{-std::numbers::pi, std::numbers::pi}, x{-7, 7}, y{-7, 7};
  for (int seed = 0; seed < 100; ++seed) {
    const World world = make_world(Task::kCross, Environment::kMixed, 51, static_cast<std::uint64_t>(seed));
    int rings = 0;
    for (const WorldObstacle& o : world.obstacles) {
      if (o.shape.kind == Shape::Kind::kRing) {
        ++rings;
        radius.add(o.shape.size.x());
        EXPECT_EQ(o.shape.size.y(), 0.1);
        height.add(o.center.z());
        yaw.add(o.shape.yaw_rad);
      } else {
        ASSERT_EQ(o.shape.kind, Shape::Kind::kColumn);
        diameter.add(o.shape.size.x());
        EXPECT_EQ(o.shape.size.y(), 4.0);
        EXPECT_EQ(o.center.z(), 2.0);
      }
      speed.add(o.velocity_mps.norm());
      heading.add(std::atan2(o.velocity_mps.y(), o.velocity_mps.x()));
      x.add(o.center.x());
      y.add(o.center.y());
      for (const WorldRobot& robot : world.robots)
        ASSERT_GE(distance(o.shape, robot.start - o.center) - robot.radius_m, 0.7) << "seed " << seed;
    }
    EXPECT_EQ(rings, 25);
    EXPECT_EQ(world.obstacles.size(), 51u);
  }
  diameter.check("diameter"), radius.check("ring radius"), height.check("ring height"), yaw.check("yaw"),
      speed.check("speed"), heading.check("heading"), x.check("x"), y.check("y");
}

TEST(Generator, SameSeedSameWorldOtherSeedOtherWorld) {
  const World world = make_world(Task::kCross, Environment::kMixed, 20, 7);
  EXPECT_EQ(world.name, "cross-mixed-20-7");
  EXPECT_EQ(world, make_world(Task::kCross, Environment::kMixed, 20, 7));
  EXPECT_FALSE(world.obstacles == make_world(Task::kCross, Environment::kMixed, 20, 8).obstacles);
  // Nothing but the engine of the standard and exact arithmetic decides this value, on every machine.
  std::mt19937_64 engine(7);
  const double unit = static_cast<double>(engine() >> 11) * 0x1p-53;
  EXPECT_EQ(make_world(Task::kCross, Environment::kPure, 1, 7).obstacles[0].shape.size.x(),
            std::trunc((0.5 + 0.5 * unit) * 1e6) / 1e6);
  for (const WorldObstacle& o : make_world(Task::kCross, Environment::kPure, 20, 7).obstacles)
    EXPECT_EQ(o.shape.kind, Shape::Kind::kColumn);
}

TEST(Generator, RefusesWhatCannotBe) {
  EXPECT_THROW(make_world(Task::kCross, Environment::kEmpty, 1, 0), WorldError);
  EXPECT_THROW(make_world(Task::kCross, Environment::kPure, 501, 0), WorldError);
  EXPECT_THROW(make_world(Task::kCross, Environment::kPure, -1, 0), WorldError);
}

class WorldCommand : public WorldFiles {
 protected:
  int run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "world");
    std::vector<const char*> argv;
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    testing::internal::CaptureStdout();
    testing::internal::CaptureStderr();
    const int code = world_command(static_cast<int>(argv.size()), argv.data());
    out_ = testing::internal::GetCapturedStdout();
    err_ = testing::internal::GetCapturedStderr();
    return code;
  }
  std::string out_, err_;
};

TEST_F(WorldCommand, WritesTheWorldAndNothingElse) {
  const std::string file = (directory_ / "w.json").string();
  EXPECT_EQ(run({"--task", "cross", "--env", "mixed", "--obstacles", "20", "--seed", "7", "-o", file}), 0) << err_;
  EXPECT_EQ(read_world(file), make_world(Task::kCross, Environment::kMixed, 20, 7));
  EXPECT_EQ(std::distance(fs::directory_iterator(directory_), {}), 1);
  EXPECT_EQ(run({"--task", "cross", "--env", "mixed", "--obstacles", "20", "--seed", "7", "-o", "-"}), 0) << err_;
  EXPECT_EQ(out_, get("w.json"));
  EXPECT_EQ(run({"--task", "circle", "--env", "empty", "--robots", "6", "--radius", "5", "-o", "-"}), 0) << err_;
  EXPECT_EQ(parse_world(out_, "-", "").robots.size(), 6u);
}

TEST_F(WorldCommand, RefusesBadOptionsWithOneLineAndCode2) {
  const std::string file = (directory_ / "w.json").string();
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--task", "spiral", "-o", file}, "spiral"},
      {{"--env", "full", "-o", file}, "full"},
      {{"--obstacles", "501", "-o", file}, "501"},
      {{"--obstacles", "x", "-o", file}, "obstacles"},
      {{"--robots", "4", "-o", file}, "robots"},
      {{"--radius", "4", "-o", file}, "radius"},
      {{"--wind", "4", "-o", file}, "wind"},
      {{}, "out"},
      {{"--env", "empty", "--obstacles", "3", "-o", file}, "obstacles: 3"},
      {{"-o", (directory_ / "none" / "w.json").string()}, "none"},
      {{"--task", "circle", "--robots", "40", "--radius", "1", "-o", file}, "sum of radii"},
  };
  for (const auto& [arguments, mention] : cases) {
    SCOPED_TRACE(testing::PrintToString(arguments));
    EXPECT_EQ(run(arguments), 2);
    EXPECT_NE(err_.find(mention), std::string::npos) << err_;
    EXPECT_EQ(std::ranges::count(err_, '\n'), 1) << err_;
    EXPECT_TRUE(out_.empty()) << out_;
    EXPECT_TRUE(fs::is_empty(directory_));
  }
}

}  // namespace
}  // namespace swarm
