#include "swarm_sim/environment/simulation.h"

#include <algorithm>

#include "lcmtypes/bus/codec.h"
#include "swarm_sim/world/clocks.h"

namespace swarm {
namespace {

sogm_swarm::obstacle_t to_message(int id, const Shape& shape, const ObstacleState& state, bool moves) {
  sogm_swarm::obstacle_t message{};
  message.id = id;
  message.shape = static_cast<std::int16_t>(shape.kind);
  Eigen::Map<Eigen::Vector3d>(message.position) = state.position;
  if (moves) Eigen::Map<Eigen::Vector3d>(message.velocity) = state.velocity;
  message.yaw = shape.yaw_rad;
  Eigen::Map<Eigen::Vector3d>(message.size) = shape.size;
  return message;
}

static_assert(static_cast<int>(Shape::Kind::kColumn) == sogm_swarm::obstacle_t::kColumn &&
              static_cast<int>(Shape::Kind::kRing) == sogm_swarm::obstacle_t::kRing &&
              static_cast<int>(Shape::Kind::kBox) == sogm_swarm::obstacle_t::kBox &&
              static_cast<int>(Shape::Kind::kSphere) == sogm_swarm::obstacle_t::kSphere);

}  // namespace

Simulation::Simulation(const World& world, const OccupiedCubes* static_map, double time_limit_s, double clock_offset_ms,
                       TickObserver on_tick)
    : world_(world), judge_(world, static_map, time_limit_s), on_tick_(std::move(on_tick)) {
  const std::vector<std::int64_t> offsets = clock_offsets_us(clock_offset_ms, world);
  for (std::size_t i = 0; i < world.robots.size(); ++i) {
    const WorldRobot& robot = world.robots[i];
    vehicles_.emplace_back(robot.id, robot.start, offsets[i]);
    const HeaderSource headers(robot.id, 0);
    headers_.push_back({headers, headers, headers});
  }
}

void Simulation::settle(std::int64_t utime) {
  for (Vehicle& vehicle : vehicles_) vehicle.move_to(utime);
}

void Simulation::tick(double t_s, std::int64_t utime) {
  settle(utime);
  states_.clear();
  for (const Vehicle& vehicle : vehicles_) states_.push_back(vehicle.state());
  judge_.update(t_s, states_);
  if (on_tick_) on_tick_(t_s, *this);
}

sogm_swarm::robot_state_t Simulation::state_message(std::size_t index, std::int64_t utime) {
  const Vehicle& vehicle = vehicles_[index];
  sogm_swarm::robot_state_t message{};
  message.header = headers_[index].state.next(vehicle.own_time(utime));
  Eigen::Map<Eigen::Vector3d>(message.position) = vehicle.state().position;
  Eigen::Map<Eigen::Vector3d>(message.velocity) = vehicle.state().velocity;
  message.yaw = vehicle.yaw_rad();
  return message;
}

sogm_swarm::obstacles_t Simulation::obstacles_message(std::size_t index, double t_s, std::int64_t utime) {
  const Vehicle& vehicle = vehicles_[index];
  sogm_swarm::obstacles_t message{};
  message.header = headers_[index].obstacles.next(vehicle.own_time(utime));
  for (std::size_t i = 0; i < world_.obstacles.size(); ++i) {
    const WorldObstacle& obstacle = world_.obstacles[i];
    const std::optional<ObstacleState> state = state_at(obstacle, world_, std::max(t_s, 0.0));
    if (!state || distance(obstacle.shape, vehicle.state().position - state->position) > world_.sensing_radius_m)
      continue;
    message.obstacles.push_back(to_message(static_cast<int>(i), obstacle.shape, *state, t_s >= 0.0));
  }
  message.num_obstacles = static_cast<std::int32_t>(message.obstacles.size());
  return message;
}

sogm_swarm::goal_t Simulation::goal_message(std::size_t index, std::int64_t utime) {
  sogm_swarm::goal_t message{};
  const Vehicle& vehicle = vehicles_[index];
  message.header = headers_[index].goal.next(vehicle.own_time(utime));
  Eigen::Map<Eigen::Vector3d>(message.position) = world_.robots[index].goal;
  return message;
}

}  // namespace swarm
