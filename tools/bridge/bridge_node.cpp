#include "tools/bridge/bridge_node.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/limits.h"
#include "planner_daemon/trajectory/motion_limits.h"

namespace swarm {
namespace {

constexpr Duration kHeartbeatPeriod = 1s;
constexpr Duration kSetpointAge = 50ms;      // older ones are of no use
constexpr Duration kSetpointTimeout = 50ms;  // without any: the committed trajectory
constexpr Duration kSamplePeriod = 10ms;
constexpr Duration kAnnouncementAge = 1s;
constexpr Duration kRest = 1s;  // how long the place of rest is sent after all has ended
constexpr Duration kAttitudeAge = 500ms;
constexpr Duration kStateAge = 200ms;  // older than this by more than its usual delay, a state leads nobody
constexpr Duration kVehiclePeriod = 200ms, kVehicleAge = 3s;  // of what is told of the vehicle; of what is known
constexpr Duration kFlightAge = 3s;                           // of the newest flight status
constexpr double kFollowable_m = 1.0;                         // a vehicle farther from its target is not made to follow
constexpr std::int32_t kRestart_ms = 1000;                    // no message is that late

// False for NaN.
bool within(const Eigen::Vector3d& values, double bound) {
  return (values.array().abs() <= bound).all();
}

}  // namespace

const char* to_string(StateRefusal reason) {
  switch (reason) {
    case StateRefusal::kOld:
      return "old";
    case StateRefusal::kValue:
      return "value";
    case StateRefusal::kNoAttitude:
      return "no attitude";
  }
  return "?";
}

BridgeNode::BridgeNode(const BridgeConfig& config, std::int32_t boot, FrameSink sink)
    : config_(config),
      sink_(std::move(sink)),
      frame_(config.north_rad, config.origin),
      encoder_(bridge_of(config)),
      state_headers_(config.robot_id, boot),
      vehicle_headers_(config.robot_id, boot),
      position_controller_(config.gains) {
  verify(config);
}

std::vector<Subscription> BridgeNode::subscriptions() const {
  std::vector<Subscription> all = {{BusId::kOnboard, channel::kSetpoint},
                                   {BusId::kOnboard, channel::kOwnTrajectory},
                                   {BusId::kOnboard, channel::kFlightStatus}};
  if (config_.passes_state) all.push_back({BusId::kOnboard, channel::kRobotState});
  return all;
}

void BridgeNode::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) {
  follow_clock(now);
  Refusal refusal = Refusal::kNone;
  if (channel == channel::kSetpoint) {
    refusal = on_setpoint(now, bytes);
  } else if (channel == channel::kOwnTrajectory) {
    refusal = on_announcement(now, bytes);
  } else if (channel == channel::kFlightStatus) {
    refusal = on_flight_status(now, bytes);
  } else if (channel == channel::kRobotState) {
    refusal = on_state(now, bytes);
  }
  if (refusal != Refusal::kNone) report_.refused.count(refusal);
}

TimeWindow BridgeNode::window(Utime now, Duration max_age) const {
  return {now, max_age, to_duration(config_.clock_limit_s)};
}

Refusal BridgeNode::on_setpoint(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::setpoint_t setpoint;
  const auto sane_and_in_order = [this](const sogm_swarm::setpoint_t& m) {
    const bool sane = within(Eigen::Vector3d(m.position), kMaxPosition_m) &&
                      within(Eigen::Vector3d(m.velocity), kMaxVelocity_mps) &&
                      within(Eigen::Vector3d(m.acceleration), kMaxAcceleration_mps2) &&
                      within(Eigen::Vector3d(m.jerk), kMaxJerk_mps3) && std::abs(m.yaw_rate) <= kMaxVelocity_mps;
    return sane ? setpoint_gate_.pass(m.header) : Refusal::kValue;
  };
  const Refusal refusal =
      receive(bytes, FromRobot{config_.robot_id}, window(now, kSetpointAge), sane_and_in_order, &setpoint);
  if (refusal != Refusal::kNone) return refusal;
  const Utime utime = to_utime(setpoint.header.utime);
  const MotionState state{Eigen::Vector3d(setpoint.position), Eigen::Vector3d(setpoint.velocity),
                          Eigen::Vector3d(setpoint.acceleration), Eigen::Vector3d(setpoint.jerk)};
  setpoint_heard_ = now;
  yaw_rad_ = setpoint.yaw;
  // The committed trajectory may have been sampled beyond it meanwhile: the robot is never led backwards.
  if (utime <= sent_utime_ && utime >= sent_utime_ - kSetpointAge) {
    ++report_.late;
  } else {
    ++report_.setpoints;
    send_target(utime, state, setpoint.yaw, setpoint.yaw_rate);
  }
  report_.led_by = LedBy::kSetpoints;
  return Refusal::kNone;
}

Refusal BridgeNode::on_announcement(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  const Refusal refusal =
      receive(bytes, FromRobot{config_.robot_id}, window(now, kAnnouncementAge), announcement_gate_, &message);
  if (refusal != Refusal::kNone) return refusal;
  motion_ = motion_of(message);
  announcement_heard_ = now;
  return Refusal::kNone;
}

Refusal BridgeNode::on_flight_status(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::flight_status_t message;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now, kFlightAge), flight_gate_, &message);
  if (refusal != Refusal::kNone) return refusal;
  flight_ = message;
  flight_heard_ = now;
  return Refusal::kNone;
}

// Roll and pitch are the controller's to know: it takes place and yaw.
Refusal BridgeNode::on_state(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::robot_state_t state;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now, kStateAge), state_gate_, &state);
  if (refusal != Refusal::kNone) return refusal;
  mavlink::VisionPositionEstimate estimate;
  estimate.time_us = static_cast<std::uint64_t>(state.header.utime);
  estimate.position = to_floats(frame_.position_to_ned(Eigen::Vector3d(state.position)));
  estimate.yaw = static_cast<float>(frame_.yaw(state.yaw));
  send(estimate);
  ++report_.states;
  return Refusal::kNone;
}

void BridgeNode::on_frame(Utime now, const mavlink::Message& message, Outbox& outbox) {
  follow_clock(now);
  if (const auto* const heartbeat = std::get_if<mavlink::Heartbeat>(&message)) on_controller(now, *heartbeat);
  if (const auto* const attitude = std::get_if<mavlink::Attitude>(&message)) on_controller(now, *attitude);
  if (const auto* const local = std::get_if<mavlink::LocalPositionNed>(&message)) on_controller(now, *local, outbox);
  if (const auto* const state = std::get_if<mavlink::ExtendedSysState>(&message)) {
    has_vehicle_news_ |= report_.controller.landed_state != state->landed_state;
    report_.controller.landed_state = state->landed_state;
  }
  if (const auto* const status = std::get_if<mavlink::SysStatus>(&message))
    battery_ = status->battery_percent <= 100 ? static_cast<float>(status->battery_percent) / 100.0f : -1.0f;
  if (const auto* const ack = std::get_if<mavlink::CommandAck>(&message);
      ack != nullptr && report_.told == ack->command)
    report_.answered = ack->result;
}

void BridgeNode::on_controller(Utime now, const mavlink::Heartbeat& heartbeat) {
  if (heartbeat.autopilot == mavlink::Heartbeat::kNone) return;  // a camera, say
  report_.heard_utime = now;
  const bool armed = report_.controller.armed(), obeys = report_.controller.obeys();
  report_.controller.heartbeat = heartbeat;
  has_vehicle_news_ |= armed != report_.controller.armed() || obeys != report_.controller.obeys();
}

void BridgeNode::on_controller(Utime now, const mavlink::Attitude& attitude) {
  if (!pass(&attitude_clock_, attitude.time_boot_ms)) return;
  if (!(std::abs(attitude.yaw) <= kMaxVelocity_mps)) return refuse(StateRefusal::kValue);
  attitude_heard_ = now;
  attitude_yaw_rad_ = frame_.yaw(attitude.yaw);
}

void BridgeNode::on_controller(Utime now, const mavlink::LocalPositionNed& local, Outbox& outbox) {
  if (!pass(&position_clock_, local.time_boot_ms)) return;
  const Eigen::Vector3d position = frame_.position_to_world(to_vector(local.position));
  const Eigen::Vector3d velocity = frame_.to_world(to_vector(local.velocity));
  if (!within(position, kMaxPosition_m) || !within(velocity, kMaxVelocity_mps)) return refuse(StateRefusal::kValue);
  if (target_) report_.off_m = (position - *target_).norm();
  state_utime_ = now - to_duration(config_.state_delay_s);
  state_.position = position;
  state_.velocity = velocity;
  if (!attitude_heard_ || now - *attitude_heard_ > kAttitudeAge) return refuse(StateRefusal::kNoAttitude);
  if (!config_.publish_state) return;
  sogm_swarm::robot_state_t state{};
  state.header = state_headers_.next(now - to_duration(config_.state_delay_s));
  Eigen::Map<Eigen::Vector3d>(state.position) = position;
  Eigen::Map<Eigen::Vector3d>(state.velocity) = velocity;
  state.yaw = attitude_yaw_rad_;
  outbox.publish(BusId::kOnboard, channel::kRobotState, state);
  ++report_.states;
}

BridgeNode::BootClock::Verdict BridgeNode::BootClock::pass(std::uint32_t time_ms) {
  const auto since = [time_ms](std::uint32_t earlier) { return static_cast<std::int32_t>(time_ms - earlier); };
  if (!newest_ms_ || since(*newest_ms_) > 0) {
    newest_ms_ = time_ms;
    suspect_ms_.reset();
    return Verdict::kNewer;
  }
  if (since(*newest_ms_) >= -kRestart_ms) return Verdict::kOld;
  // One message from far back is a stray; a second that follows it comes from a clock that began anew.
  const bool follows = suspect_ms_ && since(*suspect_ms_) > 0 && since(*suspect_ms_) <= kRestart_ms;
  suspect_ms_ = time_ms;
  return follows ? Verdict::kRestarted : Verdict::kOld;
}

bool BridgeNode::pass(BootClock* clock, std::uint32_t time_ms) {
  const BootClock::Verdict verdict = clock->pass(time_ms);
  if (verdict == BootClock::Verdict::kOld) {
    refuse(StateRefusal::kOld);
    return false;
  }
  if (verdict == BootClock::Verdict::kRestarted) {
    ++report_.restarts;
    position_clock_ = attitude_clock_ = BootClock();
    attitude_heard_.reset();
    state_utime_.reset();
    (void)clock->pass(time_ms);
  }
  return true;
}

Utime BridgeNode::step(Utime now, Outbox& outbox) {
  follow_clock(now);
  if (now >= heartbeat_.due(now, kHeartbeatPeriod)) {
    mavlink::Heartbeat heartbeat;
    heartbeat.type = mavlink::Heartbeat::kOnboardController;
    heartbeat.autopilot = mavlink::Heartbeat::kNone;
    heartbeat.system_status = mavlink::Heartbeat::kActive;
    send(heartbeat);
    heartbeat_.done(now);
  }
  command(now);
  publish_vehicle(now, outbox);
  const Utime wake = hears_controller(now) ? vehicle_.due(now, kVehiclePeriod) : kNever;
  return std::max(now + 1us, std::min({heartbeat_.due(now, kHeartbeatPeriod), wake, guide(now)}));
}

bool BridgeNode::hears_controller(Utime now) const {
  return report_.heard_utime && now - *report_.heard_utime <= kVehicleAge;
}

void BridgeNode::command(Utime now) {
  if (!config_.arms || !hears_controller(now) || !flight_ || now - flight_heard_ > kFlightAge) return;
  const bool is_followable =
      report_.led_by == LedBy::kSetpoints && target_ && state_utime_ && report_.off_m <= kFollowable_m;
  std::optional<mavlink::CommandLong> order = orders_.next(now, report_.controller, *flight_, is_followable);
  if (!order) return;
  order->target_system = to_byte(config_.target_system);
  order->target_component = to_byte(config_.target_component);
  if (report_.told != order->command) report_.answered.reset();
  report_.told = order->command;
  send(*order);
}

void BridgeNode::publish_vehicle(Utime now, Outbox& outbox) {
  if (!hears_controller(now) || (now < vehicle_.due(now, kVehiclePeriod) && !has_vehicle_news_)) return;
  sogm_swarm::vehicle_status_t vehicle{};
  vehicle.header = vehicle_headers_.next(now);
  vehicle.armed = report_.controller.armed() ? 1 : 0;
  vehicle.obeys = report_.controller.obeys() ? 1 : 0;
  vehicle.place = report_.controller.place();
  vehicle.battery = battery_;
  outbox.publish(BusId::kOnboard, channel::kVehicleStatus, vehicle);
  vehicle_.done(now);
  has_vehicle_news_ = false;
}

bool BridgeNode::on_clock_step(Utime now, Duration step) {
  follow_clock(now);
  const bool is_led = report_.led_by == LedBy::kSetpoints || report_.led_by == LedBy::kTrajectory;
  // What the broadcast daemon has just committed may still be on its way here.
  if (step == Duration() || !is_led) {
    asked_.reset();
  } else if (!asked_) {
    asked_ = now;
  }
  const bool moves = motion_ && motion_->end_utime() > now;
  if (asked_ && (moves || now < *asked_ + kSetpointTimeout)) return false;
  asked_.reset();
  shift_times(step);
  return true;
}

// A clock that is set back must not make anything wait for the time that was before, nor fly again what was flown.
void BridgeNode::follow_clock(Utime now) {
  if (!start_) start_ = now;
  if (now < now_) shift_times(now - now_);
  now_ = now;
}

void BridgeNode::shift_times(Duration later) {
  for (Utime* const time :
       {&now_, &setpoint_heard_, &announcement_heard_, &sent_utime_, &controlled_utime_, &flight_heard_})
    *time += later;
  for (auto* const time : {&report_.heard_utime, &attitude_heard_, &state_utime_, &start_, &asked_})
    if (*time) **time += later;
  if (motion_) motion_->committed.shift(later), motion_->next.shift(later);
}

// Sends what is due of the committed trajectory; returns when to look again.
Utime BridgeNode::guide(Utime now) {
  if (report_.led_by == LedBy::kNone || report_.led_by == LedBy::kEnded) return kNever;
  const Utime missing = setpoint_heard_ + kSetpointTimeout;
  if (now < missing) return missing;
  if (!motion_) {
    report_.led_by = LedBy::kLost;
    return kNever;
  }
  const Utime gone = std::max(setpoint_heard_, announcement_heard_) + to_duration(config_.timeout_s);
  if (now >= std::max(gone, motion_->end_utime()) + kRest) {
    report_.led_by = LedBy::kEnded;
    return kNever;
  }
  report_.led_by = LedBy::kTrajectory;
  if (now >= sample_.due_on_grid(now, kSamplePeriod)) {
    ++report_.samples;
    send_target(now, motion_->at(now), yaw_rad_, 0.0);
    sample_.done(now);
  }
  return sample_.due_on_grid(now, kSamplePeriod);
}

// In W.
void BridgeNode::send_target(Utime utime, const MotionState& state, double yaw_rad, double yaw_rate) {
  const auto time_ms = static_cast<std::uint32_t>(std::max(utime - *start_, Duration()) / 1ms);
  const MotionState told = fitted(state, config_.fit);
  const bool by_attitude = config_.targets == "attitude";
  sent_utime_ = utime;
  target_ = state.position;
  if (flight_ && now_ - flight_heard_ <= kFlightAge && VehicleOrders::rises_by_itself(report_.controller, *flight_) &&
      config_.arms)
    return;
  const bool knows = state_utime_ && now_ - *state_utime_ <= kStateAge + to_duration(config_.state_delay_s);
  report_.blind = by_attitude && !knows;  // the controller may know
  if (by_attitude && knows) {
    send_attitude(time_ms, fitted(state, {to_seconds(now_ - utime), 0.0, 0.0}), told, yaw_rad, yaw_rate);
  } else {
    send_position(time_ms, told, yaw_rad, yaw_rate);
  }
}

void BridgeNode::send_position(std::uint32_t time_ms, const MotionState& told, double yaw_rad, double yaw_rate) {
  mavlink::SetPositionTargetLocalNed target;
  target.time_boot_ms = time_ms;
  target.position = to_floats(frame_.position_to_ned(told.position));
  target.velocity = to_floats(frame_.to_ned(told.velocity));
  target.acceleration = to_floats(frame_.to_ned(told.acceleration));
  target.yaw = static_cast<float>(frame_.yaw(yaw_rad));
  target.yaw_rate = static_cast<float>(-yaw_rate);
  target.target_system = to_byte(config_.target_system);
  target.target_component = to_byte(config_.target_component);
  send(target);
}

void BridgeNode::send_attitude(std::uint32_t time_ms, const MotionState& wanted, const MotionState& told,
                               double yaw_rad, double yaw_rate) {
  MotionState heard = state_;
  heard.acceleration = wanted.acceleration;  // as far as is known
  const MotionState is = fitted(heard, {to_seconds(now_ - *state_utime_), 0.0, 0.0});
  // On the ground, or led by somebody else, what is amiss says nothing.
  if (!report_.controller.obeys() || report_.controller.place() == sogm_swarm::vehicle_status_t::kOnGround)
    position_controller_.reset();
  const Duration since = std::clamp(now_ - controlled_utime_, Duration(), kSetpointTimeout);
  controlled_utime_ = now_;
  const Eigen::Vector3d thrust = position_controller_.thrust(wanted, told.acceleration, is, to_seconds(since));
  const BodyTarget body = body_of(frame_.to_ned(thrust), frame_.to_ned(told.jerk), frame_.yaw(yaw_rad), -yaw_rate);
  mavlink::SetAttitudeTarget target;
  target.time_boot_ms = time_ms;
  target.turn = {static_cast<float>(body.turn.w()), static_cast<float>(body.turn.x()),
                 static_cast<float>(body.turn.y()), static_cast<float>(body.turn.z())};
  target.rates = to_floats(body.rates);
  target.thrust = static_cast<float>(config_.gains.hover_thrust * thrust.norm() / MotionLimits::kGravity_mps2);
  target.target_system = to_byte(config_.target_system);
  target.target_component = to_byte(config_.target_component);
  send(target);
}

}  // namespace swarm
