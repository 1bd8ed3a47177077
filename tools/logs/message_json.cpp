#include "tools/logs/message_json.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <type_traits>

#include "sogm_swarm/fields.hpp"

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

template <class Visit>
void fields(const Knot& m, Visit&& visit) {
  constexpr const char* kNames[] = {"x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"};
  for (std::size_t i = 0; i < std::size(kNames); ++i) visit(kNames[i], m.values[i]);
}
template <class Visit>
void fields(const Voxel& m, Visit&& visit) {
  visit("x", m.x), visit("y", m.y), visit("z", m.z);
}

// Calls visit(name, value) with a field of m, as it is shown.
template <class T, class Value, class Visit>
void show(const T& m, const char* name, const Value& value, Visit&& visit) {
  if constexpr (std::is_same_v<Value, decltype(trajectory_t::knots)>) {
    visit(name, knots_of(m));
  } else if constexpr (std::is_same_v<Value, decltype(obstacle_voxels_t::voxels)>) {
    visit(name, voxels_of(m));
  } else if constexpr (!std::is_same_v<Value, decltype(sogm_t::packed)>) {
    visit(name, value);
  }
}
template <class T, class Visit>
void shown_fields(const T& m, Visit&& visit) {
  fields(m, [&](const char* name, const auto& value) { show(m, name, value, visit); });
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
  shown_fields(message, [&object](const char* name, const auto& value) { object.emplace(name, value_of(value)); });
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
  shown_fields(T{}, [&](const char* name, const auto& value) {
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

#define SWARM_INSTANTIATE(type, ...)        \
  template Json to_json<type>(const type&); \
  template Json json_schema<type>();        \
  template std::string schema_name<type>();
SWARM_MESSAGES(SWARM_INSTANTIATE)
#undef SWARM_INSTANTIATE

}  // namespace swarm
