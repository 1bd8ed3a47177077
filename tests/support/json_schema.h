// Holds JSON against a JSON Schema, as far as ours go: types, properties, required ones, items.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace swarm::test {

// What does not fit, with its place; empty when everything does. Properties that the schema does not know do not fit.
inline std::string misfit(const nlohmann::ordered_json& schema, const nlohmann::ordered_json& value,
                          const std::string& place = "") {
  const std::string type = schema.at("type");
  const bool fits = type == "object"    ? value.is_object()
                    : type == "array"   ? value.is_array()
                    : type == "string"  ? value.is_string()
                    : type == "boolean" ? value.is_boolean()
                    : type == "integer" ? value.is_number_integer()
                    : type == "number"  ? value.is_number()
                                        : false;
  if (!fits) return place + " is no " + type;
  if (type == "array") {
    for (std::size_t i = 0; i < value.size(); ++i) {
      const std::string found = misfit(schema.at("items"), value[i], place + "[" + std::to_string(i) + "]");
      if (!found.empty()) return found;
    }
  }
  if (type != "object") return "";
  for (const auto& name : schema.at("required")) {
    if (!value.contains(name.get<std::string>())) return place + "." + name.get<std::string>() + " is missing";
  }
  for (const auto& [name, element] : value.items()) {
    if (!schema.at("properties").contains(name)) return place + "." + name + " is not known";
    const std::string found = misfit(schema.at("properties").at(name), element, place + "." + name);
    if (!found.empty()) return found;
  }
  return "";
}

// What of a schema Foxglove and Lichtblick do not read: other types, arrays right inside arrays; empty when they read
// all.
inline std::string unreadable(const nlohmann::ordered_json& schema, const std::string& place = "") {
  const std::string type = schema.at("type");
  if (type == "array") {
    const auto& items = schema.at("items");
    return items.at("type") == "array" ? place + " holds arrays" : unreadable(items, place + "[]");
  }
  if (type != "object") {
    const bool known = type == "string" || type == "boolean" || type == "integer" || type == "number";
    return known ? "" : place + " is of type " + type;
  }
  for (const auto& [name, property] : schema.at("properties").items()) {
    const std::string found = unreadable(property, place + "." + name);
    if (!found.empty()) return found;
  }
  return "";
}

}  // namespace swarm::test
