#include "swarm_sim/world_generator.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "map_daemon/portable_math.h"
#include "swarm_sim/text.h"

namespace swarm {
namespace {

constexpr double kHeight_m = 1.0;          // of every start and goal
constexpr double kStartClearance_m = 0.7;  // between an obstacle and a robot at t = 0
constexpr int kMaxTries = 10000;           // per obstacle
constexpr int kMaxObstacles = 500;
constexpr std::array kTasks = {"cross", "bilateral", "unilateral", "circle"};
constexpr std::array kEnvironments = {"empty", "pure", "mixed"};

// Cut towards zero, so that ranges hold and libraries that differ in the last bit agree.
double cut(double value) {
  return std::trunc(value * 1e6) / 1e6;
}

// The standard fixes the engine's numbers but not those of its distributions.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return cut(low + (high - low) * (static_cast<double>(engine_() >> 11) * 0x1p-53));
  }

 private:
  std::mt19937_64 engine_;
};

void add_robot(World* world, const Eigen::Vector2d& start, const Eigen::Vector2d& goal) {
  const int id = static_cast<int>(world->robots.size());
  world->robots.push_back({id, {start.x(), start.y(), kHeight_m}, {goal.x(), goal.y(), kHeight_m}, 0.2});
}

void add_circle(World* world, const Circle& circle) {
  if (circle.robots < 2 || circle.robots > kMaxRobots)
    throw WorldError("robots: " + std::to_string(circle.robots) + " must be in [2, 40] on a circle");
  if (!(circle.radius_m >= 0.5 && circle.radius_m <= 1000.0))
    throw WorldError("radius: " + text_of(circle.radius_m) + " must be in [0.5, 1000] m");
  for (int i = 0; i < circle.robots; ++i) {
    const auto [sin, cos] = sin_cos(2.0 * std::numbers::pi * i / circle.robots);
    const Eigen::Vector2d start(cut(circle.radius_m * cos), cut(circle.radius_m * sin));
    add_robot(world, start, -start);
  }
  const double outer = std::max(world->space.max.x(), circle.radius_m + 1.0);
  const double inner = std::max(world->obstacle_bounds.max.x(), circle.radius_m - 1.0);
  world->space = {{-outer, -outer, world->space.min.z()}, {outer, outer, world->space.max.z()}};
  world->obstacle_bounds = {{-inner, -inner}, {inner, inner}};
}

void add_robots(World* world, Task task, const Circle& circle) {
  switch (task) {
    case Task::kCross:
      add_robot(world, {-8, 0}, {8, 0});
      add_robot(world, {8, 0}, {-8, 0});
      add_robot(world, {0, 8}, {0, -8});
      add_robot(world, {0, -8}, {0, 8});
      break;
    case Task::kBilateral:
      for (const double y : {3.0, -3.0}) add_robot(world, {-8, y}, {8, -y});
      for (const double y : {-3.0, 3.0}) add_robot(world, {8, y}, {-8, -y});
      break;
    case Task::kUnilateral:
      for (const double y : {6.0, 2.0, -2.0, -6.0}) add_robot(world, {-8, y}, {8, -y});
      break;
    case Task::kCircle:
      add_circle(world, circle);
      break;
  }
}

WorldObstacle draw_obstacle(bool ring, const Rectangle& bounds, Random* random) {
  WorldObstacle obstacle;
  if (ring) {
    obstacle.shape.kind = Shape::Kind::kRing;
    obstacle.shape.size = {random->uniform(0.7, 2.5), 0.1, 0.0};
    obstacle.center.z() = random->uniform(0.8, 2.0);
    obstacle.shape.yaw_rad = random->uniform(0.0, std::numbers::pi);
  } else {
    obstacle.shape.kind = Shape::Kind::kColumn;
    obstacle.shape.size = {random->uniform(0.5, 1.0), 4.0, 0.0};
    obstacle.center.z() = 0.5 * obstacle.shape.size.y();
  }
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

World make_world(Task task, Environment environment, int obstacles, std::uint64_t seed, const Circle& circle) {
  const int most = environment == Environment::kEmpty ? 0 : kMaxObstacles;
  if (obstacles < 0 || obstacles > most)
    throw WorldError("obstacles: " + std::to_string(obstacles) + " must be in [0, " + std::to_string(most) +
                     "] with env " + to_string(environment));
  World world;
  world.name = std::string(to_string(task)) + "-" + to_string(environment) + "-" + std::to_string(obstacles) + "-" +
               std::to_string(seed);
  world.obstacle_bounds = {{-7, -7}, {7, 7}};
  add_robots(&world, task, circle);
  Random random(seed);
  const int columns = environment == Environment::kMixed ? (obstacles + 1) / 2 : obstacles;
  for (int i = 0; i < obstacles; ++i) {
    WorldObstacle obstacle = draw_obstacle(i >= columns, world.obstacle_bounds, &random);
    for (int tries = 1; !clear_of_starts(obstacle, world); ++tries) {
      if (tries == kMaxTries)
        throw WorldError("obstacles: " + std::to_string(obstacles) +
                         " must find places 0.7 m clear of every start; there is no room");
      obstacle = draw_obstacle(i >= columns, world.obstacle_bounds, &random);
    }
    world.obstacles.push_back(std::move(obstacle));
  }
  check_world(world);
  return world;
}

}  // namespace swarm
