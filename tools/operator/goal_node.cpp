#include "tools/operator/goal_node.h"

#include "lcmtypes/bus/channels.h"

namespace swarm {
namespace {

using sogm_swarm::flight_status_t;
using sogm_swarm::order_t;
using sogm_swarm::planner_status_t;

constexpr Duration kAgain = 200ms;    // a message may get lost, or the planner start later
constexpr Duration kReceived = 20ms;  // a status that is so much younger than the goal is of a planner that heard it
constexpr Duration kMaxAge = 1s;
constexpr Duration kClockLimit = 100ms;

// The state in which an order is done.
std::int16_t end_of(std::int16_t order) {
  switch (order) {
    case order_t::kFly:
    case order_t::kTakeOff:
      return flight_status_t::kFlying;
    case order_t::kHold:
      return flight_status_t::kHold;
    default:
      return flight_status_t::kOnGround;
  }
}

}  // namespace

std::vector<Subscription> GoalNode::subscriptions() const {
  return {{BusId::kOnboard, channel::kRobotState},
          {BusId::kOnboard, channel::kPlannerStatus},
          {BusId::kOnboard, channel::kFlightStatus}};
}

void GoalNode::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) {
  const FromRobot from{order_.robot_id};
  const TimeWindow window{now, kMaxAge, kClockLimit};
  if (channel == channel::kRobotState) {
    sogm_swarm::robot_state_t state;
    if (receive(bytes, from, window, state_gate_, &state) != Refusal::kNone) return;
    position_ = Eigen::Vector3d(state.position);
  } else if (channel == channel::kFlightStatus) {
    flight_status_t status;
    if (receive(bytes, from, window, flight_gate_, &status) != Refusal::kNone) return;
    flight_ = status;
    if (status.order_boot == boot_) flight_answers_ = true;
  } else {
    planner_status_t status;
    if (receive(bytes, from, window, status_gate_, &status) != Refusal::kNone) return;
    const bool is_since = told_ && to_utime(status.header.utime) >= *told_ + kReceived;
    if (is_since && ++answers_ > 1) status_ = status;  // a busy planner may have made the first before it read the goal
  }
}

Utime GoalNode::step(Utime now, Outbox& outbox) {
  if (now >= told_again_.due(now, kAgain)) {
    if (order_.order) {
      if (!flight_answers_) order(now, *order_.order, outbox);
    } else {
      sogm_swarm::goal_t goal = to_goal(order_.mission);
      goal.header = headers_.next(now);
      outbox.publish(BusId::kOnboard, channel::kGoal, goal);
      // It may hold its place, or be on its way home: who sends it somewhere wants it to go there.
      const bool is_elsewhere = flight_ && flight_->state != flight_status_t::kFlying &&
                                flight_->state != flight_status_t::kOnGround &&
                                flight_->state != flight_status_t::kTakeOff;
      if (is_elsewhere && !flight_answers_) order(now, order_t::kFly, outbox);
      if (!told_) told_ = now;
    }
    told_again_.done(now);
  }
  return std::max(told_again_.due(now, kAgain), now + 1us);
}

void GoalNode::order(Utime now, std::int16_t order, Outbox& outbox) {
  order_t message{};
  message.header = order_headers_.next(now);
  message.order = order;
  message.height = order == order_t::kTakeOff ? order_.height_m : 0.0;
  message.other_id = static_cast<std::int16_t>(order == order_t::kWithout ? order_.other_id : 0);
  outbox.publish(BusId::kOnboard, channel::kFlightOrder, message);
}

GoalNode::Progress GoalNode::progress_of_order() const {
  if (!flight_answers_) return Progress::kSilent;
  if (flight_->order_boot == boot_ && flight_->verdict != flight_status_t::kAccepted) return Progress::kRefused;
  if (order_.order == order_t::kWithout || flight_->state == end_of(*order_.order)) return Progress::kArrived;
  // It did not get there.
  const bool gave_up = flight_->state == flight_status_t::kOnGround;
  return gave_up ? Progress::kRefused : Progress::kFlies;
}

GoalNode::Progress GoalNode::progress() const {
  if (order_.order) return progress_of_order();
  if (flight_ && flight_->state == flight_status_t::kOnGround) return Progress::kOnGround;
  if (!status_) return Progress::kSilent;
  if (status_->state == planner_status_t::kUnreachable) return Progress::kUnreachable;
  if (status_->state != planner_status_t::kPlanning) return Progress::kWaits;
  const Waypoint& last = order_.mission.back();
  const bool is_last = status_->waypoint + 1 == std::ssize(order_.mission);
  const bool is_there = position_ && (*position_ - last.position).norm() <= last.tolerance_m;
  return is_last && is_there ? Progress::kArrived : Progress::kFlies;
}

}  // namespace swarm
