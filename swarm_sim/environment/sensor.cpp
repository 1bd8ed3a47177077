#include "swarm_sim/environment/sensor.h"

#include <algorithm>
#include <numbers>
#include <optional>

#include "lcmtypes/bus/portable_math.h"

namespace swarm {
namespace {

using sogm_swarm::obstacle_t;
using sogm_swarm::obstacles_t;

constexpr double kBurst_s = 0.5;                                // so long an obstacle is not seen
constexpr double kFalseDiameter_m = 0.5, kFalseHeight_m = 1.8;  // of what is not there
constexpr std::int32_t kFirstFalseId = 1 << 20;

obstacle_t to_message(int id, const Shape& shape, const ObstacleState& state, bool moves) {
  obstacle_t message{};
  message.id = id;
  message.shape = static_cast<std::int16_t>(shape.kind);
  Eigen::Map<Eigen::Vector3d>(message.position) = state.position;
  if (moves) Eigen::Map<Eigen::Vector3d>(message.velocity) = state.velocity;
  message.yaw = shape.yaw_rad;
  Eigen::Map<Eigen::Vector3d>(message.size) = shape.size;
  return message;
}

static_assert(static_cast<int>(Shape::Kind::kColumn) == obstacle_t::kColumn &&
              static_cast<int>(Shape::Kind::kRing) == obstacle_t::kRing &&
              static_cast<int>(Shape::Kind::kBox) == obstacle_t::kBox &&
              static_cast<int>(Shape::Kind::kSphere) == obstacle_t::kSphere);

// Two columns as one that holds both, if they are columns and no further apart than `near_m`.
bool merge(const obstacle_t& other, double near_m, obstacle_t* one) {
  if (one->shape != obstacle_t::kColumn || other.shape != obstacle_t::kColumn) return false;
  Eigen::Map<Eigen::Vector3d> p(one->position), v(one->velocity), size(one->size);
  const Eigen::Map<const Eigen::Vector3d> q(other.position), w(other.velocity), other_size(other.size);
  const double apart = (q - p).head<2>().norm(), r = size.x() / 2, s = other_size.x() / 2;
  if (apart > r + s + near_m) return false;
  v = 0.5 * (v + w);
  if (apart + s <= r) return true;  // inside
  const double radius = std::max((apart + r + s) / 2, s);
  if (apart > 0.0) p.head<2>() += std::min((radius - r) / apart, 1.0) * (q - p).head<2>();
  size.x() = 2 * radius;
  size.y() = std::max(size.y(), other_size.y());
  return true;
}

void merge_near(double near_m, std::vector<obstacle_t>* obstacles) {
  for (std::size_t i = 0; i < obstacles->size(); ++i) {
    const auto one = obstacles->begin() + static_cast<std::ptrdiff_t>(i);
    obstacles->erase(
        std::remove_if(one + 1, obstacles->end(), [&](const obstacle_t& other) { return merge(other, near_m, &*one); }),
        obstacles->end());
  }
}

}  // namespace

Sensor::Sensor(const World& world, int robot_id)
    : world_(world),
      random_(seed_of(world.name + " sensor " + std::to_string(robot_id))),
      sights_(world.obstacles.size()),
      next_false_id_(kFirstFalseId) {}

obstacles_t Sensor::look(double t_s, const Eigen::Vector3d& position, const Eigen::Vector3d& own_error) {
  const SensorOptions& sensor = world_.sensor;
  const double latency_s = 1e-3 * sensor.latency_ms, seen_s = t_s - latency_s;
  obstacles_t message{};
  message.complete = sensor.complete();
  for (std::size_t i = 0; i < world_.obstacles.size(); ++i) {
    const WorldObstacle& obstacle = world_.obstacles[i];
    // What moves when the flight begins has moved before, but the world stands while the flight is waited for.
    std::optional<ObstacleState> state = state_at(obstacle, world_, t_s < 0.0 ? 0.0 : seen_s);
    if (!state && seen_s < 0.0) state = state_at(obstacle, world_, 0.0);
    if (!state || distance(obstacle.shape, position - state->position) > world_.sensing_radius_m) continue;
    if (!message.complete && is_missed(i, t_s)) continue;
    message.obstacles.push_back(to_message(static_cast<int>(i), obstacle.shape, *state, t_s >= 0.0));
  }
  if (sensor.merge_m > 0.0) merge_near(sensor.merge_m, &message.obstacles);
  if (sensor.false_alarms > 0.0) add_false_alarms(position, &message);
  for (obstacle_t& obstacle : message.obstacles) {
    obstacle.age_s = latency_s;
    obstacle.position_sigma = static_cast<float>(sensor.position_m);
    obstacle.velocity_sigma = static_cast<float>(sensor.velocity_mps);
    Eigen::Map<Eigen::Vector3d> p(obstacle.position), v(obstacle.velocity);
    if (!own_error.isZero(0.0)) p += own_error;
    if (sensor.position_m > 0.0) p += sensor.position_m * random_.normal3();
    if (sensor.velocity_mps > 0.0) v += sensor.velocity_mps * random_.normal3();
  }
  message.num_obstacles = static_cast<std::int32_t>(message.obstacles.size());
  return message;
}

bool Sensor::is_missed(std::size_t index, double t_s) {
  const SensorOptions& sensor = world_.sensor;
  Sight& sight = sights_[index];
  // As often as makes the bursts' share of the time.
  const double begins = sensor.burst / (1.0 - sensor.burst) / (kBurst_s * sensor.rate_hz);
  if (t_s >= sight.hidden_until_s && random_.uniform() < begins) sight.hidden_until_s = t_s + kBurst_s;
  return t_s < sight.hidden_until_s || random_.uniform() < sensor.dropout;
}

// Columns that stand anywhere within reach, each with an id of its own.
void Sensor::add_false_alarms(const Eigen::Vector3d& position, obstacles_t* message) {
  double expected = world_.sensor.false_alarms;
  for (; random_.uniform() < expected; expected -= 1.0) {
    const auto [sin, cos] = sin_cos(2.0 * std::numbers::pi * random_.uniform());
    const double away = world_.sensing_radius_m * std::sqrt(random_.uniform());
    const Shape shape{.kind = Shape::Kind::kColumn, .size = {kFalseDiameter_m, kFalseHeight_m, 0.0}};
    const Eigen::Vector3d at(position.x() + away * cos, position.y() + away * sin, kFalseHeight_m / 2);
    message->obstacles.push_back(to_message(next_false_id_++, shape, {at}, true));
  }
}

}  // namespace swarm
