#include "swarm_sim/environment/simulation.h"

#include <algorithm>

#include "lcmtypes/bus/codec.h"

namespace swarm {
namespace {

constexpr double kSideRoom_m = 1.0;
constexpr std::int64_t kSetpointTimeout_us = 50'000;

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

MapConfig map_config(const World& world, const WorldRobot& robot, const FlightOptions& options) {
  MapConfig config = options.map;
  config.robot_id = robot.id;
  config.static_map = world.static_map;
  return config;
}

PlannerNodeConfig planner_config(const World& world, const WorldRobot& robot, const FlightOptions& options) {
  PlannerNodeConfig config = options.planner;
  config.robot_id = robot.id;
  config.planner.space.radius_m = robot.radius_m;
  SearchLimits& limits = config.planner.limits;
  limits.v_max_mps = world.speed_mps;
  limits.a_max_mps2 = world.acceleration_mps2;
  // The ground and the ceiling are solid. The sides are not: starts and goals may lie on them, and a robot needs room
  // to step back.
  limits.space_min = world.space.min + Eigen::Vector3d(-kSideRoom_m, -kSideRoom_m, robot.radius_m);
  limits.space_max = world.space.max + Eigen::Vector3d(kSideRoom_m, kSideRoom_m, -robot.radius_m);
  return config;
}

BroadcastConfig broadcast_config(const World& world, const WorldRobot& robot, const FlightOptions& options) {
  BroadcastConfig config = options.broadcast;
  config.robot_id = robot.id;
  config.radius_m = robot.radius_m;
  config.v_max_mps = world.speed_mps;
  config.a_max_mps2 = world.acceleration_mps2;
  config.roster.clear();
  for (const WorldRobot& other : world.robots) config.roster.push_back(other.id);
  return config;
}

std::size_t index_of_robot(const World& world, int id, const char* option) {
  const auto robot = std::ranges::find(world.robots, id, &WorldRobot::id);
  if (robot == world.robots.end())
    throw OptionError(std::string(option) + ": the world has no robot " + std::to_string(id));
  return static_cast<std::size_t>(robot - world.robots.begin());
}

std::vector<std::int64_t> clock_offsets_us(double offset_ms, std::size_t n) {
  std::vector<std::int64_t> offsets(n, 0);
  for (std::size_t i = 0; n > 1 && i < n; ++i)
    offsets[i] = std::llround(1e3 * offset_ms * (static_cast<double>(i) / static_cast<double>(n - 1) - 0.5));
  return offsets;
}

Simulation::Simulation(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                       TraceWriter* trace)
    : world_(world), judge_(world, static_map, options.time_limit_s), trace_(trace) {
  for (const WorldRobot& robot : world.robots) {
    const HeaderSource headers(robot.id, 0);
    Vehicle& vehicle = vehicles_.emplace_back(headers);
    vehicle.state.position = robot.start;
  }
  const std::vector<std::int64_t> offsets = clock_offsets_us(options.clock_offset_ms, vehicles_.size());
  for (std::size_t i = 0; i < vehicles_.size(); ++i) {
    const int id = world.robots[i].id;
    const auto place = std::ranges::count_if(world.robots, [id](const WorldRobot& other) { return other.id < id; });
    vehicles_[i].clock_offset_us = offsets[static_cast<std::size_t>(place)];
  }
  states_.resize(vehicles_.size());
  for (const Kill& kill : options.kills) (void)index_of_robot(world, kill.robot_id, "kill");
  for (const LinkOutage& outage : options.link.outages) (void)index_of_robot(world, outage.robot_id, "link-outage");
}

void Simulation::on_setpoint(std::size_t index, std::span<const std::uint8_t> bytes) {
  Vehicle& vehicle = vehicles_[index];
  sogm_swarm::setpoint_t setpoint;
  if (decode(bytes, &setpoint) != Refusal::kNone) return;
  if (setpoint.header.robot_id != world_.robots[index].id) return;
  if (vehicle.flying && setpoint.header.utime <= vehicle.setpoint.header.utime) return;
  vehicle.setpoint = setpoint;
  vehicle.flying = true;
}

void Simulation::on_own_trajectory(std::size_t index, std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  if (decode(bytes, &message) != Refusal::kNone || message.header.robot_id != world_.robots[index].id) return;
  Trajectory announced;  // not committed
  read_announcement(message, &vehicles_[index].motion.emplace(), &announced);
}

void Simulation::settle(std::int64_t utime) {
  for (Vehicle& vehicle : vehicles_) {
    if (!vehicle.flying) continue;
    const std::int64_t clock_utime = utime + vehicle.clock_offset_us;
    if (clock_utime - vehicle.setpoint.header.utime > kSetpointTimeout_us && vehicle.motion) {
      vehicle.state = vehicle.motion->at(clock_utime);
      continue;
    }
    const double dt = 1e-6 * static_cast<double>(clock_utime - vehicle.setpoint.header.utime);
    const Eigen::Vector3d p(vehicle.setpoint.position), v(vehicle.setpoint.velocity);
    const Eigen::Vector3d a(vehicle.setpoint.acceleration), j(vehicle.setpoint.jerk);
    vehicle.state.position = p + dt * (v + dt / 2 * (a + dt / 3 * j));
    vehicle.state.velocity = v + dt * (a + dt / 2 * j);
    vehicle.state.acceleration = a + dt * j;
    vehicle.state.jerk = j;
    vehicle.yaw_rad = vehicle.setpoint.yaw;
  }
}

void Simulation::tick(double t_s, std::int64_t utime) {
  settle(utime);
  for (std::size_t i = 0; i < vehicles_.size(); ++i) {
    states_[i] = vehicles_[i].state;
    if (trace_ != nullptr) trace_->write(t_s, world_.robots[i].id, states_[i]);
  }
  judge_.update(t_s, states_);
}

sogm_swarm::robot_state_t Simulation::state_message(std::size_t index, std::int64_t utime) {
  Vehicle& vehicle = vehicles_[index];
  sogm_swarm::robot_state_t message{};
  message.header = vehicle.state_headers.next(utime + vehicle.clock_offset_us);
  Eigen::Map<Eigen::Vector3d>(message.position) = vehicle.state.position;
  Eigen::Map<Eigen::Vector3d>(message.velocity) = vehicle.state.velocity;
  message.yaw = vehicle.yaw_rad;
  return message;
}

sogm_swarm::obstacles_t Simulation::obstacles_message(std::size_t index, double t_s, std::int64_t utime) {
  Vehicle& vehicle = vehicles_[index];
  sogm_swarm::obstacles_t message{};
  message.header = vehicle.obstacle_headers.next(utime + vehicle.clock_offset_us);
  for (std::size_t i = 0; i < world_.obstacles.size(); ++i) {
    const WorldObstacle& obstacle = world_.obstacles[i];
    const std::optional<ObstacleState> state = state_at(obstacle, world_, std::max(t_s, 0.0));
    if (!state || distance(obstacle.shape, vehicle.state.position - state->position) > world_.sensing_radius_m)
      continue;
    message.obstacles.push_back(to_message(static_cast<int>(i), obstacle.shape, *state, t_s >= 0.0));
  }
  message.num_obstacles = static_cast<std::int32_t>(message.obstacles.size());
  return message;
}

sogm_swarm::goal_t Simulation::goal_message(std::size_t index, std::int64_t utime) {
  sogm_swarm::goal_t message{};
  Vehicle& vehicle = vehicles_[index];
  message.header = vehicle.goal_headers.next(utime + vehicle.clock_offset_us);
  Eigen::Map<Eigen::Vector3d>(message.position) = world_.robots[index].goal;
  return message;
}

}  // namespace swarm
