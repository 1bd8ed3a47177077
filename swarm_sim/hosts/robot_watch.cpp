#include "swarm_sim/hosts/robot_watch.h"

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/receive.h"

namespace swarm {
namespace {

constexpr Duration kIdlePeriod = 1s;  // nothing is due by itself

// False: it is no such message of this robot.
template <class Message>
bool read(std::span<const std::uint8_t> bytes, int robot_id, Message* message) {
  Message newest{};
  if (receive(bytes, FromRobot{robot_id}, {}, AnyOrder{}, &newest) != Refusal::kNone) return false;
  *message = newest;
  return true;
}

}  // namespace

RobotWatch::RobotWatch(int robot_id, SwarmShare share, BusRecorder& recorder, const std::set<std::string>& cells)
    : id_(robot_id), share_(share), recorder_(recorder), cells_(cells) {}

std::vector<Subscription> RobotWatch::subscriptions() const {
  std::vector<Subscription> all;
  for (const char* channel : channels_of(BusId::kOnboard)) all.push_back({BusId::kOnboard, channel});
  if (share_ == SwarmShare::kNone) return all;
  for (const char* channel : channels_of(BusId::kSwarm)) all.push_back({BusId::kSwarm, channel});
  for (const std::string& channel : cells_) all.push_back({BusId::kSwarm, channel});
  return all;
}

void RobotWatch::on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                            Outbox&) {
  if (bus == BusId::kSwarm && share_ == SwarmShare::kOwn && !is_own(channel, bytes)) return;
  recorder_.hear(now, bus, id_, channel, bytes);
  if (bus == BusId::kSwarm) return;
  if (channel == channel::kMapStatus) (void)read(bytes, id_, &map_);
  if (channel == channel::kBroadcastStatus) (void)read(bytes, id_, &broadcast_);
  if (channel == channel::kPlannerStatus) note_plan(bytes);
}

bool RobotWatch::is_own(std::string_view channel, std::span<const std::uint8_t> bytes) const {
  sogm_swarm::packed_announcement_t announcement;
  sogm_swarm::last_words_t words;
  return channel == channel::kLastWords ? read(bytes, id_, &words) : read(bytes, id_, &announcement);
}

Utime RobotWatch::step(Utime now, Outbox&) {
  return now + kIdlePeriod;
}

void RobotWatch::note_plan(std::span<const std::uint8_t> bytes) {
  const sogm_swarm::planner_status_t before = planner_;
  if (!read(bytes, id_, &planner_)) return;
  if (planner_.header.boot != before.header.boot) {  // it counts from 0 again
    plans_before_ -= before.plans;
    missed_before_ -= before.missed;
  }
  if (!started_ || planner_.plans == plans_seen_) return;
  plans_seen_ = planner_.plans;
  const double ms[] = {planner_.compose_ms, planner_.search_ms, planner_.corridor_ms, planner_.optimize_ms,
                       planner_.check_ms,   planner_.total_ms,  planner_.prepare_ms};
  for (std::size_t i = 0; i < step_ms_.size(); ++i) step_ms_[i].push_back(ms[i]);
}

std::string RobotWatch::missing() const {
  using sogm_swarm::broadcast_status_t;
  if (broadcast_.header.utime == 0) return "broadcast_daemon: no status";
  if (broadcast_.state == broadcast_status_t::kTwin)
    return "broadcast_daemon: another one speaks under this robot's id";
  if (broadcast_.state == broadcast_status_t::kClock) return "broadcast_daemon: a peer's clock differs too much";
  if (broadcast_.state == broadcast_status_t::kOffCourse) return "broadcast_daemon: the robot is far off its motion";
  if (broadcast_.state != broadcast_status_t::kFlying)
    return "broadcast_daemon: waits for the robot's state or for peers";
  if (map_.header.utime == 0) return "map_daemon: no status";
  const bool stands = planner_.state == sogm_swarm::planner_status_t::kNotLed;
  if (planner_.plans == 0 && !stands) return "planner_daemon: no plan";
  return "";
}

void RobotWatch::mark_start() {
  started_ = true;
  plans_before_ = planner_.plans;
  missed_before_ = planner_.missed;
}

RobotReport RobotWatch::counts() const {
  RobotReport robot;
  robot.plans = planner_.plans - plans_before_;
  robot.missed = planner_.missed - missed_before_;
  robot.is_unreachable = planner_.state == sogm_swarm::planner_status_t::kUnreachable;
  for (std::size_t i = 1; i < robot.refused.size(); ++i)
    robot.refused[i] = map_.refused[i] + planner_.refused[i] + broadcast_.refused[i];
  return robot;
}

}  // namespace swarm
