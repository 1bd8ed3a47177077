#include "tools/operator/goal_node.h"

#include "lcmtypes/bus/channels.h"

namespace swarm {
namespace {

using sogm_swarm::planner_status_t;

constexpr Duration kAgain = 200ms;    // a message may get lost, or the planner start later
constexpr Duration kReceived = 20ms;  // a status that is so much younger than the goal is of a planner that heard it
constexpr Duration kMaxAge = 1s;
constexpr Duration kClockLimit = 100ms;

}  // namespace

std::vector<Subscription> GoalNode::subscriptions() const {
  return {{BusId::kOnboard, channel::kRobotState}, {BusId::kOnboard, channel::kPlannerStatus}};
}

void GoalNode::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) {
  const FromRobot from{order_.robot_id};
  const TimeWindow window{now, kMaxAge, kClockLimit};
  if (channel == channel::kRobotState) {
    sogm_swarm::robot_state_t state;
    if (receive(bytes, from, window, state_gate_, &state) != Refusal::kNone) return;
    position_ = Eigen::Vector3d(state.position);
    const Eigen::Vector3d here = (position_->array() * 1e3).round() / 1e3;  // a number that can be read
    if (order_.mission.empty()) order_.mission.push_back({.position = here});
  } else {
    planner_status_t status;
    if (receive(bytes, from, window, status_gate_, &status) != Refusal::kNone) return;
    const bool is_since = told_ && to_utime(status.header.utime) >= *told_ + kReceived;
    if (is_since && ++answers_ > 1) status_ = status;  // a busy planner may have made the first before it read the goal
  }
}

Utime GoalNode::step(Utime now, Outbox& outbox) {
  if (order_.mission.empty()) return now + kAgain;
  if (now >= told_again_.due(now, kAgain)) {
    sogm_swarm::goal_t goal = to_goal(order_.mission);
    goal.header = headers_.next(now);
    outbox.publish(BusId::kOnboard, channel::kGoal, goal);
    if (!told_) told_ = now;
    told_again_.done(now);
  }
  return std::max(told_again_.due(now, kAgain), now + 1us);
}

GoalNode::Progress GoalNode::progress() const {
  if (!status_) return Progress::kSilent;
  if (status_->state == planner_status_t::kUnreachable) return Progress::kUnreachable;
  if (status_->state != planner_status_t::kPlanning) return Progress::kWaits;
  const Waypoint& last = order_.mission.back();
  const bool is_last = status_->waypoint + 1 == std::ssize(order_.mission);
  const bool is_there = position_ && (*position_ - last.position).norm() <= last.tolerance_m;
  return is_last && is_there ? Progress::kArrived : Progress::kFlies;
}

}  // namespace swarm
