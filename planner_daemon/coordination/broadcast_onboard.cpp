// What the broadcast daemon hears on the robot's own bus, and how it goes with the robot: where it is, what its
// operator and its planner want, and what follows for what it flies.
#include <spdlog/spdlog.h>

#include <algorithm>

#include "planner_daemon/coordination/broadcast_node.h"

namespace swarm {
namespace {

using sogm_swarm::announcement_t;
using sogm_swarm::broadcast_status_t;
using sogm_swarm::flight_status_t;

constexpr Duration kLegPeriod = 200ms;  // between proposals of the way up or down
constexpr double kHere_m = 0.02;        // a robot that stands is where it is bound to be
constexpr double kResume_m = 0.5;       // a kept motion is gone on with where the robot is so close to it

}  // namespace

template <class T>
Refusal BroadcastNode::receive_onboard(Utime now, std::span<const std::uint8_t> bytes, SequenceGate& gate, T* message,
                                       Duration* ahead) const {
  const auto receive_at = [&](Utime time) {
    const TimeWindow window{time, kMaxAge, to_duration(config_.clock_limit_s)};
    return receive(bytes, FromRobot{config_.robot_id}, window, gate, message);
  };
  *ahead = offered_step_;
  const Refusal refusal = receive_at(now + offered_step_);
  if (refusal != Refusal::kTime || offered_step_ == 0us) return refusal;
  *ahead = 0us;  // on its way since before
  return receive_at(now);
}

Refusal BroadcastNode::on_state(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::robot_state_t state;
  Duration ahead{};
  const Refusal refusal = receive_onboard(now, bytes, state_gate_, &state, &ahead);
  if (refusal != Refusal::kNone) return refusal;
  state.header.utime -= ahead.count();
  measured_.position = Eigen::Vector3d(state.position);
  measured_.velocity = Eigen::Vector3d(state.velocity);
  if (motion()) return track(now, state), Refusal::kNone;
  const Eigen::Vector3d position(state.position);
  Motion first = kept_.motion.value_or(Motion{Trajectory::hover(1, now, position), {}});
  // Kept in another time, for the clock was set back since: it would be flown again. The last node's clock may have
  // been a little ahead.
  const bool is_of_another_time = kept_.utime > now + to_duration(config_.clock_limit_s);
  // Or the robot has been carried, or has lost its way.
  if (is_of_another_time || (first.at(now).position - position).norm() > kResume_m) {
    first = {Trajectory::hover(first.seq() + 1, now, position), {}};
  }
  agreement_.start(first, kept_.forced_seq, kept_.cells);
  keep_promise(now);
  yaw_rad_ = state.yaw;
  return Refusal::kNone;
}

Refusal BroadcastNode::on_order(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::order_t order;
  Duration ahead{};
  const Refusal refusal = receive_onboard(now, bytes, order_gate_, &order, &ahead);
  if (refusal != Refusal::kNone || !motion()) return refusal;  // the operator asks again
  advance(now);
  if (order.order == sogm_swarm::order_t::kWithout) {
    flight_.answer(order, go_on_without(now, order.other_id) ? flight_status_t::kAccepted : flight_status_t::kNotNow);
    return Refusal::kNone;
  }
  const std::int16_t before = flight_.state();
  flight_.advance(now, robot(now));
  flight_.on_order(now, order, robot(now));
  if (flight_.state() != before) spdlog::info("ordered: {}", name_of_flight_state(flight_.state()));
  return Refusal::kNone;
}

Refusal BroadcastNode::on_vehicle(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::vehicle_status_t vehicle;
  Duration ahead{};
  const Refusal refusal = receive_onboard(now, bytes, vehicle_gate_, &vehicle, &ahead);
  if (refusal == Refusal::kNone) flight_.on_vehicle(now, vehicle);
  return refusal;
}

FlightState::Robot BroadcastNode::robot(Utime now) const {
  return {measured_, *motion(), state(now) == broadcast_status_t::kFlying};
}

void BroadcastNode::fly(Utime now) {
  flight_.advance(now, robot(now));
  const auto is_here = [this](Utime utime) {
    return (motion()->at(utime).position - measured_.position).norm() < kHere_m;
  };
  const bool rests_here = is_here(now) && is_here(motion()->end_utime());
  if (flight_.take_rests_here() && !rests_here) {
    protocol_.force(Trajectory::hover(1, now, measured_.position));
    keep_promise(now);
    tracking_.back_on_course();
  }
  if (now < leg_.due(now, kLegPeriod) || !protocol_.pending().empty()) return;
  const std::optional<Trajectory> leg = flight_.next_leg(now, *motion());
  if (!leg) return;
  leg_.done(now);
  if (!identity_.has_twin(now)) (void)propose(now, *leg);
}

void BroadcastNode::track(Utime now, const sogm_swarm::robot_state_t& state) {
  const Utime utime = to_utime(state.header.utime);
  if (utime < motion()->committed.start_utime()) return;  // where it was bound to be then is not known any more
  const Eigen::Vector3d position(state.position), velocity(state.velocity);
  const bool was_off_course = tracking_.was_off_course(now);
  tracking_.saw(utime, (position - motion()->at(utime).position).norm());
  if (!tracking_.is_off_course()) return;
  if (!was_off_course)
    spdlog::warn("off course: the robot is {:.2f} m from its motion; it goes on from where it is",
                 tracking_.newest_m());
  protocol_.force(Trajectory::braking(1, utime, position, velocity, config_.limits));
  keep_promise(now);
  tracking_.back_on_course();
}

Refusal BroadcastNode::on_candidate(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::candidate_t message;
  Duration ahead{};
  const Refusal refusal = receive_onboard(now, bytes, candidate_gate_, &message, &ahead);
  if (refusal != Refusal::kNone) return refusal;
  ++candidates_;
  advance(now);
  Trajectory candidate = Trajectory::from_wire(message.trajectory);
  candidate.shift(-ahead);
  Rejection rejection = !flight_.is_led_by_planner() ? Rejection::kNotLed
                        : identity_.has_twin(now)    ? Rejection::kTwin
                                                     : examine(now, candidate);
  if (rejection == Rejection::kNone) rejection = propose(now, candidate, message.urgent != 0);
  ++rejected_[static_cast<std::size_t>(rejection)];
  if (in_vain_.count++ == 0) in_vain_.first = now;
  in_vain_.newest = now;
  ++in_vain_.rejected[static_cast<std::size_t>(rejection)];
  if (state(now) != broadcast_status_t::kFlying) in_vain_ = {};
  return Refusal::kNone;
}

Rejection BroadcastNode::examine(Utime now, const Trajectory& candidate) const {
  if (!motion()) return Rejection::kNoCommitted;
  const Utime start = candidate.start_utime();
  if (candidate.empty() || start <= now || start > now + kMaxAhead || candidate.end_utime() > now + kMaxMotion)
    return Rejection::kTime;
  const MotionState branch = motion()->at(start), first = candidate.knot(0);
  if ((branch.position - first.position).norm() > 1e-4 || (branch.velocity - first.velocity).norm() > 1e-3 ||
      (branch.acceleration - first.acceleration).norm() > 1e-2) {
    return Rejection::kDiscontinuous;
  }
  constexpr double kTolerance = 1.01;
  const Slack slack = Slack::of_rounded(kTolerance, candidate.piece_s());
  // Short pieces are looked at between their knots as well: they may be at rest there, and fast in between.
  const Duration step = std::min<Duration>(10ms, candidate.piece() / 8);
  for (Utime t = start; t < candidate.end_utime(); t += step) {
    const MotionState state = candidate.at(t);
    if (state.velocity.cwiseAbs().maxCoeff() > kTolerance * config_.limits.v_max_mps ||
        !config_.limits.can_follow(state, slack))
      return Rejection::kLimits;
  }
  return Rejection::kNone;
}

Refusal BroadcastNode::on_own(Utime now, std::span<const std::uint8_t> bytes) {
  announcement_t message;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, {now}, AnyOrder(), &message);
  if (refusal != Refusal::kNone || !identity_.is_of_twin(now, BusId::kOnboard, message.header)) return refusal;
  identity_.give_way(now, message.header.boot);
  return Refusal::kRobot;
}

}  // namespace swarm
