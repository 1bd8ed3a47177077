#include "swarm_sim/environment/environment_node.h"

#include "lcmtypes/bus/channels.h"

namespace swarm {
namespace {

constexpr Duration kGoalPeriod = 1s;

}  // namespace

EnvironmentNode::EnvironmentNode(Simulation& simulation, std::size_t index, std::int32_t boot, bool tells_state)
    : simulation_(simulation),
      index_(index),
      tells_state_(tells_state),
      sensor_(simulation.world(), simulation.world().robots[index].id),
      sensor_period_(to_duration(1.0 / simulation.world().sensor.rate_hz)),
      last_tick_(simulation.now()),
      state_headers_(simulation.world().robots[index].id, boot),
      obstacle_headers_(state_headers_),
      goal_headers_(state_headers_) {}

std::vector<Subscription> EnvironmentNode::subscriptions() const {
  return {{BusId::kOnboard, channel::kSetpoint}, {BusId::kOnboard, channel::kOwnTrajectory}};
}

void EnvironmentNode::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes,
                                 Outbox&) {
  Vehicle& vehicle = simulation_.vehicle(index_);
  if (channel == channel::kSetpoint) vehicle.on_setpoint(now, bytes);
  if (channel == channel::kOwnTrajectory) vehicle.on_own_trajectory(bytes);
}

Utime EnvironmentNode::step(Utime now, Outbox& outbox) {
  const Utime until = now - kLatency;
  simulation_.advance(until);
  const Utime wake = Simulation::tick_at(until) + Simulation::kTick + kLatency;
  const Utime tick = simulation_.now();
  if (tick == last_tick_) return wake;
  last_tick_ = tick;
  const Utime own_time = vehicle().own_time(tick);
  const double t_s = simulation_.t_s(tick);
  // Sensors of different robots are not synchronised.
  const Utime phase = tick + static_cast<std::int64_t>(index_) * Simulation::kTick;
  if (phase >= detection_.due_on_grid(phase, sensor_period_)) {
    detection_.done(phase);
    outbox.publish(BusId::kOnboard, channel::kObstacles, obstacles(own_time, t_s));
  }
  if (tells_state_) outbox.publish(BusId::kOnboard, channel::kRobotState, state(own_time));
  if (t_s >= 0.0 && tick >= goal_.due(tick, kGoalPeriod)) {
    goal_.done(tick);
    outbox.publish(BusId::kOnboard, channel::kGoal, goal(own_time));
  }
  return wake;
}

sogm_swarm::robot_state_t EnvironmentNode::state(Utime own_time) {
  sogm_swarm::robot_state_t message{};
  message.header = state_headers_.next(own_time);
  Eigen::Map<Eigen::Vector3d>(message.position) = vehicle().estimate().position;
  Eigen::Map<Eigen::Vector3d>(message.velocity) = vehicle().estimate().velocity;
  message.yaw = vehicle().yaw_rad();
  return message;
}

sogm_swarm::obstacles_t EnvironmentNode::obstacles(Utime own_time, double t_s) {
  const Eigen::Vector3d& position = vehicle().state().position;
  sogm_swarm::obstacles_t message = sensor_.look(t_s, position, vehicle().estimate().position - position);
  message.header = obstacle_headers_.next(own_time);
  return message;
}

sogm_swarm::goal_t EnvironmentNode::goal(Utime own_time) {
  sogm_swarm::goal_t message = to_goal(simulation_.world().robots[index_].mission);
  message.header = goal_headers_.next(own_time);
  return message;
}

}  // namespace swarm
