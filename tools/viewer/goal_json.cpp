#include "tools/viewer/goal_json.h"

#include <algorithm>
#include <initializer_list>
#include <stdexcept>

#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr std::size_t kShown = 40;  // characters of a value that is refused

[[noreturn]] void refuse(const std::string& name, const Json& value, const std::string& rule) {
  std::string text = value.dump(-1, ' ', true, Json::error_handler_t::replace);
  if (text.size() > kShown) text = text.substr(0, kShown) + "...";
  throw std::runtime_error(name + " " + text + ": must be " + rule);
}

std::string range(double low, double high) {
  return "within [" + text_of(low) + ", " + text_of(high) + "]";
}

double read_number(const std::string& name, const Json& value, double low, double high) {
  if (!value.is_number() || !(value.get<double>() >= low && value.get<double>() <= high))
    refuse(name, value, "a number " + range(low, high));
  return value.get<double>();
}

int read_integer(const std::string& name, const Json& value, int low, int high) {
  if (!value.is_number_integer()) refuse(name, value, "an integer " + range(low, high));
  return static_cast<int>(read_number(name, value, low, high));
}

// An object with all that is needed and nothing that is not known.
void check_keys(const std::string& name, const Json& value, std::initializer_list<const char*> needed,
                std::initializer_list<const char*> others) {
  if (!value.is_object()) refuse(name, value, "an object");
  for (const char* key : needed)
    if (!value.contains(key)) throw std::runtime_error(name + ": must have '" + key + "'");
  for (const auto& item : value.items()) {
    const auto is_key = [&](const char* key) { return item.key() == key; };
    if (std::ranges::none_of(needed, is_key) && std::ranges::none_of(others, is_key))
      refuse(name + ": key", item.key(), "one that is known");
  }
}

Waypoint read_waypoint(const std::string& name, const Json& value) {
  check_keys(name, value, {"position"}, {"wait_s"});
  const Json& position = value["position"];
  if (!position.is_array() || position.size() != 3) refuse(name + ": position", position, "[x, y, z]");
  Waypoint waypoint;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    waypoint.position[static_cast<Eigen::Index>(axis)] =
        read_number(name + ": coordinate", position[axis], -kMaxPosition_m, kMaxPosition_m);
  }
  if (value.contains("wait_s"))
    waypoint.wait = to_duration(read_number(name + ": wait_s", value["wait_s"], 0.0, kMaxWait_s));
  return waypoint;
}

}  // namespace

GoalOrder read_goal(const Json& goal) {
  check_keys("goal", goal, {"robot", "waypoints"}, {"times"});
  GoalOrder order;
  order.robot_id = read_integer("goal: robot", goal["robot"], 0, 32'767);
  const Json& waypoints = goal["waypoints"];
  if (!waypoints.is_array() || waypoints.empty()) refuse("goal: waypoints", waypoints, "a list of at least one");
  const int times = goal.contains("times") ? read_integer("goal: times", goal["times"], 1, kMaxWaypoints) : 1;
  if (waypoints.size() > static_cast<std::size_t>(kMaxWaypoints / times)) {
    refuse("goal: waypoints times times", waypoints.size() * static_cast<std::size_t>(times),
           "at most " + std::to_string(kMaxWaypoints));
  }
  for (const Json& waypoint : waypoints)
    order.mission.push_back(read_waypoint("waypoint " + std::to_string(order.mission.size() + 1), waypoint));
  const Mission once = order.mission;
  for (int time = 1; time < times; ++time) order.mission.insert(order.mission.end(), once.begin(), once.end());
  return order;
}

}  // namespace swarm
