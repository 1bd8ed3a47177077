#include "tools/viewer/robot_health.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/text.h"
#include "planner_daemon/coordination/flight_state.h"

namespace swarm {

using namespace sogm_swarm;

namespace {

constexpr double kSilent_s = 2.5;  // statuses come once a second
constexpr double kUnannounced_s = 1.0;
constexpr double kLowBattery = 0.2;

template <std::size_t size>
const char* name_of(const std::array<const char*, size>& names, int value) {
  return value >= 0 && value < static_cast<int>(size) ? names[static_cast<std::size_t>(value)] : "?";
}

}  // namespace

const char* state_name(const map_status_t& status) {
  static constexpr std::array kNames = {"running", "no robot state", "stale robot state", "nothing seen"};
  return name_of(kNames, status.state);
}

const char* state_name(const planner_status_t& status) {
  static constexpr std::array kNames = {"planning",           "no map", "stale map", "no goal", "nothing committed",
                                        "no way to the goal", "not led"};
  return name_of(kNames, status.state);
}

const char* state_name(const broadcast_status_t& status) {
  static constexpr std::array kNames = {"flying",     "no robot state", "waiting for a peer",
                                        "no storage", "clocks differ",  "another speaks under this id",
                                        "off course"};
  return name_of(kNames, status.state);
}

const char* state_name(const perception_status_t& status) {
  static constexpr std::array kNames = {"running", "no scan", "its pose jumps"};
  return name_of(kNames, status.state);
}

std::string activity_of(const RobotPicture& robot) {
  if (robot.flight && robot.flight->state != flight_status_t::kFlying) return text_of_flight(*robot.flight);
  const auto goal = robot.next_goal();
  if (!goal || (robot.planner && robot.planner->state == planner_status_t::kNoGoal)) return "keeps its place";
  std::string text = "flying to " + text_of(*goal);
  if (robot.planner && robot.planner->num_waypoints > 1) {
    text += " (" + std::to_string(std::int64_t{robot.planner->waypoint} + 1) + " of " +
            std::to_string(robot.planner->num_waypoints) + ")";
  }
  return text;
}

std::string trouble_of(const RobotPicture& robot, Utime now) {
  const auto silent = [&](const char* daemon, const char* channel, bool was_heard) {
    const auto traffic = robot.traffic.find(channel);
    const bool is_silent = was_heard && traffic != robot.traffic.end() && traffic->second.age_s(now) > kSilent_s;
    return is_silent ? std::string(daemon) + " daemon silent" : std::string();
  };
  for (const std::string& text : {silent("map", channel::kMapStatus, robot.map.has_value()),
                                  silent("planner", channel::kPlannerStatus, robot.planner.has_value()),
                                  silent("broadcast", channel::kBroadcastStatus, robot.broadcast.has_value()),
                                  silent("perception", channel::kPerceptionStatus, robot.perception.has_value()),
                                  silent("bridge's", channel::kVehicleStatus, robot.vehicle.has_value())})
    if (!text.empty()) return text;
  const double unannounced_s = robot.motion.committed.empty() ? 0.0 : robot.announcements.age_s(now);
  if (unannounced_s > kUnannounced_s) return "silent for " + fixed(unannounced_s, 0) + " s";
  if (robot.broadcast && robot.broadcast->state != broadcast_status_t::kFlying) return state_name(*robot.broadcast);
  if (robot.perception && robot.perception->state != perception_status_t::kRunning)
    return state_name(*robot.perception);
  if (robot.map && robot.map->state != map_status_t::kRunning) return state_name(*robot.map);
  const bool is_led = robot.planner && robot.planner->state != planner_status_t::kNotLed;
  if (is_led && robot.planner->state != planner_status_t::kPlanning) return state_name(*robot.planner);
  if (robot.vehicle && robot.vehicle->battery >= 0.0f && robot.vehicle->battery < kLowBattery)
    return "the battery is low";
  return "";
}

}  // namespace swarm
