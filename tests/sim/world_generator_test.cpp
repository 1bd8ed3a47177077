// Seeded worlds of the paper's kind, and the command that writes them.
#include "swarm_sim/world/world_generator.h"

#include <gtest/gtest.h>
#include <octomap/OcTree.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <random>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/text.h"
#include "swarm_sim/world/building.h"
#include "swarm_sim/world/occupied_cubes.h"
#include "swarm_sim/world/walls.h"
#include "swarm_sim/world/world_json.h"
#include "swarm_sim/world_command.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

TEST(Generator, TasksHaveThePapersPositions) {
  const auto ends = [](Task task) {
    std::vector<std::array<double, 4>> all;
    for (const WorldRobot& r : make_world(task, Environment::kEmpty, 0, 1).robots) {
      EXPECT_EQ(r.start.z(), 1.0);
      EXPECT_EQ(r.goal().z(), 1.0);
      EXPECT_EQ(r.radius_m, 0.2);
      EXPECT_EQ(r.id, static_cast<int>(all.size()));
      all.push_back({r.start.x(), r.start.y(), r.goal().x(), r.goal().y()});
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
    const World world = make_world(Task::kCircle, Environment::kMixed, 20, 5, {.robots = n, .circle_m = radius});
    ASSERT_EQ(world.robots.size(), static_cast<std::size_t>(n));
    for (const WorldRobot& robot : world.robots) {
      EXPECT_NEAR(robot.start.head<2>().norm(), radius, 2e-6);
      EXPECT_EQ(Eigen::Vector2d(robot.goal().head<2>()), Eigen::Vector2d(-robot.start.head<2>()));
    }
    EXPECT_EQ(world.space.max.x(), std::max(8.0, radius + 1));
    EXPECT_EQ(world.obstacle_bounds.max.y(), std::max(7.0, radius - 1));
  }
  EXPECT_THROW(make_world(Task::kCircle, Environment::kEmpty, 0, 0, {.robots = kMaxRobots + 1}), WorldError);
  EXPECT_THROW(make_world(Task::kCircle, Environment::kEmpty, 0, 0, {.robots = 60, .circle_m = 3.0}), WorldError)
      << "they would overlap";
}

TEST(Generator, RandomGoalsAreApartFromEachOtherAndAwayFromTheStarts) {
  const Fleet fleet{.robots = 60,
                    .robot_m = 0.15,
                    .limits = {.v_max_mps = 1.0, .a_max_mps2 = 2.0, .j_max_mps3 = 50.0},
                    .space_m = {12, 10, 4}};
  const World world = make_world(Task::kRandom, Environment::kEmpty, 0, 5, fleet);
  ASSERT_EQ(world.robots.size(), 60u);
  EXPECT_EQ(world.limits, fleet.limits);
  EXPECT_EQ(world.space.max, Eigen::Vector3d(6, 5, 4));
  EXPECT_EQ(world.space.min, Eigen::Vector3d(-6, -5, 0));
  for (const WorldRobot& robot : world.robots) {
    EXPECT_EQ(robot.radius_m, 0.15);
    EXPECT_GE((robot.goal() - robot.start).norm(), 10.0 / 4);
    for (const Eigen::Vector3d& place : {robot.start, robot.goal()}) {
      EXPECT_TRUE((place.array() >= world.space.min.array() + 0.3 - 1e-6).all()) << place.transpose();
      EXPECT_TRUE((place.array() <= world.space.max.array() - 0.3 + 1e-6).all()) << place.transpose();
    }
    for (const WorldRobot& other : world.robots) {
      if (&other == &robot) break;
      EXPECT_GE((robot.start - other.start).norm(), 0.6);
      EXPECT_GE((robot.goal() - other.goal()).norm(), 0.6);
    }
  }
  EXPECT_EQ(world, make_world(Task::kRandom, Environment::kEmpty, 0, 5, fleet));
  EXPECT_FALSE(world == make_world(Task::kRandom, Environment::kEmpty, 0, 6, fleet));
  EXPECT_THROW(make_world(Task::kRandom, Environment::kEmpty, 0, 1, {.robots = 60, .space_m = {2, 2, 1}}), WorldError);
  EXPECT_THROW(make_world(Task::kRandom, Environment::kEmpty, 0, 1, {.space_m = {0.5, 5, 5}}), WorldError);
  EXPECT_THROW(make_world(Task::kRandom, Environment::kEmpty, 0, 1, {.circle_m = 5}), WorldError);
  EXPECT_THROW(make_world(Task::kCross, Environment::kEmpty, 0, 1, {.robots = 5}), WorldError);
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

// A column that goes from place to place, one each second.
WorldObstacle walker(double from_s, const std::vector<Eigen::Vector2d>& places) {
  WorldObstacle column;
  column.shape.kind = Shape::Kind::kColumn;
  column.shape.size = {0.5, 1.8, 0.0};
  column.center = {places[0].x(), places[0].y(), 0.9};
  for (std::size_t i = 0; i < places.size(); ++i) column.track.push_back({from_s + static_cast<double>(i), places[i]});
  return column;
}

TEST(Generator, PeopleWalkAlongTheHall) {
  TemporaryDirectory directory;
  World recorded;
  recorded.name = "recorded";
  recorded.space = {{-20, -20, 0}, {20, 20, 3}};
  recorded.limits = {};
  recorded.robots = {WorldRobot{}};
  recorded.obstacles = {walker(3.0, {{5, -14}, {5, -11}, {5, 0}, {4, 11}, {4, 14}}),  // all along, beyond both ends
                        walker(0.2, {{3, 2}, {3, -9}, {3, -13}}),     // from its midst, but from the beginning
                        walker(0.0, {{2, 3}, {2, -2}, {-9, -3}}),     // out through a wall
                        walker(4.0, {{4, 5}, {4, -3}}),               // comes into being in its midst
                        walker(1.0, {{4, -11}, {4, -13}, {4, -11}}),  // comes back
                        WorldObstacle{}};
  recorded.obstacles.back().shape = recorded.obstacles[0].shape;
  recorded.obstacles.back().center = {9, 9, 0.9};  // stands
  const fs::path first = directory.path() / "first.json", second = directory.path() / "second.json";
  write_file(first.string(), to_json_text(recorded, directory.path()));
  recorded.obstacles.erase(recorded.obstacles.begin());
  write_file(second.string(), to_json_text(recorded, directory.path()));

  Fleet fleet;
  fleet.people = first.string() + "," + second.string();
  const World world = make_world(Task::kHall, Environment::kPure, 3, 8, fleet);
  ASSERT_EQ(world.obstacles.size(), 5u);
  EXPECT_EQ(make_world(Task::kHall, Environment::kPure, 3, 9, fleet).obstacles.size(), 4u);
  EXPECT_NE(command_line(fleet).find("--people"), std::string::npos);
  const WorldObstacle &along = world.obstacles[3], &begun = world.obstacles[4];
  ASSERT_EQ(along.track.size(), 3u);
  EXPECT_EQ(along.track[0].t_s, 4.0);
  EXPECT_EQ(along.track[0].position.x(), -11.0);
  EXPECT_EQ(along.track[2].position.x(), 11.0);
  EXPECT_EQ(along.track[2].position.y(), along.track[0].position.y() + 1.0) << "turned, not mirrored";
  EXPECT_EQ(along.center, Eigen::Vector3d(-11.0, along.track[0].position.y(), 0.9));
  ASSERT_EQ(begun.track.size(), 2u) << "ends where the hall does";
  EXPECT_EQ(begun.track[0].position.x(), 2.0);
}

TEST(Generator, RefusesPeopleElsewhereAndFilesWithoutAny) {
  TemporaryDirectory directory;
  World recorded;
  recorded.name = "nobody";
  recorded.space = {{-20, -20, 0}, {20, 20, 3}};
  recorded.robots = {WorldRobot{}};
  const fs::path nobody = directory.path() / "nobody.json";
  write_file(nobody.string(), to_json_text(recorded, directory.path()));
  Fleet fleet;
  fleet.people = nobody.string();
  EXPECT_THROW(make_world(Task::kCross, Environment::kEmpty, 0, 1, fleet), WorldError);
  try {
    make_world(Task::kHall, Environment::kEmpty, 0, 1, fleet);
    ADD_FAILURE() << "nobody walks";
  } catch (const WorldError& error) {
    EXPECT_NE(std::string(error.what()).find("nobody.json: holds nobody who walks"), std::string::npos) << error.what();
  }
}

// Two rooms of 8 x 6 m behind each other, with a door of 0.8 m; another one that no door leads to. `door_m`: its width.
std::string two_rooms(const fs::path& file, double door_m) {
  octomap::OcTree map(0.1);
  for (int x = -80; x < 120; ++x) {
    for (int y = -30; y < 30; ++y) {
      for (int z = 0; z < 20; ++z) {
        const Eigen::Vector3d place = (Eigen::Vector3d(x, y, z).array() + 0.5) * 0.1;
        const bool in_wall = x == -80 || x == 119 || y == -30 || y == 29 || x == 0 || x == 80;
        const bool in_door = x == 0 && std::abs(place.y()) < door_m / 2;
        map.updateNode(octomap::point3d(static_cast<float>(place.x()), static_cast<float>(place.y()),
                                        static_cast<float>(place.z())),
                       in_wall && !in_door);
      }
    }
  }
  EXPECT_TRUE(map.writeBinary(file.string()));
  return file.string();
}

TEST(Generator, ToursLeadToWhereverOneGetsInABuilding) {
  const TemporaryDirectory directory;
  Fleet fleet{.robots = 3, .goals = 4, .low_m = 0.4, .high_m = 1.6};
  fleet.building = two_rooms(directory.path() / "rooms.bt", 0.8);
  EXPECT_NE(command_line(fleet).find("--building"), std::string::npos);
  const auto map = OccupiedCubes::load(fleet.building);
  int crossings = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const World world = make_world(Task::kTour, Environment::kEmpty, 0, seed, fleet);
    EXPECT_EQ(world.static_map, fleet.building);
    EXPECT_EQ(world.space, (Space{{-8.0, -3.0, 0.4}, {12.0, 3.0, 1.6}}));
    ASSERT_EQ(world.robots.size(), 3u);
    for (const WorldRobot& robot : world.robots) {
      ASSERT_EQ(robot.mission.size(), 4u);
      Eigen::Vector3d before = robot.start;
      EXPECT_GE(map.distance(before, 1.0), 0.5 - 1e-6);
      for (const Waypoint& goal : robot.mission) {
        EXPECT_GE((goal.position - before).norm(), 5.0);
        EXPECT_GE(map.distance(goal.position, 1.0), 0.5 - 1e-6);
        EXPECT_LT(goal.position.x(), 8.0) << "no door leads there";
        EXPECT_GE(goal.position.z(), 0.6);
        EXPECT_LE(goal.position.z(), 1.4);
        crossings += goal.position.x() * before.x() < 0.0 ? 1 : 0;
        before = goal.position;
      }
    }
  }
  EXPECT_GT(crossings, 10);
  EXPECT_EQ(make_world(Task::kTour, Environment::kEmpty, 0, 5, fleet),
            make_world(Task::kTour, Environment::kEmpty, 0, 5, fleet));
  // Through a narrower door nobody gets.
  const std::vector<Eigen::Vector3d> apart =
      building_in(two_rooms(directory.path() / "apart.bt", 0.6), 0.2, {0.4, 1.6}).places;
  for (const Eigen::Vector3d& place : apart) EXPECT_GT(place.x() * apart[0].x(), 0.0);
}

TEST(Generator, RefusesToursWithoutABuildingOrRoom) {
  const TemporaryDirectory directory;
  const auto complaint = [](Task task, Environment environment, const Fleet& fleet) {
    try {
      make_world(task, environment, 0, 1, fleet);
    } catch (const std::exception& error) {
      return std::string(error.what());
    }
    return std::string("none");
  };
  EXPECT_EQ(complaint(Task::kTour, Environment::kEmpty, {}), "building: the task tour needs one");
  Fleet fleet;
  fleet.building = (directory.path() / "none.bt").string();
  EXPECT_EQ(complaint(Task::kCross, Environment::kEmpty, fleet), "building: only the task tour has one");
  EXPECT_NE(complaint(Task::kTour, Environment::kEmpty, fleet).find("none.bt"), std::string::npos);
  EXPECT_NE(complaint(Task::kTour, Environment::kPure, fleet).find("env: \"pure\" must be empty"), std::string::npos);
  fleet.building = two_rooms(directory.path() / "rooms.bt", 0.8);
  fleet.low_m = 1.0, fleet.high_m = 1.3;
  EXPECT_NE(complaint(Task::kTour, Environment::kEmpty, fleet).find("between heights 1 and 1.3 m"), std::string::npos);
}

// Rooms with a door each; robots go from room to room; what moves stays off the walls.
TEST(Generator, HallHasRoomsWithDoors) {
  for (int seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(seed);
    const Fleet fleet{.obstacle_acceleration_mps2 = seed % 2 == 0 ? 1.0 : 0.0};
    const World world = make_world(Task::kHall, Environment::kMixed, 30, static_cast<std::uint64_t>(seed), fleet);
    EXPECT_EQ(world, make_world(Task::kHall, Environment::kMixed, 30, static_cast<std::uint64_t>(seed), fleet));
    ASSERT_EQ(world.robots.size(), 8u);
    const TemporaryDirectory directory;
    const OccupiedCubes walls = OccupiedCubes::load(with_walls_in_file(world, directory.path()).static_map);
    const auto room_of = [](const Eigen::Vector3d& place) {
      EXPECT_GT(std::abs(place.y()), 4.1);
      return 3 * (place.y() > 0) + static_cast<int>((place.x() + 12) / 8);
    };
    for (const WorldRobot& robot : world.robots) {
      EXPECT_NE(room_of(robot.start), room_of(robot.goal()));
      EXPECT_GT(walls.distance(robot.start, 2), robot.radius_m);
      EXPECT_GT(walls.distance(robot.goal(), 2), robot.radius_m);
    }
    for (const double y : {-4.0, 4.0}) {  // along the walls of the rooms: three gaps of 1.2 to 1.6 m
      std::vector<double> gaps_m;
      bool was_open = false;
      for (int i = -119; i < 119; ++i) {
        const bool is_open = walls.distance({0.1 * i + 0.05, y, 1}, 1) > 0;
        if (is_open && !was_open) gaps_m.push_back(0.0);
        if (is_open) gaps_m.back() += 0.1;
        was_open = is_open;
      }
      ASSERT_EQ(gaps_m.size(), 3u);
      for (const double gap_m : gaps_m) {
        EXPECT_GT(gap_m, 1.15);
        EXPECT_LT(gap_m, 1.65);
      }
    }
    for (const WorldObstacle& obstacle : world.obstacles) {
      const bool ring = obstacle.shape.kind == Shape::Kind::kRing;
      const double reach_m = ring ? obstacle.shape.size.x() + obstacle.shape.size.y() / 2 : obstacle.shape.size.x() / 2;
      for (double t_s = 0; t_s < 60; t_s += 0.5) {
        const Eigen::Vector3d place = state_at(obstacle, world, t_s)->position;
        EXPECT_GT(walls.distance({place.x(), place.y(), 1}, 5), reach_m - 1e-6) << t_s;
      }
    }
  }
}

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

TEST(Generator, ObstaclesThatAccelerateAreElseTheSame) {
  const World uniform = make_world(Task::kCross, Environment::kMixed, 20, 7);
  World world = make_world(Task::kCross, Environment::kMixed, 20, 7, {.obstacle_acceleration_mps2 = 1.5});
  for (WorldObstacle& obstacle : world.obstacles) {
    EXPECT_EQ(obstacle.acceleration_mps2, 1.5);
    obstacle.acceleration_mps2 = 0.0;
  }
  EXPECT_EQ(world, uniform);
}

TEST(Generator, RefusesWhatCannotBe) {
  EXPECT_THROW(make_world(Task::kHall, Environment::kPure, 30, 0, {.obstacle_acceleration_mps2 = 5.0}), WorldError);
  EXPECT_THROW(make_world(Task::kCross, Environment::kEmpty, 1, 0), WorldError);
  EXPECT_THROW(make_world(Task::kCross, Environment::kPure, 501, 0), WorldError);
  EXPECT_THROW(make_world(Task::kCross, Environment::kPure, -1, 0), WorldError);
}

class WorldCommand : public testing::Test {
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
  TemporaryDirectory directory_;
  std::string out_, err_;
};

TEST_F(WorldCommand, WritesTheWorldAndNothingElse) {
  const std::string file = (directory_ / "w.json").string();
  EXPECT_EQ(run({"--task", "cross", "--env", "mixed", "--obstacles", "20", "--seed", "7", "-o", file}), 0) << err_;
  EXPECT_EQ(read_world(file), make_world(Task::kCross, Environment::kMixed, 20, 7));
  EXPECT_EQ(std::distance(fs::directory_iterator(directory_.path()), {}), 1);
  EXPECT_EQ(run({"--task", "cross", "--env", "mixed", "--obstacles", "20", "--seed", "7", "-o", "-"}), 0) << err_;
  EXPECT_EQ(out_, read_text(directory_ / "w.json"));
  EXPECT_EQ(run({"--task", "circle", "--env", "empty", "--robots", "6", "--radius", "5", "-o", "-"}), 0) << err_;
  EXPECT_EQ(parse_world(out_, "-", "").robots.size(), 6u);
  EXPECT_EQ(run({"--obstacle-acceleration", "1", "--seed", "7", "-o", "-"}), 0) << err_;
  EXPECT_EQ(parse_world(out_, "-", ""),
            make_world(Task::kCross, Environment::kMixed, 20, 7, {.obstacle_acceleration_mps2 = 1.0}));
}

TEST_F(WorldCommand, DescribesSeededWorldsAndFiles) {
  EXPECT_EQ(run({"--task", "cross", "--env", "empty", "--describe"}), 0) << err_;
  EXPECT_NE(out_.find("16 x 16 x 4 m"), std::string::npos) << out_;
  EXPECT_NE(out_.find("0.00 % of the space"), std::string::npos) << out_;
  World world = make_world(Task::kCross, Environment::kEmpty, 0, 7);  // of 1024 m^3
  WorldObstacle obstacle;
  for (const auto& [kind, size] : {std::pair(Shape::Kind::kBox, Eigen::Vector3d(1, 2, 99)),
                                   std::pair(Shape::Kind::kColumn, Eigen::Vector3d(2, 2, 0)),
                                   std::pair(Shape::Kind::kSphere, Eigen::Vector3d(3, 0, 0)),
                                   std::pair(Shape::Kind::kRing, Eigen::Vector3d(1.5, 0.4, 0))}) {
    obstacle.shape.kind = kind;
    obstacle.shape.size = size;
    world.obstacles.push_back(obstacle);
  }
  world.obstacles[0].acceleration_mps2 = 9;  // but stands
  world.obstacles[1].velocity_mps = {3, 4};
  world.obstacles[1].acceleration_mps2 = std::numbers::pi;
  world.walls.push_back({{-9, -8, 0}, {-7, 8, 4}});
  const std::string file = (directory_ / "w.json").string();
  write_text(file, to_json_text(world, directory_.path()));
  EXPECT_EQ(run({"--describe", "--world", file}), 0) << err_;
  const double filled_m3 =
      8 + std::numbers::pi * 2 + std::numbers::pi / 6 * 27 + 2 * std::numbers::pi * std::numbers::pi * 1.5 * 0.2 * 0.2;
  for (const std::string& part :
       {swarm::fixed(100 * filled_m3 / 1024, 2) + " % of the space",
        std::string("1 columns, 1 rings, 1 boxes, 1 spheres, up to 7.00 m/s"), std::string("1, 6.25 %")}) {
    EXPECT_NE(out_.find(part), std::string::npos) << part << " in\n" << out_;
  }
}

TEST_F(WorldCommand, LetsPeopleWalkUpToWhereTheirTracksBegin) {
  World world = make_world(Task::kCross, Environment::kPure, 1, 7);
  world.obstacles.push_back(walker(2.0, {{1, 2}, {2, 4}, {0, 4}}));
  world.obstacles.push_back(walker(0.0, {{5, 0}, {5, 1}}));
  world.obstacles.push_back(walker(-1.0, {{-5, 0}, {-5, 1}}));
  const std::string file = (directory_ / "w.json").string();
  write_text(file, to_json_text(world, directory_.path()));
  EXPECT_EQ(run({"--world", file, "--walk-up", "0", "-o", "-"}), 0) << err_;
  EXPECT_EQ(parse_world(out_, "-", ""), world);
  EXPECT_EQ(run({"--world", file, "--walk-up", "0.5", "-o", "-"}), 0) << err_;
  world.obstacles[1].track.insert(world.obstacles[1].track.begin(), {1.5, {0.5, 1.0}});
  world.obstacles[1].center.head<2>() = Eigen::Vector2d(0.5, 1.0);
  EXPECT_EQ(parse_world(out_, "-", ""), world);
}

TEST_F(WorldCommand, RefusesBadOptionsWithOneLineAndCode2) {
  const std::string file = (directory_ / "w.json").string();
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--task", "spiral", "-o", file}, "spiral"},
      {{"--env", "full", "-o", file}, "full"},
      {{"--obstacles", "501", "-o", file}, "501"},
      {{"--obstacles", "x", "-o", file}, "obstacles"},
      {{"--robots", "4", "-o", file}, "robots"},
      {{"--obstacle-acceleration", "-1", "-o", file}, "obstacle-acceleration"},
      {{"--radius", "4", "-o", file}, "radius"},
      {{"--wind", "4", "-o", file}, "wind"},
      {{}, "out"},
      {{"--env", "empty", "--obstacles", "3", "-o", file}, "obstacles: 3"},
      {{"-o", (directory_ / "none/w.json").string()}, "none"},
      {{"--task", "circle", "--robots", "40", "--radius", "1", "-o", file}, "sum of radii"},
  };
  for (const auto& [arguments, mention] : cases) {
    SCOPED_TRACE(testing::PrintToString(arguments));
    EXPECT_EQ(run(arguments), 2);
    EXPECT_NE(err_.find(mention), std::string::npos) << err_;
    EXPECT_EQ(std::ranges::count(err_, '\n'), 1) << err_;
    EXPECT_TRUE(out_.empty()) << out_;
    EXPECT_TRUE(fs::is_empty(directory_.path()));
  }
}

TEST(Generator, RandomRobotsGoFromGoalToGoalNotFarAway) {
  const Fleet fleet{.robots = 100, .space_m = {50, 50, 4}, .goals = 10, .hop_m = 6};
  const World world = make_world(Task::kRandom, Environment::kEmpty, 0, 3, fleet);
  ASSERT_EQ(world.robots.size(), 100u);
  for (const WorldRobot& robot : world.robots) {
    ASSERT_EQ(robot.mission.size(), 10u);
    Eigen::Vector3d before = robot.start;
    for (const Waypoint& goal : robot.mission) {
      EXPECT_LE((goal.position - before).cwiseAbs().maxCoeff(), 6.0);
      EXPECT_GE((goal.position - before).norm(), 3.0);
      before = goal.position;
    }
  }
  EXPECT_THROW(make_world(Task::kCircle, Environment::kEmpty, 0, 1, {.goals = 2}), WorldError);
}

}  // namespace
}  // namespace swarm::test
