#include "swarm_sim/environment/judge.h"

#include <algorithm>
#include <stdexcept>

#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr double kTouchTolerance_m = 1e-9;  // rounding of the distance between surfaces that just touch
constexpr double kArrived_mps = 0.2, kAfterArrival_s = 2.0;
constexpr double kAtRest_mps = 0.1, kDeadlock_s = 3.0;
constexpr double kTimeTolerance_s = 1e-9;  // sums of time steps

bool finite(const MotionState& s) {
  return s.position.allFinite() && s.velocity.allFinite() && s.acceleration.allFinite();
}

}  // namespace

const char* to_string(Outcome outcome) {
  switch (outcome) {
    case Outcome::kSuccess:
      return "success";
    case Outcome::kCollision:
      return "collision";
    case Outcome::kUnreachable:
      return "unreachable";
    case Outcome::kDeadlock:
      return "deadlock";
    case Outcome::kTimeout:
      return "timeout";
  }
  return "?";
}

const char* to_string(Counterpart counterpart) {
  switch (counterpart) {
    case Counterpart::kObstacle:
      return "obstacle";
    case Counterpart::kStaticMap:
      return "static_map";
    case Counterpart::kRobot:
      return "robot";
  }
  return "?";
}

Judge::Judge(const World& world, const OccupiedCubes* static_map, double time_limit_s)
    : world_(world), static_map_(static_map), time_limit_s_(time_limit_s) {
  if (!(time_limit_s > 0.0))
    throw std::invalid_argument("time_limit_s: " + text_of(time_limit_s) + " must be positive");
  for (const WorldRobot& robot : world.robots) verdicts_.emplace_back().id = robot.id;
  rest_since_s_.resize(world.robots.size());
  away_s_.resize(world.robots.size());
}

void Judge::update(double t_s, std::span<const MotionState> robots) {
  if (robots.size() != verdicts_.size())
    throw std::invalid_argument("robots: " + std::to_string(robots.size()) +
                                " states must be as many as the world's robots");
  if (!(t_s > t_s_)) throw std::invalid_argument("t_s: " + text_of(t_s) + " must be later than the update before");
  if (!std::ranges::all_of(robots, finite))
    throw std::invalid_argument("robots: every state must be finite, at t = " + text_of(t_s) + " s");
  const bool first = previous_.empty();
  const double step_s = first ? 0.0 : t_s - t_s_;
  t_s_ = t_s;
  if (first) {
    std::ranges::fill(rest_since_s_, t_s);
    std::ranges::fill(away_s_, t_s);
  }
  for (std::size_t i = 0; i < robots.size(); ++i) {
    if (first) previous_.push_back(robots[i]);
    follow(i, robots[i], step_s);
    if (static_map_ != nullptr) judge_static_map(i, robots[i].position);
  }
  judge_obstacles(robots);
  judge_robots(robots);
}

void Judge::follow(std::size_t i, const MotionState& state, double step_s) {
  RobotVerdict& verdict = verdicts_[i];
  const MotionState& before = previous_[i];
  const Eigen::Vector3d moved = state.position - before.position;
  const Eigen::Vector3d unexplained = moved - step_s / 2 * (before.velocity + state.velocity);
  verdict.path_length_m += moved.norm();
  verdict.max_position_jump_m = std::max(verdict.max_position_jump_m, unexplained.norm());
  verdict.max_acceleration_step_mps2 =
      std::max(verdict.max_acceleration_step_mps2, (state.acceleration - before.acceleration).norm());
  previous_[i] = state;
  verdict.max_speed_mps = verdict.max_speed_mps.cwiseMax(state.velocity.cwiseAbs());
  verdict.max_acceleration_mps2 = verdict.max_acceleration_mps2.cwiseMax(state.acceleration.cwiseAbs());
  const double speed_mps = state.velocity.norm();
  if (speed_mps >= kAtRest_mps) rest_since_s_[i] = t_s_;
  if (!verdict.flight_time_s && !world_.robots[i].is_told) judge_mission(i, state);
}

void Judge::judge_mission(std::size_t i, const MotionState& state) {
  RobotVerdict& verdict = verdicts_[i];
  const auto next = static_cast<std::size_t>(verdict.goals_reached);
  const Mission& mission = world_.robots[i].mission;
  const Waypoint& goal = mission[next];
  const bool is_last = next + 1 == mission.size();
  const bool is_there = (state.position - goal.position).norm() <= goal.tolerance_m;
  (is_there ? rest_since_s_ : away_s_)[i] = t_s_;  // waiting there is no deadlock
  const bool has_waited = is_there && t_s_ - away_s_[i] >= to_seconds(goal.wait);
  if (!has_waited || (is_last && state.velocity.norm() >= kArrived_mps)) return;
  ++verdict.goals_reached;
  away_s_[i] = t_s_;
  if (is_last) verdict.flight_time_s = t_s_;
}

void Judge::note(std::size_t i, Counterpart counterpart, int other, double distance_m, Clearance* clearance) {
  if (distance_m < clearance->distance_m) *clearance = {distance_m, t_s_, other};
  if (distance_m >= -kTouchTolerance_m) return;
  const int id = verdicts_[i].id;
  const bool known = std::ranges::any_of(
      touches_, [&](const Touch& t) { return t.robot == id && t.counterpart == counterpart && t.other == other; });
  const bool at_rest = previous_[i].velocity.norm() < kAtRest_mps;
  if (!known) touches_.push_back({t_s_, id, counterpart, other, distance_m, at_rest});
}

void Judge::judge_obstacles(std::span<const MotionState> robots) {
  for (std::size_t k = 0; k < world_.obstacles.size(); ++k) {
    const auto obstacle = state_at(world_.obstacles[k], world_, t_s_);
    if (!obstacle) continue;
    for (std::size_t i = 0; i < robots.size(); ++i) {
      const double gap_m =
          distance(world_.obstacles[k].shape, robots[i].position - obstacle->position) - world_.robots[i].radius_m;
      note(i, Counterpart::kObstacle, static_cast<int>(k), gap_m, &verdicts_[i].to_obstacles);
    }
  }
}

// Looks no further than what would change the verdict.
void Judge::judge_static_map(std::size_t i, const Eigen::Vector3d& position) {
  const double radius_m = world_.robots[i].radius_m;
  const double reach_m = std::max(0.0, std::min(kStaticReach_m, verdicts_[i].to_static_map.distance_m)) + radius_m;
  const double distance_m = static_map_->distance(position, reach_m);
  if (distance_m < reach_m) note(i, Counterpart::kStaticMap, -1, distance_m - radius_m, &verdicts_[i].to_static_map);
}

void Judge::judge_robots(std::span<const MotionState> robots) {
  for (std::size_t i = 0; i < robots.size(); ++i) {
    for (std::size_t j = i + 1; j < robots.size(); ++j) {
      const double radii_m = world_.robots[i].radius_m + world_.robots[j].radius_m;
      const double gap_m = (robots[i].position - robots[j].position).norm() - radii_m;
      note(i, Counterpart::kRobot, verdicts_[j].id, gap_m, &verdicts_[i].to_robots);
      Clearance& other = verdicts_[j].to_robots;
      if (gap_m < other.distance_m) other = {gap_m, t_s_, verdicts_[i].id};
    }
  }
}

// Whoever is told where to go by others has no place to arrive at.
bool Judge::has_arrived(std::size_t i) const {
  return verdicts_[i].flight_time_s || world_.robots[i].is_told;
}

bool Judge::all_arrived() const {
  for (std::size_t i = 0; i < verdicts_.size(); ++i)
    if (!has_arrived(i)) return false;
  return true;
}

bool Judge::finished() const {
  if (t_s_ >= time_limit_s_ - kTimeTolerance_s) return true;
  if (!all_arrived() || world_.is_endless()) return false;
  double last_s = 0.0;
  for (const RobotVerdict& verdict : verdicts_) last_s = std::max(last_s, *verdict.flight_time_s);
  return t_s_ >= last_s + kAfterArrival_s - kTimeTolerance_s;
}

Outcome Judge::outcome() const {
  if (!touches_.empty()) return Outcome::kCollision;
  if (all_arrived()) return Outcome::kSuccess;
  for (std::size_t i = 0; i < verdicts_.size(); ++i) {
    if (!has_arrived(i) && t_s_ - rest_since_s_[i] >= kDeadlock_s - kTimeTolerance_s) return Outcome::kDeadlock;
  }
  return Outcome::kTimeout;
}

}  // namespace swarm
