// What world files may say, and what is written to them. Long because every key is tried, good and bad.
#include "swarm_sim/world/world_json.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <numbers>
#include <random>

#include "swarm_sim/world/occupied_cubes.h"
#include "swarm_sim/world/walls.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

namespace fs = std::filesystem;

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

// Without a goal of its own a robot is told where to go by others, and the flight has no end.
TEST(WorldJson, RobotsWithoutAGoalAreToldWhereToGo) {
  const World world =
      parse_world(replaced(R"("start": [8,1,1], "goal": [-8,1,1.0])", R"("start": [8,1,1])"), "w.json", "");
  EXPECT_FALSE(world.robots[0].is_told);
  EXPECT_TRUE(world.robots[1].is_told);
  EXPECT_EQ(world.robots[1].goal(), world.robots[1].start);
  EXPECT_TRUE(world.is_endless());
  EXPECT_FALSE(parse_world(kGood, "w.json", "").is_endless());
  const std::string text = to_json_text(world, "");
  EXPECT_NE(text.find(R"({"id":1,"start":[8.0,1.0,1.0],"radius":0.2})"), std::string::npos) << text;
  EXPECT_EQ(parse_world(text, "w.json", ""), world);
  // Its start may be another's goal.
  EXPECT_EQ(parse_world(replaced(R"("goal": [8,0,1])", R"("goal": [8,1,1])")
                            .replace(std::string(kGood).find(R"(, "goal": [-8,1,1.0])"), 20, ""),
                        "w.json", "")
                .robots.size(),
            2u);
}

TEST(WorldJson, AWorldMayBringOptionsOfItsFlight) {
  const std::string text =
      replaced(R"("limits")", R"("options": {"vehicle": "quadrotor", "wind-mps": 3, "sense-dropout": 0.1}, "limits")");
  const World world = parse_world(text, "w.json", "");
  EXPECT_EQ(world.vehicle, (VehicleOptions{.kind = "quadrotor", .wind_mps = 3.0}));
  SensorOptions sensor;
  sensor.dropout = 0.1;
  EXPECT_EQ(world.sensor, sensor);
  EXPECT_EQ(parse_world(to_json_text(world, ""), "w.json", ""), world);
  EXPECT_EQ(to_json_text(parse_world(kGood, "w.json", ""), "").find("options"), std::string::npos);
  const auto refused = [](const std::string& options) {
    return error_of(replaced(R"("limits")", "\"options\": " + options + R"(, "limits")"));
  };
  EXPECT_NE(refused(R"({"vehicle": "helicopter"})")
                .find("options.vehicle: \"helicopter\" must be perfect, noisy or quadrotor"),
            std::string::npos)
      << refused(R"({"vehicle": "helicopter"})");
  EXPECT_NE(refused(R"({"wind-mps": 31})").find("[0, 30]"), std::string::npos);
  EXPECT_NE(refused(R"({"wind": 3})").find("unknown key"), std::string::npos);
  EXPECT_NE(refused("3").find("object"), std::string::npos);
}

TEST(WorldJson, ReadsEveryField) {
  const World world = parse_world(kGood, "w.json", "");
  EXPECT_EQ(world.name, "good");
  EXPECT_EQ(world.space.max, Eigen::Vector3d(8, 8, 4));
  EXPECT_EQ(world.obstacle_bounds.min, Eigen::Vector2d(-8, -8));
  EXPECT_EQ(world.limits.v_max_mps, 2.0);
  EXPECT_EQ(world.limits.a_max_mps2, 6.0);
  EXPECT_EQ(world.sensing_radius_m, 5.0);
  EXPECT_TRUE(world.static_map.empty());
  ASSERT_EQ(world.robots.size(), 2u);
  EXPECT_EQ(world.robots[1], (WorldRobot{1, {8, 1, 1}, {{{-8, 1, 1}}}, 0.2}));
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
  for (int i = 0; i < 1001; ++i) {
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
       "\"nam\" is an unknown key; known are name, space, obstacle_bounds, limits, sensing_radius, static_map, walls, "
       "options, "
       "robots, "
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
      {"\"acceleration\": 6.0", "\"acceleration\": 6.0, \"jerk\": 0", "limits.jerk: 0 must be a number in (0, 1e+05]"},
      {"\"acceleration\": 6.0", R"("acceleration": 6.0, "thrust": {"min": 2, "max": 20, "tilt": 45})",
       "limits.acceleration: 6.0 must be absent where there is thrust"},
      {"\"acceleration\": 6.0", R"("thrust": {"min": 2, "max": 20})",
       "limits.thrust.tilt: is missing and must be given"},
      {"\"acceleration\": 6.0", R"("thrust": {"min": 2, "max": 12, "tilt": 45})",
       R"(limits.thrust: {"max":12,"min":2,"tilt":45} must be more than gravity, 9.81 m/s^2, upwards when tilted)"},
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
      {"\"id\": 1", "\"id\": 10000", "robots[1].id: 10000 must be an integer in [0, 9999]"},
      {"\"id\": 1", "\"id\": -1", "robots[1].id: -1 must be an integer in [0, 9999]"},
      {"\"id\": 1", "\"id\": 1.5", "robots[1].id: 1.5 must be an integer in [0, 9999]"},
      {"\"start\": [8,1,1]", "\"start\": [-7.7,0,1]",
       "robots[1].start: [-7.7,0,1] must be at least the sum of radii from robots[0]"},
      {"\"goal\": [-8,1,1.0]", "\"goal\": [8,0.1,1]",
       "robots[1].goal: [8,0.1,1] must be at least the sum of radii from robots[0]"},
      {"\"start\": [8,1,1]", "\"start\": [8.001,1,1]", "robots[1].start: [8.001,1,1] must be inside space"},
      {"\"goal\": [-8,1,1.0]", "\"goal\": [-8,1,4.1]", "robots[1].goal: [-8,1,4.1] must be inside space"},
      {"\"goal\": [-8,1,1.0]", "\"goals\": []", "robots[1].goals: [] must be an array of 1 to 1000 goals"},
      {"\"goal\": [-8,1,1.0]", "\"goal\": [-8,1,1], \"goals\": []",
       "robots[1].goal: [-8,1,1] must be absent where there are goals"},
      {"\"goal\": [-8,1,1.0]", R"("goals": [{"position": [-8,1,4.1]}, {"position": [-8,1,1]}])",
       "robots[1].goals[0].position: [-8,1,4.1] must be inside space"},
      {"\"goal\": [-8,1,1.0]", R"("goals": [{"position": [-8,1,1], "speed": 0.01}])",
       "robots[1].goals[0].speed: 0.01 must be a number in [0.05, 100]"},
      {"\"goal\": [-8,1,1.0]", R"("goals": [{"position": [-8,1,1], "tolerance": 0}])",
       "robots[1].goals[0].tolerance: 0 must be a number in (0, 1000]"},
      {"\"goal\": [-8,1,1.0]", R"("goals": [{"position": [-8,1,1], "wait": -1}])",
       "robots[1].goals[0].wait: -1 must be a number in [0, 86400]"},
      {"\"goal\": [-8,1,1.0]", "\"goals\": [[-8,1,1]]", "robots[1].goals[0]: [-8,1,1] must be an object"},
      {"\"start\": [8,1,1]", "\"start\": [1.5,2,1]", "robots[1].start: [1.5,2,1] must not touch obstacles[0] at t = 0"},
      {"\"start\": [8,1,1]", "\"start\": [8,1,null]", "robots[1].start[2]: null must be a number in [-10000, 10000]"},
      {"\"start\": [8,1,1]", "\"begin\": [8,1,1]",
       "robots[1]: \"begin\" is an unknown key; known are id, start, goal, goals, radius, limits"},
      {"\"shape\": \"column\"", "\"shape\": \"cone\"",
       "obstacles[0].shape: \"cone\" must be one of column, ring, box, sphere"},
      {"\"diameter\": 0.8", "\"diameter\": -0.8", "obstacles[0].diameter: -0.8 must be a number in (0, 1000]"},
      {"\"diameter\": 0.8, ", "", "obstacles[0].diameter: is missing and must be given"},
      {"\"diameter\": 0.8", "\"width\": 0.8",
       "obstacles[0]: \"width\" is an unknown key; known are shape, center, diameter, height, velocity, "
       "acceleration, track, bounds"},
      {"\"width\": 0.1", "\"width\": 3.1", "obstacles[1].width: 3.1 must be at most twice the ring's radius"},
      {"\"center\": [0,3,1.2]", "\"center\": [0,3]", "obstacles[1].center: [0,3] must be an array of 3 numbers"},
      {"\"center\": [1,2], ", "", "obstacles[0].center: is missing and must be given"},
      {"[0.3,-0.2]", "[300,-0.2]", "obstacles[0].velocity[0]: 300 must be a number in [-100, 100]"},
      {"[0.3,-0.2]", "[0.3,-0.2], \"acceleration\": -1", "obstacles[0].acceleration: -1 must be a number in [0, 100]"},
      {"[0.3,-0.2]", "[0.3,-0.2], \"acceleration\": 101",
       "obstacles[0].acceleration: 101 must be a number in [0, 100]"},
      {"[0.3,-0.2]", "[0.3,-0.2], \"acceleration\": [1,0]",
       "obstacles[0].acceleration: [1,0] must be a number in [0, 100]"},
      {"\"track\"", "\"acceleration\": 0, \"track\"",
       "obstacles[2].acceleration: 0 must be absent: the track tells the motion"},
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
       "robots: 0 robots must be in [1, 1000]"},
      {"[" + robot0 + R"(, {"id": 1, "start": [8,1,1], "goal": [-8,1,1.0], "radius": 0.2}])", crowd + "]",
       "robots: 1001 robots must be in [1, 1000]"},
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

TEST(WorldJson, AMissionEndsAtTheGoal) {
  const World world = parse_world(
      replaced(
          "\"goal\": [-8,1,1.0]",
          R"("goals": [{"position": [1,1,2], "tolerance": 0.5, "speed": 1.5, "wait": 2.5}, {"position": [-8,1,1]}])"),
      "w.json", "");
  EXPECT_EQ(world.robots[1].goal(), Eigen::Vector3d(-8, 1, 1));
  const Mission& mission = world.robots[1].mission;
  ASSERT_EQ(mission.size(), 2u);
  EXPECT_EQ(mission[0], (Waypoint{{1, 1, 2}, 0.5, 1.5, 2500ms}));
  EXPECT_EQ(mission[1], (Waypoint{{-8, 1, 1}}));
  EXPECT_EQ(world.robots[0].mission, (Mission{Waypoint{{8, 0, 1}}}));
  EXPECT_EQ(parse_world(to_json_text(world, ""), "w.json", ""), world);
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

TEST(WorldFiles, MissingFilesAndDirectoriesAreRefusedByName) {
  const TemporaryDirectory directory;
  const std::string rule = ": must be a readable world file";
  for (const fs::path& path : {directory / "none.json", directory.path()}) {
    try {
      read_world(path);
      FAIL();
    } catch (const WorldError& error) {
      EXPECT_EQ(error.what(), path.string() + rule);
    }
  }
}

TEST(WorldFiles, StaticMapIsRelativeToTheWorldFile) {
  const TemporaryDirectory directory;
  write_text(directory / "map.bt", "x");
  fs::create_directories(directory / "deep");
  const fs::path path =
      write_text(directory / "deep/w.json", replaced("\"limits\"", "\"static_map\": \"../map.bt\", \"limits\""));
  const World world = read_world(path);
  EXPECT_EQ(world.static_map, directory / "map.bt");
  const std::string elsewhere = to_json_text(world, directory.path());
  EXPECT_NE(elsewhere.find("\"static_map\": \"map.bt\""), std::string::npos) << elsewhere;
  EXPECT_EQ(parse_world(elsewhere, "again", directory.path()), world);
}

TEST(WorldFiles, WritingReadsBackAsTheSameWorld) {
  const TemporaryDirectory directory;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int trial = 0; trial < 100; ++trial) {
    World world = parse_world(kGood, "w.json", "");
    world.space = {{-9 + unit(random), -9 + unit(random), unit(random) - 1},
                   {9 + unit(random), 9 + unit(random), 5 + unit(random)}};
    world.obstacle_bounds = {{-7 + unit(random), -7}, {7 + unit(random), 7}};
    world.limits.v_max_mps = 2 + unit(random);
    world.sensing_radius_m = 2 + unit(random);
    if (unit(random) < 0) world.robots[0].limits = {1 + 0.5 * unit(random), 3 + unit(random)};
    if (unit(random) < 0) world.limits.j_max_mps3 = 50 + 10 * unit(random);
    if (unit(random) < 0) {
      world.limits.kind = "thrust";
      world.limits.a_max_mps2 = MotionLimits().a_max_mps2;
      world.limits.thrust = {2 + unit(random), 20 + unit(random), 40 + unit(random)};
    }
    for (WorldObstacle& obstacle : world.obstacles) {
      obstacle.shape.size *= 1 + 0.1 * unit(random);
      const bool on_ground = unit(random) < 0 && obstacle.shape.kind == Shape::Kind::kColumn;
      obstacle.center.z() = on_ground ? 0.5 * obstacle.shape.size.y() : 1 + unit(random);
      if (obstacle.shape.kind == Shape::Kind::kRing || obstacle.shape.kind == Shape::Kind::kBox)
        obstacle.shape.yaw_rad = 3 * unit(random);
      if (obstacle.track.empty()) obstacle.velocity_mps = {unit(random), unit(random)};
      if (obstacle.track.empty() && unit(random) < 0) obstacle.acceleration_mps2 = 1 + unit(random);
      if (obstacle.track.empty() && unit(random) < 0) obstacle.bounds = {{-8 + unit(random), -8}, {8, 8}};
    }
    if (unit(random) < 0) {
      world.static_map.clear();
      world.walls = {{{-3, -2 + unit(random), 0}, {3, 0, 2}}, {{4, 4, 0}, {5, 5 + unit(random) / 2, 3}}};
    }
    const std::string text = to_json_text(world, directory.path());
    EXPECT_EQ(parse_world(text, "again", directory.path()), world) << text;
    EXPECT_EQ(to_json_text(parse_world(text, "again", directory.path()), directory.path()), text);
  }
  World a = parse_world(kGood, "w.json", ""), b = a;
  b.obstacles[1].shape.yaw_rad = std::nextafter(b.obstacles[1].shape.yaw_rad, 1.0);
  EXPECT_FALSE(a == b) << "the comparison itself must see a last bit";
}

TEST(WorldFiles, AnAccelerationIsWrittenOnlyWhereThereIsOne) {
  const World world = parse_world(kGood, "w.json", "");
  World accelerating = parse_world(replaced("[0.3,-0.2]", "[0.3,-0.2], \"acceleration\": 0.5"), "w.json", "");
  EXPECT_EQ(accelerating.obstacles[0].acceleration_mps2, 0.5);
  EXPECT_FALSE(accelerating == world);
  std::string text = to_json_text(accelerating, "");
  const std::string written = ",\"acceleration\":0.5";
  ASSERT_NE(text.find(written), std::string::npos) << text;
  EXPECT_EQ(text.erase(text.find(written), written.size()), to_json_text(world, ""));
}

TEST(WorldFiles, AnObstacleTurnsAtBoundsOfItsOwn) {
  World world = parse_world(kGood, "w.json", "");
  WorldObstacle& obstacle = world.obstacles[0];
  obstacle.center = {1, 1, 2};
  obstacle.velocity_mps = {1, 0};
  obstacle.bounds = {{0, 0}, {2, 2}};
  EXPECT_NEAR(state_at(obstacle, world, 2.5)->position.x(), 0.5, 1e-12);
  EXPECT_EQ(state_at(obstacle, world, 2.5)->velocity.x(), -1);
  obstacle.center.x() = 2.5;
  try {
    check_world(world);
    FAIL();
  } catch (const WorldError& error) {
    EXPECT_EQ(std::string(error.what()),
              "obstacles[0].center: [2.5,1,2] must be inside its bounds because the obstacle moves");
  }
}

// The voxels that the walls overlap, exactly where their faces lie on voxels' faces, and at least one across.
TEST(WorldFiles, WallsAreFlownAsAnOctoMap) {
  World world = parse_world(kGood, "w.json", "");
  world.static_map.clear();
  world.walls = {{{-1, 2, 0}, {1, 2.2, 1}}, {{3.04, 0.01, 0}, {3.05, 0.19, 0.3}}};
  const TemporaryDirectory directory;
  const World flown = with_walls_in_file(world, directory.path());
  EXPECT_TRUE(flown.walls.empty());
  EXPECT_EQ(flown.static_map, directory / "walls.ot");
  const OccupiedCubes cubes = OccupiedCubes::load(flown.static_map);
  double volume = 0.0;
  for (const OccupiedCubes::Cube& cube : cubes.cubes()) volume += std::pow(2 * cube.half_edge_m, 3);
  EXPECT_NEAR(volume, 2 * 0.2 * 1 + 0.1 * 0.2 * 0.3, 1e-9);
  EXPECT_NEAR(cubes.distance({0, 1.5, 0.5}, 2), 0.5, 1e-6);
  EXPECT_NEAR(cubes.distance({0, 2.5, 0.5}, 2), 0.3, 1e-6);
  EXPECT_NEAR(cubes.distance({3.5, 0.1, 0.1}, 2), 0.4, 1e-6);
  world.walls.clear();
  EXPECT_EQ(with_walls_in_file(world, directory.path()), world);
  world.walls = {{{-100, -100, 0}, {100, 100, 10}}};
  EXPECT_THROW(with_walls_in_file(world, directory.path()), WorldError);
  world.walls = {{{4000, 0, 0}, {4001, 1, 1}}};
  EXPECT_THROW(with_walls_in_file(world, directory.path()), WorldError);
}

TEST(WorldFiles, ExampleWorldsAreAccepted) {
  const TemporaryDirectory directory;
  const fs::path examples = fs::path(SWARM_TEST_DATA) / "worlds";
  if (!fs::exists(examples)) GTEST_SKIP() << "no example worlds at " << examples;
  int count = 0;
  for (const auto& entry : fs::directory_iterator(examples)) {
    if (!entry.is_regular_file()) continue;
    const World world = read_world(entry.path());
    EXPECT_EQ(world.robots.size(), 4u) << entry.path();
    EXPECT_GT(world.obstacles.size(), 10u) << entry.path();
    EXPECT_EQ(parse_world(to_json_text(world, directory.path()), "again", directory.path()), world) << entry.path();
    ++count;
  }
  EXPECT_GT(count, 0);
}

}  // namespace
}  // namespace swarm::test
