// A world: where robots start and go, what stands and moves around them, exactly and at any time.
//
// The room world/ holds what can be said of worlds without flying in them: files and lists of them, the seeded ones of
// the paper, the static map, the robots' clocks. Nothing of the simulator stands below it.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <filesystem>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "map_daemon/obstacle.h"
#include "planner_daemon/trajectory/mission.h"
#include "planner_daemon/trajectory/motion_limits.h"
#include "swarm_sim/world/imperfections.h"

namespace swarm {

class OccupiedCubes;

inline constexpr int kMaxRobots = 1000;  // by one roster fly fewer (kMaxRosterRobots)
inline constexpr int kMaxRobotId = 9999;

// What is wrong with a world: one line with key, value and rule; the file as well when it came from one.
struct WorldError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// An axis-aligned box, W [m].
struct Space {
  Eigen::Vector3d min = {-8.0, -8.0, 0.0};
  Eigen::Vector3d max = {8.0, 8.0, 4.0};
  bool operator==(const Space&) const = default;
};

// An axis-aligned rectangle seen from above, W [m].
struct Rectangle {
  Eigen::Vector2d min = {-8.0, -8.0};
  Eigen::Vector2d max = {8.0, 8.0};
  bool operator==(const Rectangle&) const = default;
};

// A sphere that shall fly from its start to one place after the other, W [m].
struct WorldRobot {
  int id = 0;
  Eigen::Vector3d start = Eigen::Vector3d::Zero();
  Mission mission = {{}};  // never empty
  double radius_m = 0.2;
  std::optional<MotionLimits> limits = std::nullopt;  // none: the world's
  bool is_told = false;  // others tell it where to go, all the time: its mission is to be at its start

  const Eigen::Vector3d& goal() const { return mission.back().position; }
  // Its mission is a place alone.
  bool has_one_goal() const { return mission.size() == 1 && mission[0] == Waypoint{goal()}; }
  bool operator==(const WorldRobot&) const = default;
};

struct TrackPoint {
  double t_s = 0.0;
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  // of the centre, W [m]
  bool operator==(const TrackPoint&) const = default;
};

// An obstacle that accelerates goes round a circle in this time.
inline constexpr double kSwayPeriod_s = 4.0;
inline constexpr double kSwayRate_radps = 2.0 * std::numbers::pi / kSwayPeriod_s;
inline constexpr double kMaxObstacleAcceleration_mps2 = 100.0;

// Without a track the centre moves uniformly from `center` and each horizontal coordinate reflects at its bounds, or at
// the world's obstacle_bounds where it has none. With an acceleration it goes round a circle on top of that, to the
// right where the coordinates of its velocity have opposite signs, else to the left, and so may leave its bounds by the
// circle's diameter. What stands does not sway.
// With a track (two points or more, times increasing) it moves linearly from point to point, at the height of `center`,
// and exists only between the first and the last.
struct WorldObstacle {
  Shape shape;                                             // never kVoxels
  Eigen::Vector3d center = Eigen::Vector3d::Zero();        // at t = 0, or at the first track point, W [m]
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // of the uniform motion at t = 0; zero with a track
  double acceleration_mps2 = 0.0;                          // its magnitude at any time; 0 with a track
  std::vector<TrackPoint> track;
  std::optional<Rectangle> bounds;

  // Of the circle, and the speed on it.
  double sway_radius_m() const { return acceleration_mps2 / (kSwayRate_radps * kSwayRate_radps); }
  double sway_speed_mps() const { return acceleration_mps2 / kSwayRate_radps; }
  bool operator==(const WorldObstacle& other) const;
};

struct World {
  std::string name;
  Space space;
  Rectangle obstacle_bounds;
  MotionLimits limits;  // of every robot that has none of its own
  double sensing_radius_m = 5.0;
  std::filesystem::path static_map;  // OctoMap file, absolute; empty: none
  std::vector<Space> walls;          // solid; not with a static_map, but one is made of them to be flown in (walls.h)
  std::vector<WorldRobot> robots;
  std::vector<WorldObstacle> obstacles;
  VehicleOptions vehicle;  // of every robot
  SensorOptions sensor;
  bool operator==(const World&) const = default;

  // Flights in it end when they are ended.
  bool is_endless() const {
    return std::ranges::any_of(robots, [](const WorldRobot& robot) { return robot.is_told; });
  }
};

inline const MotionLimits& limits_of(const World& world, const WorldRobot& robot) {
  return robot.limits ? *robot.limits : world.limits;
}

struct ObstacleState {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // of the shape's centre, W [m]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // W [m/s]; after the turn where it just turns
};

// Where `obstacle` is, in closed form; nothing while it does not exist. Any finite t, also before 0.
std::optional<ObstacleState> state_at(const WorldObstacle& obstacle, const World& world, double t_s);

// Checks what concerns several values at once: 1..kMaxRobots robots with unique ids in [0, kMaxRobotId], starts and
// goals inside space (the border included), starts and last goals apart from each other, starts clear of the obstacles
// at t = 0, moving obstacles inside their bounds, track times increasing. Throws WorldError.
void check_world(const World& world);

// Throws WorldError where a robot's start touches the static map.
void check_starts(const World& world, const OccupiedCubes& static_map);

}  // namespace swarm
