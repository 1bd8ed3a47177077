#include "swarm_sim/environment/environment_node.h"

#include <utility>

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
      range_sensors_(simulation.world(), simulation.world().robots[index].id),
      caster_(simulation.world(), simulation.static_map()),
      sensor_period_(range_sensors_.period()),
      last_tick_(simulation.now()),
      state_headers_(simulation.world().robots[index].id, boot),
      obstacle_headers_(state_headers_),
      goal_headers_(state_headers_),
      scan_headers_(state_headers_) {}

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
    if (simulation_.world().sensor.is_ranging()) {
      look(tick);
    } else {
      outbox.publish(BusId::kOnboard, channel::kObstacles, obstacles(own_time, t_s));
    }
  }
  for (; !scans_.empty() && scans_.front().due <= tick; scans_.pop_front()) {
    for (const sogm_swarm::lidar_scan_t& part : scans_.front().parts)
      outbox.publish(BusId::kOnboard, channel::kLidarScan, part);
    for (const sogm_swarm::depth_image_t& image : scans_.front().images)
      outbox.publish(BusId::kOnboard, channel::kDepthImage, image);
  }
  if (tells_state_ && simulation_.tells_state(index_))
    outbox.publish(BusId::kOnboard, channel::kRobotState, state(own_time));
  const bool has_goal = !simulation_.world().robots[index_].is_told;
  if (has_goal && t_s >= 0.0 && tick >= goal_.due(tick, kGoalPeriod)) {
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

void EnvironmentNode::look(Utime tick) {
  const World& world = simulation_.world();
  std::vector<RayCaster::Ball> others;
  for (std::size_t i = 0; i < world.robots.size(); ++i)
    if (i != index_) others.push_back({simulation_.vehicles()[i].state().position, world.robots[i].radius_m});
  const bool tilts = world.vehicle.kind == "quadrotor";
  const Eigen::Vector3d acceleration = tilts ? vehicle().estimate().acceleration : Eigen::Vector3d::Zero();
  const Pose believed{vehicle().estimate().position, attitude_of(acceleration, vehicle().yaw_rad())};
  const Pose truth{vehicle().state().position, inverse(vehicle().drifted()).orientation * believed.orientation};
  Scan scan{.due = tick + to_duration(1e-3 * world.sensor.latency_ms), .parts = {}, .images = {}};
  const sogm_swarm::header_t header = scan_headers_.next(vehicle().own_time(tick));
  const double t_s = simulation_.t_s(tick);
  if (world.sensor.kind == "lidar") {
    scan.parts = range_sensors_.scan(caster_, others, t_s, truth, believed);
    for (sogm_swarm::lidar_scan_t& part : scan.parts) part.header = header;
  } else {
    scan.images = range_sensors_.images(caster_, others, t_s, truth, believed);
    for (sogm_swarm::depth_image_t& image : scan.images) image.header = header;
  }
  scans_.push_back(std::move(scan));
}

sogm_swarm::goal_t EnvironmentNode::goal(Utime own_time) {
  sogm_swarm::goal_t message = to_goal(simulation_.world().robots[index_].mission);
  message.header = goal_headers_.next(own_time);
  return message;
}

}  // namespace swarm
