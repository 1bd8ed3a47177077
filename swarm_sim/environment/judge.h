// The honest judge of a flight: exact geometry on the robots' true positions, every 10 ms.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "planner_daemon/trajectory/bezier.h"
#include "swarm_sim/world/occupied_cubes.h"
#include "swarm_sim/world/world.h"

namespace swarm {

enum class Outcome : std::uint8_t {
  kSuccess,      // all arrived and nothing touched
  kCollision,    // anything touched
  kUnreachable,  // not all arrived, and one that did not says that no way leads to its goal (the judge does not ask)
  kDeadlock,     // not all arrived, and one that did not was nearly at rest over the last 3 s
  kTimeout,      // not all arrived, for any other reason
};
enum class Counterpart : std::uint8_t { kObstacle, kStaticMap, kRobot };
const char* to_string(Outcome outcome);
const char* to_string(Counterpart counterpart);

// First time that two came closer than touching.
struct Touch {
  double t_s = 0.0;
  int robot = 0;  // id; the first in the world's order of two robots
  Counterpart counterpart = Counterpart::kObstacle;
  int other = -1;           // index of the obstacle, id of the robot; -1 for the static map
  double distance_m = 0.0;  // between the surfaces then, negative
  bool at_rest = false;     // the robot was, nearly: it was hit rather than that it flew into something
  bool operator==(const Touch&) const = default;
};

// Smallest distance between the surfaces over the flight, when and to whom.
struct Clearance {
  double distance_m = std::numeric_limits<double>::infinity();  // stays infinite where there never was a counterpart
  double t_s = 0.0;
  int other = -1;  // as in Touch
};

struct RobotVerdict {
  int id = 0;
  int goals_reached = 0;  // of its mission, in their order
  // Until it first was as near to its last goal as its mission says (0.1 m), slower than 0.2 m/s, had reached all
  // others and waited at each.
  std::optional<double> flight_time_s;
  Clearance to_obstacles, to_robots;
  Clearance to_static_map;  // known up to kStaticReach_m
  double path_length_m = 0.0;
  Eigen::Vector3d max_speed_mps = Eigen::Vector3d::Zero();          // per axis
  Eigen::Vector3d max_acceleration_mps2 = Eigen::Vector3d::Zero();  // per axis
  double max_position_jump_m = 0.0;         // what the velocities of two updates do not explain (trapezoid rule)
  double max_acceleration_step_mps2 = 0.0;  // between two updates
};

class Judge {
 public:
  static constexpr double kStaticReach_m = 2.0;

  // `world` and `static_map` (may be null) must outlive the judge. time_limit_s > 0, else std::invalid_argument.
  Judge(const World& world, const OccupiedCubes* static_map, double time_limit_s = 60.0);

  // The robots' true states at `t_s`, in the world's order, times increasing. std::invalid_argument on another
  // number of robots, on a time not later than the one before, on values that are not finite.
  void update(double t_s, std::span<const MotionState> robots);

  // Two seconds after the last arrival, but not in an endless world, or at the time limit.
  bool finished() const;
  // As of the newest update.
  Outcome outcome() const;
  const std::vector<Touch>& touches() const { return touches_; }
  const std::vector<RobotVerdict>& robots() const { return verdicts_; }

 private:
  bool has_arrived(std::size_t i) const;
  bool all_arrived() const;
  void follow(std::size_t i, const MotionState& state, double step_s);
  void judge_mission(std::size_t i, const MotionState& state);
  void judge_obstacles(std::span<const MotionState> robots);
  void judge_static_map(std::size_t i, const Eigen::Vector3d& position);
  void judge_robots(std::span<const MotionState> robots);
  void note(std::size_t i, Counterpart counterpart, int other, double distance_m, Clearance* clearance);

  const World& world_;
  const OccupiedCubes* static_map_;
  double time_limit_s_;
  double t_s_ = -std::numeric_limits<double>::infinity();
  std::vector<RobotVerdict> verdicts_;
  std::vector<Touch> touches_;
  std::vector<MotionState> previous_;  // empty before the first update
  std::vector<double> rest_since_s_;   // per robot: since when it is nearly at rest
  std::vector<double> away_s_;         // per robot: when it last was not at its next goal
};

}  // namespace swarm
