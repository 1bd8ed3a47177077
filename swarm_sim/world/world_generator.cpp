#include "swarm_sim/world/world_generator.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "lcmtypes/bus/portable_math.h"
#include "lcmtypes/bus/text.h"
#include "swarm_sim/world/building.h"
#include "swarm_sim/world/random.h"
#include "swarm_sim/world/walkers.h"

namespace swarm {
namespace {

constexpr double kHeight_m = 1.0;          // of every start and goal
constexpr double kStartClearance_m = 0.7;  // between an obstacle and a robot at t = 0
constexpr double kLeg_m = 5.0;             // of a tour, at least
constexpr int kMaxTries = 10000;           // per obstacle or robot
constexpr int kUsualRobots = 10, kUsualRobotsInHall = 8;
constexpr int kMaxObstacles = 500;
constexpr std::array kTasks = {"cross", "bilateral", "unilateral", "circle", "random", "hall", "tour"};
constexpr std::array kEnvironments = {"empty", "pure", "mixed"};

// Cut towards zero, so that ranges hold and libraries that differ in the last bit agree.
double cut(double value) {
  return std::trunc(value * 1e6) / 1e6;
}

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  double uniform(double low, double high) { return cut(low + (high - low) * random_.uniform()); }

 private:
  Random random_;
};

void add_robot(World* world, const Fleet& fleet, const Eigen::Vector3d& start, Mission mission) {
  world->robots.push_back({static_cast<int>(world->robots.size()), start, std::move(mission), fleet.robot_m});
}
// At the height of all tasks of the paper.
void add_level_robot(World* world, const Fleet& fleet, const Eigen::Vector2d& start, const Eigen::Vector2d& goal) {
  add_robot(world, fleet, {start.x(), start.y(), kHeight_m}, {{{goal.x(), goal.y(), kHeight_m}}});
}

void add_circle(World* world, const Fleet& fleet) {
  const double radius_m = fleet.circle_m != 0.0 ? fleet.circle_m : 10.0;
  if (!(radius_m >= 0.5 && radius_m <= 1000.0))
    throw WorldError("radius: " + text_of(radius_m) + " must be in [0.5, 1000] m");
  const int robots = fleet.robots != 0 ? fleet.robots : kUsualRobots;
  for (int i = 0; i < robots; ++i) {
    const auto [sin, cos] = sin_cos(2.0 * std::numbers::pi * i / robots);
    const Eigen::Vector2d start(cut(radius_m * cos), cut(radius_m * sin));
    add_level_robot(world, fleet, start, -start);
  }
  const double outer = std::max(world->space.max.x(), radius_m + 1.0);
  const double inner = std::max(world->obstacle_bounds.max.x(), radius_m - 1.0);
  world->space = {{-outer, -outer, world->space.min.z()}, {outer, outer, world->space.max.z()}};
  world->obstacle_bounds = {{-inner, -inner}, {inner, inner}};
}

// Starts and goals each apart by a robot's width more than touching, goals away from where their robots come from.
void add_random(World* world, const Fleet& fleet, Draw* random) {
  const double edge_m = 2 * fleet.robot_m;
  world->space = {{-fleet.space_m.x() / 2, -fleet.space_m.y() / 2, 0},
                  {fleet.space_m.x() / 2, fleet.space_m.y() / 2, fleet.space_m.z()}};
  world->obstacle_bounds = {world->space.min.head<2>(), world->space.max.head<2>()};
  const Eigen::Vector3d low = world->space.min.array() + edge_m, high = world->space.max.array() - edge_m;
  if ((low.array() >= high.array()).any()) throw WorldError("size: the robots must fit into the space");
  std::vector<Eigen::Vector3d> starts, goals;
  const auto place = [&](std::vector<Eigen::Vector3d>* places, const Eigen::Vector3d* away_from) {
    const bool hops = away_from != nullptr && fleet.hop_m > 0.0;
    const Eigen::Vector3d from = hops ? low.cwiseMax((away_from->array() - fleet.hop_m).matrix()) : low;
    const Eigen::Vector3d to = hops ? high.cwiseMin((away_from->array() + fleet.hop_m).matrix()) : high;
    const double least_m = std::min(fleet.space_m.head<2>().minCoeff() / 4, hops ? fleet.hop_m / 2 : INFINITY);
    for (int tries = 0; tries < kMaxTries; ++tries) {
      const Eigen::Vector3d drawn(random->uniform(from.x(), to.x()), random->uniform(from.y(), to.y()),
                                  random->uniform(from.z(), to.z()));
      const bool apart = std::ranges::all_of(
          *places, [&](const Eigen::Vector3d& other) { return (drawn - other).norm() >= 2 * edge_m; });
      const bool away = away_from == nullptr || (drawn - *away_from).norm() >= least_m;
      if (!apart || !away) continue;
      places->push_back(drawn);
      return;
    }
    throw WorldError("robots: " + std::to_string(fleet.robots) + " must find places apart; there is no room");
  };
  const int robots = fleet.robots != 0 ? fleet.robots : kUsualRobots;
  for (int i = 0; i < robots; ++i) {
    place(&starts, nullptr);
    Mission mission;
    for (int goal = 0; goal < fleet.goals; ++goal) {
      const Eigen::Vector3d before = mission.empty() ? starts.back() : mission.back().position;
      place(&goals, &before);
      mission.push_back({goals.back()});
    }
    add_robot(world, fleet, starts.back(), std::move(mission));
  }
}

// The hall from above: the middle, and rooms along both sides of it, between walls of 0.2 m.
constexpr double kHallLength_m = 24.0, kHallWidth_m = 8.0, kHallHeight_m = 3.0, kRoomDepth_m = 5.0, kWall_m = 0.2;
constexpr int kRoomsPerSide = 3, kRooms = 2 * kRoomsPerSide;

// Room `i` between the middles of the walls around it.
Rectangle room(int i) {
  const double length_m = kHallLength_m / kRoomsPerSide, x = -kHallLength_m / 2 + i % kRoomsPerSide * length_m;
  const double near = kHallWidth_m / 2, far = near + kRoomDepth_m;
  return i < kRoomsPerSide ? Rectangle{{x, near}, {x + length_m, far}} : Rectangle{{x, -far}, {x + length_m, -near}};
}
Rectangle middle_of_hall() {
  return {{-kHallLength_m / 2, -kHallWidth_m / 2}, {kHallLength_m / 2, kHallWidth_m / 2}};
}
// What is left `margin_m` off the faces of the walls around.
Rectangle within_walls(const Rectangle& place, double margin_m) {
  const double off_m = kWall_m / 2 + margin_m;
  return {place.min.array() + off_m, place.max.array() - off_m};
}

void add_wall(World* world, const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
  const auto rounded = [](double value) { return std::round(value * 1e6) / 1e6; };
  const Eigen::Vector2d low = (from.cwiseMin(to).array() - kWall_m / 2).unaryExpr(rounded);
  const Eigen::Vector2d high = (from.cwiseMax(to).array() + kWall_m / 2).unaryExpr(rounded);
  world->walls.push_back({{low.x(), low.y(), 0.0}, {high.x(), high.y(), kHallHeight_m}});
}

// Doors on the grid of the walls' voxels.
void add_hall(World* world, const Fleet& fleet, Draw* random) {
  const double x = kHallLength_m / 2, near = kHallWidth_m / 2, far = near + kRoomDepth_m;
  world->space = {{-x, -far, 0.0}, {x, far, kHallHeight_m}};
  world->obstacle_bounds = {world->space.min.head<2>(), world->space.max.head<2>()};
  for (const double side : {-1.0, 1.0}) {
    add_wall(world, {side * x, -far}, {side * x, far});
    add_wall(world, {-x, side * far}, {x, side * far});
    for (int i = 1; i < kRoomsPerSide; ++i) {
      const double between = -x + i * kHallLength_m / kRoomsPerSide;
      add_wall(world, {between, side * near}, {between, side * far});
    }
  }
  for (int i = 0; i < kRooms; ++i) {
    const Rectangle inside = within_walls(room(i), kWall_m);
    const double y = i < kRoomsPerSide ? near : -near, half_m = 0.1 * std::round(random->uniform(6.0, 8.0));
    const double door = 0.1 * std::round(10.0 * random->uniform(inside.min.x() + half_m, inside.max.x() - half_m));
    add_wall(world, {room(i).min.x(), y}, {door - half_m - kWall_m / 2, y});
    add_wall(world, {door + half_m + kWall_m / 2, y}, {room(i).max.x(), y});
  }
  const int robots = fleet.robots != 0 ? fleet.robots : kUsualRobotsInHall;
  std::vector<Eigen::Vector2d> starts, goals;
  const auto place = [&](std::vector<Eigen::Vector2d>* places, int in_room) {
    const Rectangle inside = within_walls(room(in_room), 2 * fleet.robot_m + 0.2);
    for (int tries = 0; tries < kMaxTries; ++tries) {
      const Eigen::Vector2d drawn(random->uniform(inside.min.x(), inside.max.x()),
                                  random->uniform(inside.min.y(), inside.max.y()));
      if (std::ranges::any_of(*places, [&](const auto& other) { return (drawn - other).norm() < 5 * fleet.robot_m; }))
        continue;
      places->push_back(drawn);
      return;
    }
    throw WorldError("robots: " + std::to_string(robots) + " must find places apart; there is no room");
  };
  for (int i = 0; i < robots; ++i) {
    place(&starts, i % kRooms);
    place(&goals, (i + 1 + static_cast<int>(random->uniform(0.0, kRooms - 1.0))) % kRooms);
    add_level_robot(world, fleet, starts.back(), goals.back());
  }
}

// Starts apart as on the circle, so are last goals; each goal at least 5 m from the place before.
void add_tour(World* world, const Fleet& fleet, Draw* random) {
  const Building building = building_in(fleet.building, fleet.robot_m, {fleet.low_m, fleet.high_m});
  world->space = building.space;
  world->static_map = std::filesystem::absolute(fleet.building);
  world->obstacle_bounds = {world->space.min.head<2>(), world->space.max.head<2>()};
  std::vector<Eigen::Vector3d> starts, ends;
  const auto place = [&](const std::vector<Eigen::Vector3d>& others, const Eigen::Vector3d* before) {
    for (int tries = 0; tries < kMaxTries; ++tries) {
      const auto count = static_cast<double>(building.places.size());
      const Eigen::Vector3d& drawn = building.places[static_cast<std::size_t>(random->uniform(0.0, count))];
      const bool apart = std::ranges::all_of(
          others, [&](const Eigen::Vector3d& other) { return (drawn - other).norm() >= 5 * fleet.robot_m; });
      if (apart && (before == nullptr || (drawn - *before).norm() >= kLeg_m)) return drawn;
    }
    throw WorldError("building: " + fleet.building + " must hold places apart for all robots, " + text_of(kLeg_m) +
                     " m from goal to goal; there is no room");
  };
  for (int i = 0; i < std::max(fleet.robots, 1); ++i) {
    starts.push_back(place(starts, nullptr));
    Mission mission;
    for (int goal = 0; goal < fleet.goals; ++goal) {
      const Eigen::Vector3d before = mission.empty() ? starts.back() : mission.back().position;
      mission.push_back({place(goal + 1 < fleet.goals ? std::vector<Eigen::Vector3d>() : ends, &before)});
    }
    ends.push_back(mission.back().position);
    add_robot(world, fleet, starts.back(), std::move(mission));
  }
}

// In the hall or in one of its rooms, in proportion to their areas.
void put_into_hall(WorldObstacle* obstacle, Draw* random) {
  constexpr double kMiddle = kHallWidth_m / (kHallWidth_m + 2 * kRoomDepth_m);
  const double where = random->uniform(0.0, 1.0);
  const Rectangle place =
      where < kMiddle ? middle_of_hall()
                      : room(std::min(kRooms - 1, static_cast<int>((where - kMiddle) / (1 - kMiddle) * kRooms)));
  const Shape& shape = obstacle->shape;
  const bool ring = shape.kind == Shape::Kind::kRing;
  const double reach_m = ring ? shape.size.x() + shape.size.y() / 2 : shape.size.x() / 2;
  obstacle->bounds = within_walls(place, reach_m + 2 * obstacle->sway_radius_m());
  if ((obstacle->bounds->min.array() >= obstacle->bounds->max.array()).any())
    throw WorldError("obstacle-acceleration: " + text_of(obstacle->acceleration_mps2) +
                     " must leave obstacles room between the walls of the hall");
}

void add_robots(World* world, Task task, const Fleet& fleet, Draw* random) {
  const auto add = [&](const Eigen::Vector2d& start, const Eigen::Vector2d& goal) {
    add_level_robot(world, fleet, start, goal);
  };
  switch (task) {
    case Task::kCross:
      add({-8, 0}, {8, 0});
      add({8, 0}, {-8, 0});
      add({0, 8}, {0, -8});
      add({0, -8}, {0, 8});
      break;
    case Task::kBilateral:
      for (const double y : {3.0, -3.0}) add({-8, y}, {8, -y});
      for (const double y : {-3.0, 3.0}) add({8, y}, {-8, -y});
      break;
    case Task::kUnilateral:
      for (const double y : {6.0, 2.0, -2.0, -6.0}) add({-8, y}, {8, -y});
      break;
    case Task::kCircle:
      add_circle(world, fleet);
      break;
    case Task::kRandom:
      add_random(world, fleet, random);
      break;
    case Task::kHall:
      add_hall(world, fleet, random);
      break;
    case Task::kTour:
      add_tour(world, fleet, random);
      break;
  }
}

WorldObstacle draw_obstacle(bool ring, const World& world, double acceleration_mps2, Draw* random) {
  const bool in_hall = !world.walls.empty();
  WorldObstacle obstacle;
  obstacle.acceleration_mps2 = acceleration_mps2;
  if (ring) {
    obstacle.shape.kind = Shape::Kind::kRing;
    obstacle.shape.size = {random->uniform(0.7, in_hall ? 1.2 : 2.5), 0.1, 0.0};
    obstacle.center.z() = random->uniform(0.8, 2.0);
    obstacle.shape.yaw_rad = random->uniform(0.0, std::numbers::pi);
  } else {
    obstacle.shape.kind = Shape::Kind::kColumn;
    obstacle.shape.size = {random->uniform(0.5, 1.0), in_hall ? kHallHeight_m : 4.0, 0.0};
    obstacle.center.z() = 0.5 * obstacle.shape.size.y();
  }
  if (in_hall) put_into_hall(&obstacle, random);
  const Rectangle& bounds = obstacle.bounds ? *obstacle.bounds : world.obstacle_bounds;
  const double speed_mps = random->uniform(0.0, 1.0), heading_rad = random->uniform(0.0, 2.0 * std::numbers::pi);
  const auto [sin, cos] = sin_cos(heading_rad);
  obstacle.velocity_mps = {cut(speed_mps * cos), cut(speed_mps * sin)};
  for (int axis = 0; axis < 2; ++axis) obstacle.center[axis] = random->uniform(bounds.min[axis], bounds.max[axis]);
  return obstacle;
}

bool clear_of_starts(const WorldObstacle& obstacle, const World& world) {
  return std::ranges::all_of(world.robots, [&](const WorldRobot& robot) {
    return distance(obstacle.shape, robot.start - obstacle.center) - robot.radius_m >= kStartClearance_m;
  });
}

template <class Names>
int index_of(const Names& names, const std::string& text, const std::string& what) {
  std::string known;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (text == names[i]) return static_cast<int>(i);
    known += (i == 0 ? "" : ", ") + std::string(names[i]);
  }
  throw WorldError(what + ": \"" + text + "\" must be one of " + known);
}

}  // namespace

const char* to_string(Task task) {
  return kTasks[static_cast<std::size_t>(task)];
}
const char* to_string(Environment environment) {
  return kEnvironments[static_cast<std::size_t>(environment)];
}
Task task_from(const std::string& text) {
  return static_cast<Task>(index_of(kTasks, text, "task"));
}
Environment environment_from(const std::string& text) {
  return static_cast<Environment>(index_of(kEnvironments, text, "env"));
}

World make_world(Task task, Environment environment, int obstacles, std::uint64_t seed, const Fleet& fleet) {
  const int most = environment == Environment::kEmpty ? 0 : kMaxObstacles;
  if (obstacles < 0 || obstacles > most)
    throw WorldError("obstacles: " + std::to_string(obstacles) + " must be in [0, " + std::to_string(most) +
                     "] with env " + to_string(environment));
  const bool is_tour = task == Task::kTour;
  const bool free_number = task == Task::kCircle || task == Task::kRandom || task == Task::kHall || is_tour;
  if (!free_number && fleet.robots != 0)
    throw WorldError("robots: only the tasks circle, random, hall and tour let you choose the number of robots");
  const int least = is_tour ? 1 : 2;
  if (fleet.robots != 0 && (fleet.robots < least || fleet.robots > kMaxRobots))
    throw WorldError("robots: " + std::to_string(fleet.robots) + " must be in [" + std::to_string(least) + ", " +
                     std::to_string(kMaxRobots) + "]");
  if (task != Task::kCircle && fleet.circle_m != 0.0) throw WorldError("radius: only the task circle has a radius");
  if (task != Task::kRandom && !is_tour && fleet.goals != 1)
    throw WorldError("goals: only robots of the tasks random and tour have several goals");
  if (task != Task::kRandom && fleet.hop_m != 0.0) throw WorldError("hop: only robots of the task random hop");
  if (is_tour != !fleet.building.empty())
    throw WorldError(is_tour ? "building: the task tour needs one" : "building: only the task tour has one");
  if (is_tour && environment != Environment::kEmpty)
    throw WorldError(std::string("env: \"") + to_string(environment) +
                     "\" must be empty for the task tour: nothing keeps obstacles off its walls");
  if (task != Task::kHall && !fleet.people.empty()) throw WorldError("people: only the task hall has people");
  try {
    verify(fleet.limits);
  } catch (const OptionError& error) {
    throw WorldError(error.what());
  }
  World world;
  world.name = std::string(to_string(task)) + "-" + to_string(environment) + "-" + std::to_string(obstacles) + "-" +
               std::to_string(seed);
  world.obstacle_bounds = {{-7, -7}, {7, 7}};
  world.limits = fleet.limits;
  Draw random(seed);
  add_robots(&world, task, fleet, &random);
  const int columns = environment == Environment::kMixed ? (obstacles + 1) / 2 : obstacles;
  for (int i = 0; i < obstacles; ++i) {
    const auto draw = [&] { return draw_obstacle(i >= columns, world, fleet.obstacle_acceleration_mps2, &random); };
    WorldObstacle obstacle = draw();
    for (int tries = 1; !clear_of_starts(obstacle, world); ++tries) {
      if (tries == kMaxTries)
        throw WorldError("obstacles: " + std::to_string(obstacles) +
                         " must find places 0.7 m clear of every start; there is no room");
      obstacle = draw();
    }
    world.obstacles.push_back(std::move(obstacle));
  }
  if (!fleet.people.empty()) {
    const std::vector<std::string> files = split(fleet.people, ',');
    for (WorldObstacle& walker : walkers_in(files[seed % files.size()], within_walls(middle_of_hall(), 0.0)))
      world.obstacles.push_back(std::move(walker));
  }
  check_world(world);
  return world;
}

}  // namespace swarm
