#include "planner_daemon/coordination/strangers.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "lcmtypes/bus/limits.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

using sogm_swarm::announcement_t;

namespace {

constexpr Duration kPeriod = 20ms;  // of what is told of one, at most

}  // namespace

Refusal Strangers::admit(const announcement_t& message) {
  const bool is_one_more = !strangers_.contains(message.header.robot_id);
  if (is_one_more && std::ssize(strangers_) == kMaxStrangers) return Refusal::kRobot;
  return strangers_[message.header.robot_id].gate.pass(message.header);
}

void Strangers::heard(announcement_t message) {
  Stranger& stranger = strangers_.at(message.header.robot_id);
  stranger.newest = std::move(message);
  stranger.turn.wait();
}

std::optional<announcement_t> Strangers::take_due(Utime now) {
  for (auto& [id, stranger] : strangers_) {
    if (stranger.turn.due(now, kPeriod) > now) continue;
    stranger.turn.taken(now, kPeriod);
    return stranger.newest;
  }
  return std::nullopt;
}

Utime Strangers::due_utime(Utime now) {
  Utime due = kNever;
  for (auto& [id, stranger] : strangers_) due = std::min(due, stranger.turn.due(now, kPeriod));
  return due;
}

std::vector<int> Strangers::ids() const {
  std::vector<int> ids;
  for (const auto& [id, stranger] : strangers_) ids.push_back(id);
  return ids;
}

std::vector<announcement_t> Strangers::tombstones() const {
  std::vector<announcement_t> tombstones;
  for (const auto& [id, stranger] : strangers_) tombstones.push_back(stranger.newest);
  return tombstones;
}

std::vector<announcement_t> Strangers::told() const {
  std::vector<announcement_t> told;
  for (const auto& [id, stranger] : strangers_)
    if (!stranger.turn.waits()) told.push_back(stranger.newest);
  return told;
}

void Strangers::set_clock(Duration step) {
  for (auto& [id, stranger] : strangers_) {
    shift(step, &stranger.newest);
    stranger.turn.set_clock(step);
  }
}

}  // namespace swarm
