#include "tools/viewer/swarm_picture.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "tools/logs/log_messages.h"

namespace swarm {

using namespace sogm_swarm;

namespace {

constexpr Duration kStateAge = 500ms;  // older measurements give way to what the robot flies

bool within(Duration span, Utime now, Utime then) {
  return std::chrono::abs(now - then) <= span;  // clocks may jump back
}

}  // namespace

bool Traffic::is_news(Utime now, const header_t& header) const {
  return heard_ == 0 || !is_fresh(now) || std::pair(header.boot, header.seq) > std::pair(boot_, seq_);
}

void Traffic::count(Utime now, const header_t& header) {
  if (header.boot == boot_ && header.seq > seq_) missing_ += header.seq - seq_ - 1;
  if (header.boot != boot_ || header.seq < seq_) missing_ = heard_ = 0;  // it has started again, or a log has
  boot_ = header.boot;
  seq_ = header.seq;
  newest_ = now;
  ++heard_;
  while (!arrivals_.empty() && (!within(1s, now, arrivals_.front()) || arrivals_.size() >= kMost))
    arrivals_.pop_front();
  arrivals_.push_back(now);
}

double Traffic::rate_hz(Utime now) const {
  return static_cast<double>(
      std::count_if(arrivals_.begin(), arrivals_.end(), [now](Utime arrival) { return within(1s, now, arrival); }));
}

bool Traffic::is_fresh(Utime now) const {
  return heard_ > 0 && within(1s, now, newest_);
}

std::optional<Eigen::Vector3d> RobotPicture::position(Utime now) const {
  if (state && within(kStateAge, now, to_utime(state->header.utime))) return Eigen::Vector3d(state->position);
  if (!motion.committed.empty()) return motion.at(now).position;
  return state ? std::optional(Eigen::Vector3d(state->position)) : std::nullopt;
}

// As its planner says; before that by the goal itself.
std::optional<Eigen::Vector3d> RobotPicture::next_goal() const {
  if (planner && planner->num_waypoints > 0) return Eigen::Vector3d(planner->destination);
  if (!goal) return {};
  const int waypoint = std::clamp(planner ? planner->waypoint : 0, 0, goal->num_waypoints - 1);
  return Eigen::Vector3d(goal->waypoints[static_cast<std::size_t>(waypoint)].position);
}

void RobotPicture::keep(Utime now, const announcement_t& message, PeerMask* masks) {
  if (!announcements.is_news(now, message.header)) return;  // it came another way as well
  announcements.count(now, message.header);
  radius_m = message.radius;
  motion = motion_of(message);
  pending = pending_of(message);
  masks->hear(message, now);
}

Refusal GridPicture::keep(const sogm_t& part, bool was_silent) {
  if (!assembler_ || was_silent) assembler_ = std::make_unique<SogmAssembler>();
  const Assembly assembly = assembler_->add(part, &newest_);
  if (assembly.status == AssemblyStatus::kComplete) ++count_;
  return assembly.refusal == Refusal::kSequence ? Refusal::kNone : assembly.refusal;
}

template <class T>
Refusal SwarmPicture::take(Utime now, std::string_view channel, const T& message) {
  const int id = message.header.robot_id;
  if (!robots_.contains(id) && robots_.size() >= kMaxRobots) return Refusal::kRobot;
  RobotPicture& robot = robots_[id];
  Traffic& traffic = robot.traffic.try_emplace(std::string(channel)).first->second;
  const bool was_silent = !traffic.is_fresh(now), is_news = traffic.is_news(now, message.header);
  // What comes twice, or late, changes nothing. Parts of a map, or of a scan, all have one number: assemblers know.
  constexpr bool comes_in_parts = std::is_same_v<T, sogm_t> || std::is_same_v<T, lidar_scan_t>;
  if (!is_news && !comes_in_parts) return Refusal::kNone;
  if (is_news) traffic.count(now, message.header);
  newest_utime_ = to_utime(message.header.utime);
  newest_came_ = now;
  const bool is_kept = maps_of_.value_or(id) == id;
  if constexpr (std::is_same_v<T, sogm_t>) {
    GridPicture& grid = channel == channel::kSeenSpace ? robot.seen_space : robot.sogm;
    grid.was_heard_ = true;
    return is_kept ? grid.keep(message, was_silent) : Refusal::kNone;
  }
  if constexpr (std::is_same_v<T, lidar_scan_t> || std::is_same_v<T, depth_image_t>) {
    if (was_silent) robot.scans = {};
    if (is_kept) (void)robot.scans.add(message, &masks_);
  }
  if constexpr (std::is_same_v<T, perception_status_t>) robot.perception = message;
  if constexpr (std::is_same_v<T, announcement_t>) robot.keep(now, message, &masks_);
  if constexpr (std::is_same_v<T, robot_state_t>) robot.state = message;
  if constexpr (std::is_same_v<T, goal_t>) robot.goal = message;
  if constexpr (std::is_same_v<T, obstacles_t>) robot.obstacles = message;
  if constexpr (std::is_same_v<T, corridors_t>) robot.corridors = message;
  if constexpr (std::is_same_v<T, map_status_t>) robot.map = message;
  if constexpr (std::is_same_v<T, planner_status_t>) robot.planner = message;
  if constexpr (std::is_same_v<T, broadcast_status_t>) robot.broadcast = message;
  if constexpr (std::is_same_v<T, flight_status_t>) robot.flight = message;
  if constexpr (std::is_same_v<T, vehicle_status_t>) robot.vehicle = message;
  return Refusal::kNone;
}

Refusal SwarmPicture::add(Utime now, std::string_view channel, std::span<const std::uint8_t> bytes) {
  ++messages_;
  Refusal taken = Refusal::kNone;
  const auto read = visit_message(channel, bytes, [&](const auto& message) { taken = take(now, channel, message); });
  const Refusal refusal = read.value_or(Refusal::kNone) == Refusal::kNone ? taken : *read;
  if (refusal != Refusal::kNone) refused_.count(refusal);
  return refusal;
}

std::map<SwarmPicture::ObstacleId, obstacle_t> SwarmPicture::obstacles(Utime now, int looker) const {
  std::map<ObstacleId, obstacle_t> found;
  std::map<ObstacleId, Utime> told_utime;
  for (const auto& [id, robot] : robots_) {
    const bool sees = robot.seen_space.was_heard();
    if (!robot.obstacles || (sees && looker >= 0 && looker != id)) continue;
    const Utime utime = to_utime(robot.obstacles->header.utime);
    if (!within(1s, now, utime)) continue;
    for (const obstacle_t& told : robot.obstacles->obstacles) {
      const ObstacleId key = {sees ? id : -1, told.id};
      if (told_utime.contains(key) && told_utime[key] >= utime) continue;
      told_utime[key] = utime;
      obstacle_t& moved = found[key] = told;
      const double ahead_s = told.age_s + to_seconds(now - utime);
      for (int axis = 0; axis < 3; ++axis) moved.position[axis] += ahead_s * told.velocity[axis];
    }
  }
  return found;
}

}  // namespace swarm
