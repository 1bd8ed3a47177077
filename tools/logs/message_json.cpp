#include "tools/logs/message_json.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <type_traits>

namespace swarm {
namespace {

using namespace sogm_swarm;
using Json = nlohmann::ordered_json;

struct Knot {
  float values[9];
};
std::vector<Knot> knots_of(const trajectory_t& m) {
  std::vector<Knot> knots(m.num_pieces <= 0 ? 0 : std::min<std::size_t>(m.num_pieces + 1, std::size(m.knots)));
  for (std::size_t k = 0; k < knots.size(); ++k) std::copy_n(m.knots[k], std::size(knots[k].values), knots[k].values);
  return knots;
}

struct Voxel {
  std::int16_t x, y, z;
};
std::vector<Voxel> voxels_of(const obstacle_voxels_t& m) {
  std::vector<Voxel> voxels;
  voxels.reserve(m.voxels.size());
  for (const auto& index : m.voxels) voxels.push_back({index[0], index[1], index[2]});
  return voxels;
}

// Calls visit(name, value) with every field.
template <class Visit>
void fields(const header_t& m, Visit&& visit) {
  visit("crc32", m.crc32), visit("schema_version", m.schema_version), visit("robot_id", m.robot_id);
  visit("boot", m.boot), visit("seq", m.seq), visit("utime", m.utime);
}
template <class Visit>
void fields(const Knot& m, Visit&& visit) {
  constexpr const char* kNames[] = {"x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"};
  for (std::size_t i = 0; i < std::size(kNames); ++i) visit(kNames[i], m.values[i]);
}
template <class Visit>
void fields(const trajectory_t& m, Visit&& visit) {
  visit("seq", m.seq), visit("start_utime", m.start_utime), visit("piece_us", m.piece_us);
  visit("num_pieces", m.num_pieces), visit("knots", knots_of(m));
}
template <class Visit>
void fields(const ack_t& m, Visit&& visit) {
  visit("peer_boot", m.peer_boot), visit("judged_seq", m.judged_seq), visit("verdict", m.verdict);
}
template <class Visit>
void fields(const announcement_t& m, Visit&& visit) {
  visit("header", m.header), visit("radius", m.radius), visit("committed", m.committed), visit("pending", m.pending);
  visit("pending_state", m.pending_state), visit("pending_stamp", m.pending_stamp), visit("roster_crc", m.roster_crc);
  visit("forced_seq", m.forced_seq), visit("least_delay_us", m.least_delay_us), visit("num_acks", m.num_acks);
  visit("acks", m.acks);
}
template <class Visit>
void fields(const broadcast_status_t& m, Visit&& visit) {
  visit("header", m.header), visit("state", m.state), visit("candidates", m.candidates), visit("commits", m.commits);
  visit("forced", m.forced), visit("withdrawn", m.withdrawn), visit("rejected", m.rejected);
  visit("peers_heard", m.peers_heard), visit("lost", m.lost), visit("max_age_ms", m.max_age_ms);
  visit("max_clock_offset_ms", m.max_clock_offset_ms), visit("refused", m.refused);
}
template <class Visit>
void fields(const candidate_t& m, Visit&& visit) {
  visit("header", m.header), visit("trajectory", m.trajectory), visit("urgent", m.urgent);
}
template <class Visit>
void fields(const face_t& m, Visit&& visit) {
  visit("piece", m.piece), visit("normal", m.normal), visit("offset", m.offset);
}
template <class Visit>
void fields(const corridors_t& m, Visit&& visit) {
  visit("header", m.header), visit("trajectory_seq", m.trajectory_seq), visit("num_faces", m.num_faces);
  visit("faces", m.faces);
}
template <class Visit>
void fields(const goal_t& m, Visit&& visit) {
  visit("header", m.header), visit("position", m.position);
}
template <class Visit>
void fields(const map_status_t& m, Visit&& visit) {
  visit("header", m.header), visit("state", m.state), visit("maps", m.maps), visit("rate_hz", m.rate_hz);
  visit("build_ms", m.build_ms), visit("map_bytes", m.map_bytes), visit("obstacles", m.obstacles);
  visit("refused", m.refused);
}
template <class Visit>
void fields(const obstacle_t& m, Visit&& visit) {
  visit("id", m.id), visit("shape", m.shape), visit("position", m.position), visit("velocity", m.velocity);
  visit("yaw", m.yaw), visit("size", m.size), visit("age_s", m.age_s);
}
template <class Visit>
void fields(const obstacles_t& m, Visit&& visit) {
  visit("header", m.header), visit("num_obstacles", m.num_obstacles), visit("obstacles", m.obstacles);
}
template <class Visit>
void fields(const Voxel& m, Visit&& visit) {
  visit("x", m.x), visit("y", m.y), visit("z", m.z);
}
template <class Visit>
void fields(const obstacle_voxels_t& m, Visit&& visit) {
  visit("header", m.header), visit("id", m.id), visit("position", m.position), visit("velocity", m.velocity);
  visit("age_s", m.age_s), visit("resolution", m.resolution), visit("num_voxels", m.num_voxels);
  visit("voxels", voxels_of(m));
}
template <class Visit>
void fields(const planner_status_t& m, Visit&& visit) {
  visit("header", m.header), visit("state", m.state), visit("outcome", m.outcome), visit("plans", m.plans);
  visit("missed", m.missed), visit("rate_hz", m.rate_hz), visit("compose_ms", m.compose_ms);
  visit("search_ms", m.search_ms), visit("corridor_ms", m.corridor_ms), visit("optimize_ms", m.optimize_ms);
  visit("check_ms", m.check_ms), visit("total_ms", m.total_ms), visit("expansions", m.expansions);
  visit("refused", m.refused);
}
template <class Visit>
void fields(const robot_state_t& m, Visit&& visit) {
  visit("header", m.header), visit("position", m.position), visit("velocity", m.velocity), visit("yaw", m.yaw);
}
template <class Visit>
void fields(const setpoint_t& m, Visit&& visit) {
  visit("header", m.header), visit("position", m.position), visit("velocity", m.velocity);
  visit("acceleration", m.acceleration), visit("jerk", m.jerk), visit("yaw", m.yaw), visit("yaw_rate", m.yaw_rate);
}
template <class Visit>
void fields(const sogm_t& m, Visit&& visit) {
  visit("header", m.header), visit("frame_duration_us", m.frame_duration_us), visit("num_frames", m.num_frames);
  visit("size", m.size), visit("origin", m.origin), visit("resolution", m.resolution), visit("part", m.part);
  visit("num_parts", m.num_parts), visit("total_bytes", m.total_bytes), visit("num_bytes", m.num_bytes);
}

template <class Number>
Json number(Number value) {
  if constexpr (std::is_integral_v<Number>) return static_cast<std::int64_t>(value);
  if (!std::isfinite(value)) return nullptr;
  if constexpr (std::is_same_v<Number, float>) {
    char text[32];
    const char* const end = std::to_chars(text, text + sizeof text, value).ptr;
    double shortest = 0.0;
    std::from_chars(text, end, shortest);
    return shortest;
  }
  return static_cast<double>(value);
}

template <class T>
Json value_of(const T& value);

template <class T>
Json object_of(const T& message) {
  Json object = Json::object();
  fields(message, [&object](const char* name, const auto& value) { object.emplace(name, value_of(value)); });
  return object;
}

template <class T>
constexpr bool kIsVector = false;
template <class T>
constexpr bool kIsVector<std::vector<T>> = true;

template <class T>
Json value_of(const T& value) {
  if constexpr (std::is_array_v<T> || kIsVector<T>) {
    Json array = Json::array();
    for (const auto& element : value) array.push_back(value_of(element));
    return array;
  } else if constexpr (std::is_arithmetic_v<T>) {
    return number(value);
  } else {
    return object_of(value);
  }
}

template <class T>
Json schema_of();

template <class T>
Json array_schema() {
  return {{"type", "array"}, {"items", schema_of<T>()}};
}

template <class T>
Json object_schema() {
  Json properties = Json::object();
  Json required = Json::array();
  fields(T{}, [&](const char* name, const auto& value) {
    properties.emplace(name, schema_of<std::remove_cvref_t<decltype(value)>>());
    required.push_back(name);
  });
  return {{"type", "object"}, {"properties", std::move(properties)}, {"required", std::move(required)}};
}

template <class T>
Json schema_of() {
  if constexpr (std::is_array_v<T>) {
    return array_schema<std::remove_extent_t<T>>();
  } else if constexpr (kIsVector<T>) {
    return array_schema<typename T::value_type>();
  } else if constexpr (std::is_arithmetic_v<T>) {
    return {{"type", std::is_integral_v<T> ? "integer" : "number"}};
  } else {
    return object_schema<T>();
  }
}

}  // namespace

template <class T>
Json to_json(const T& message) {
  return object_of(message);
}

template <class T>
std::string schema_name() {
  return std::string("sogm_swarm.") + T::getTypeName();
}

template <class T>
Json json_schema() {
  Json schema = {{"$schema", "https://json-schema.org/draft/2020-12/schema"}, {"title", schema_name<T>()}};
  schema.update(object_schema<T>());
  return schema;
}

#define SWARM_INSTANTIATE(T)          \
  template Json to_json<T>(const T&); \
  template Json json_schema<T>();     \
  template std::string schema_name<T>();
SWARM_INSTANTIATE(announcement_t)
SWARM_INSTANTIATE(broadcast_status_t)
SWARM_INSTANTIATE(candidate_t)
SWARM_INSTANTIATE(corridors_t)
SWARM_INSTANTIATE(goal_t)
SWARM_INSTANTIATE(map_status_t)
SWARM_INSTANTIATE(obstacle_voxels_t)
SWARM_INSTANTIATE(obstacles_t)
SWARM_INSTANTIATE(planner_status_t)
SWARM_INSTANTIATE(robot_state_t)
SWARM_INSTANTIATE(setpoint_t)
SWARM_INSTANTIATE(sogm_t)
#undef SWARM_INSTANTIATE

}  // namespace swarm
