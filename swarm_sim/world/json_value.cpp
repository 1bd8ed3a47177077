#include "swarm_sim/world/json_value.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "lcmtypes/bus/text.h"
#include "swarm_sim/world/world.h"

namespace swarm {

using nlohmann::json;

json parse_json(const std::string& text) {
  std::vector<std::set<std::string>> open_objects;
  const auto refuse_repeated_keys = [&](int /*depth*/, json::parse_event_t event, json& parsed) {
    if (event == json::parse_event_t::object_start) open_objects.emplace_back();
    if (event == json::parse_event_t::object_end) open_objects.pop_back();
    if (event == json::parse_event_t::key && !open_objects.back().insert(parsed.get<std::string>()).second)
      throw WorldError(parsed.dump() + ": a key must not be given twice");
    return true;
  };
  try {
    return json::parse(text, refuse_repeated_keys);
  } catch (const json::exception& error) {
    const std::string what = error.what();  // "[json.exception.parse_error.101] parse error at line 1, column 2: ..."
    throw WorldError("must be JSON: " + what.substr(std::min(what.size(), what.find("] ") + 2)));
  }
}

void JsonValue::fail(const std::string& rule) const {
  constexpr std::size_t kShown = 60;
  std::string value = json_.dump(-1, ' ', false, json::error_handler_t::replace);
  if (value.size() > kShown) {
    value.resize(kShown);
    while (!value.empty() && (value.back() & 0x80) != 0) value.pop_back();  // no half character
    value += "...";
  }
  throw WorldError((path_.empty() ? "" : path_ + ": ") + value + " must be " + rule);
}

void JsonValue::require_object() const {
  if (!json_.is_object()) fail("an object");
}

void JsonValue::expect_keys(std::span<const char* const> keys) const {
  require_object();
  for (const auto& [key, value] : json_.items()) {
    if (std::find(keys.begin(), keys.end(), key) != keys.end()) continue;
    std::string known;
    for (const char* k : keys) known += (known.empty() ? "" : ", ") + std::string(k);
    throw WorldError((path_.empty() ? "" : path_ + ": ") + json(key).dump() + " is an unknown key; known are " + known);
  }
}

std::optional<JsonValue> JsonValue::find(const std::string& key) const {
  const auto found = json_.find(key);
  if (found == json_.end()) return std::nullopt;
  return JsonValue(*found, path_.empty() ? key : path_ + "." + key);
}

JsonValue JsonValue::at(const std::string& key) const {
  if (const auto value = find(key)) return *value;
  throw WorldError((path_.empty() ? "" : path_ + ".") + key + ": is missing and must be given");
}

std::vector<JsonValue> JsonValue::items() const {
  if (!json_.is_array()) fail("an array");
  std::vector<JsonValue> items;
  items.reserve(json_.size());
  for (std::size_t i = 0; i < json_.size(); ++i) items.emplace_back(json_[i], path_ + "[" + std::to_string(i) + "]");
  return items;
}

double JsonValue::number(double low, double high, Low open) const {
  const double value = json_.is_number() ? json_.get<double>() : NAN;
  if (!(value >= low && value <= high) || (open == Low::kExcluded && value == low))
    fail("a number in " + std::string(open == Low::kExcluded ? "(" : "[") + text_of(low) + ", " + text_of(high) + "]");
  return value;
}

int JsonValue::integer(int low, int high) const {
  const double value = json_.is_number() ? json_.get<double>() : NAN;
  if (!(value >= low && value <= high) || value != std::floor(value))
    fail("an integer in [" + std::to_string(low) + ", " + std::to_string(high) + "]");
  return static_cast<int>(value);
}

Eigen::VectorXd JsonValue::numbers(int size, double low, double high, Low open) const {
  if (!json_.is_array() || json_.size() != static_cast<std::size_t>(size))
    fail("an array of " + std::to_string(size) + " numbers");
  const std::vector<JsonValue> all = items();
  Eigen::VectorXd values(size);
  for (int i = 0; i < size; ++i) values[i] = all[static_cast<std::size_t>(i)].number(low, high, open);
  return values;
}

std::string JsonValue::text(std::size_t max_length) const {
  const bool control = json_.is_string() && std::ranges::any_of(json_.get_ref<const std::string&>(),
                                                                [](unsigned char c) { return c < 32 || c == 127; });
  if (!json_.is_string() || json_.get_ref<const std::string&>().empty() ||
      json_.get_ref<const std::string&>().size() > max_length || control)
    fail("a text of 1 to " + std::to_string(max_length) + " characters without control characters");
  return json_.get<std::string>();
}

}  // namespace swarm
