#include "swarm_sim/world/world.h"

#include <algorithm>
#include <cmath>

#include "lcmtypes/bus/portable_math.h"
#include "lcmtypes/bus/text.h"
#include "swarm_sim/world/occupied_cubes.h"

namespace swarm {
namespace {

constexpr double kBorderTolerance_m = 1e-9;

struct Coordinate {
  double position, velocity;
};

// A triangle wave: unfold the reflections, then fold the travelled way back into one period.
Coordinate reflect(double start, double velocity, double low, double high, double t_s) {
  const double length = high - low;
  double way = std::fmod(start - low + velocity * t_s, 2.0 * length);
  if (way < 0.0) way += 2.0 * length;
  if (way < length) return {low + way, velocity};
  return {high - (way - length), -velocity};
}

// What the circle adds to the uniform motion along e at t = 0, with the rotation R and the quarter turn J:
// position r (e - R(w t) e), velocity -r w J R(w t) e, and so the acceleration r w^2 R(w t) e.
void add_sway(const WorldObstacle& obstacle, double t_s, ObstacleState* state) {
  const Eigen::Vector2d& velocity = obstacle.velocity_mps;
  const Eigen::Vector2d ahead = velocity.normalized();  // zero where it stands
  const double sense = velocity.x() * velocity.y() < 0.0 ? -1.0 : 1.0;
  const auto [sin, cos] = sin_cos(sense * kSwayRate_radps * std::fmod(t_s, kSwayPeriod_s));
  const Eigen::Vector2d turned(cos * ahead.x() - sin * ahead.y(), sin * ahead.x() + cos * ahead.y());
  state->position.head<2>() += obstacle.sway_radius_m() * (ahead - turned);
  state->velocity.head<2>() += sense * obstacle.sway_speed_mps() * Eigen::Vector2d(turned.y(), -turned.x());
}

std::string robot_key(std::size_t i, const std::string& key) {
  return "robots[" + std::to_string(i) + "]." + key;
}

[[noreturn]] void fail(const std::string& key, const std::string& value, const std::string& rule) {
  throw WorldError(key + ": " + value + " " + rule);
}

bool inside(const Eigen::Vector3d& p, const Space& space) {
  return (p.array() >= space.min.array() - kBorderTolerance_m).all() &&
         (p.array() <= space.max.array() + kBorderTolerance_m).all();
}

void check_pair(const World& world, std::size_t i, std::size_t j) {
  const WorldRobot &a = world.robots[i], &b = world.robots[j];
  if (a.id == b.id)
    fail(robot_key(i, "id"), std::to_string(a.id), "is taken by robots[" + std::to_string(j) + "]: ids must be unique");
  const double apart = a.radius_m + b.radius_m - kBorderTolerance_m;
  const std::string rule = "must be at least the sum of radii from robots[" + std::to_string(j) + "]";
  if ((a.start - b.start).norm() < apart) fail(robot_key(i, "start"), text_of(a.start), rule);
  if (!a.is_told && !b.is_told && (a.goal() - b.goal()).norm() < apart)
    fail(robot_key(i, "goal"), text_of(a.goal()), rule);
}

void check_start(const World& world, std::size_t i) {
  const WorldRobot& robot = world.robots[i];
  for (std::size_t k = 0; k < world.obstacles.size(); ++k) {
    const auto state = state_at(world.obstacles[k], world, 0.0);
    if (state && distance(world.obstacles[k].shape, robot.start - state->position) < robot.radius_m)
      fail(robot_key(i, "start"), text_of(robot.start), "must not touch obstacles[" + std::to_string(k) + "] at t = 0");
  }
}

void check_motion(const World& world, std::size_t k) {
  const WorldObstacle& obstacle = world.obstacles[k];
  const std::string key = "obstacles[" + std::to_string(k) + "]";
  for (std::size_t i = 1; i < obstacle.track.size(); ++i) {
    if (!(obstacle.track[i].t_s > obstacle.track[i - 1].t_s))
      fail(key + ".track[" + std::to_string(i) + "]", text_of(obstacle.track[i].t_s),
           "must be later than the point before");
  }
  const Rectangle& bounds = obstacle.bounds ? *obstacle.bounds : world.obstacle_bounds;
  const std::string within = obstacle.bounds ? "its bounds" : "obstacle_bounds";
  for (int axis = 0; axis < 2; ++axis) {
    if (obstacle.velocity_mps[axis] == 0.0) continue;
    if (obstacle.center[axis] < bounds.min[axis] - kBorderTolerance_m ||
        obstacle.center[axis] > bounds.max[axis] + kBorderTolerance_m)
      fail(key + ".center", text_of(obstacle.center), "must be inside " + within + " because the obstacle moves");
  }
}

}  // namespace

bool WorldObstacle::operator==(const WorldObstacle& other) const {
  return shape.kind == other.shape.kind && shape.size == other.shape.size && shape.yaw_rad == other.shape.yaw_rad &&
         center == other.center && velocity_mps == other.velocity_mps && acceleration_mps2 == other.acceleration_mps2 &&
         track == other.track && bounds == other.bounds;
}

std::optional<ObstacleState> state_at(const WorldObstacle& obstacle, const World& world, double t_s) {
  ObstacleState state;
  state.position = obstacle.center;
  if (obstacle.track.empty()) {
    const Rectangle& bounds = obstacle.bounds ? *obstacle.bounds : world.obstacle_bounds;
    for (int axis = 0; axis < 2; ++axis) {
      if (obstacle.velocity_mps[axis] == 0.0) continue;
      const Coordinate c =
          reflect(obstacle.center[axis], obstacle.velocity_mps[axis], bounds.min[axis], bounds.max[axis], t_s);
      state.position[axis] = c.position;
      state.velocity[axis] = c.velocity;
    }
    if (obstacle.acceleration_mps2 > 0.0) add_sway(obstacle, t_s, &state);
    return state;
  }
  const auto& track = obstacle.track;
  if (!(t_s >= track.front().t_s && t_s <= track.back().t_s)) return std::nullopt;
  const auto later = std::upper_bound(track.begin(), track.end() - 1, t_s,
                                      [](double t, const TrackPoint& point) { return t < point.t_s; });
  const TrackPoint &from = *(later - 1), &to = *later;
  const Eigen::Vector2d velocity = (to.position - from.position) / (to.t_s - from.t_s);
  state.position.head<2>() = t_s == to.t_s ? to.position : from.position + velocity * (t_s - from.t_s);
  state.velocity.head<2>() = velocity;
  return state;
}

void check_world(const World& world) {
  const std::size_t n = world.robots.size();
  if (n < 1 || n > kMaxRobots)
    fail("robots", std::to_string(n) + " robots", "must be in [1, " + std::to_string(kMaxRobots) + "]");
  for (std::size_t k = 0; k < world.obstacles.size(); ++k) check_motion(world, k);
  for (std::size_t i = 0; i < n; ++i) {
    const WorldRobot& robot = world.robots[i];
    if (robot.id < 0 || robot.id > kMaxRobotId)
      fail(robot_key(i, "id"), std::to_string(robot.id), "must be in [0, " + std::to_string(kMaxRobotId) + "]");
    if (!inside(robot.start, world.space)) fail(robot_key(i, "start"), text_of(robot.start), "must be inside space");
    for (std::size_t k = 0; k < robot.mission.size(); ++k) {
      const Eigen::Vector3d& place = robot.mission[k].position;
      const std::string key = robot.has_one_goal() ? "goal" : "goals[" + std::to_string(k) + "].position";
      if (!inside(place, world.space)) fail(robot_key(i, key), text_of(place), "must be inside space");
    }
    for (std::size_t j = 0; j < i; ++j) check_pair(world, i, j);
    check_start(world, i);
  }
}

void check_starts(const World& world, const OccupiedCubes& static_map) {
  for (std::size_t i = 0; i < world.robots.size(); ++i) {
    const WorldRobot& robot = world.robots[i];
    if (static_map.distance(robot.start, robot.radius_m) < robot.radius_m)
      fail(robot_key(i, "start"), text_of(robot.start), "must not touch the static map");
  }
}

}  // namespace swarm
