#include "tools/bridge/bridge_node.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/limits.h"

namespace swarm {
namespace {

constexpr std::int64_t kSecond_us = 1'000'000;
constexpr std::int64_t kHeartbeatPeriod_us = kSecond_us;
constexpr std::int64_t kSetpointAge_us = 50'000;      // older ones are of no use
constexpr std::int64_t kSetpointTimeout_us = 50'000;  // without any: the committed trajectory
constexpr std::int64_t kSamplePeriod_us = 10'000;
constexpr std::int64_t kAnnouncementAge_us = kSecond_us;
constexpr std::int64_t kRest_us = kSecond_us;  // how long the place of rest is sent after all has ended
constexpr std::int64_t kAttitudeAge_us = kSecond_us / 2;
constexpr std::int32_t kRestart_ms = 1000;  // no message is that late
constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

std::int64_t to_us(double seconds) {
  return std::llround(1e6 * seconds);
}

// False for NaN.
bool within(const Eigen::Vector3d& values, double bound) {
  return (values.array().abs() <= bound).all();
}

std::array<float, 3> to_floats(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

Eigen::Vector3d to_vector(const std::array<float, 3>& values) {
  return Eigen::Vector3f::Map(values.data()).cast<double>();
}

std::uint8_t to_byte(int id) {
  return static_cast<std::uint8_t>(id);
}

}  // namespace

void declare(OptionSet& options, BridgeConfig& config) {
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("target-system", &config.target_system, 1, 255, "", "MAVLink system id of the flight controller");
  options.add("target-component", &config.target_component, 0, 255, "",
              "MAVLink component id of the flight controller; 0: any");
  options.add("system-id", &config.system_id, 0, 255, "", "MAVLink system id of this bridge; 0: the controller's");
  options.add("component-id", &config.component_id, 1, 255, "", "MAVLink component id of this bridge");
  options.add("north", &config.north_rad, -6.3, 6.3, "rad", "yaw of north in W; 0: W's x axis points north");
  options.add("origin", &config.origin, -1e5, 1e5, "m", "of the flight controller's local frame, in W");
  options.add("state-delay", &config.state_delay_s, 0, 1, "s", "from a state's measurement to its arrival here");
  options.add("publish-state", &config.publish_state, "publish ROBOT_STATE; false: somebody else does");
  options.add("timeout", &config.timeout_s, 0.1, 60, "s",
              "without setpoint and announcement: then the committed trajectory is flown to its end, and no further");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s",
              "the robot's own messages from further in the future are refused");
}

mavlink::Sender bridge_of(const BridgeConfig& config) {
  return {to_byte(config.system_id != 0 ? config.system_id : config.target_system), to_byte(config.component_id)};
}

mavlink::Sender controller_of(const BridgeConfig& config) {
  return {to_byte(config.target_system), to_byte(config.target_component)};
}

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
      state_headers_(config.robot_id, boot) {}

std::vector<Subscription> BridgeNode::subscriptions() const {
  return {{BusId::kOnboard, channel::kSetpoint}, {BusId::kOnboard, channel::kOwnTrajectory}};
}

void BridgeNode::on_message(std::int64_t now_us, BusId, std::string_view channel, std::span<const std::uint8_t> bytes,
                            Outbox&) {
  follow_clock(now_us);
  Refusal refusal = Refusal::kNone;
  if (channel == channel::kSetpoint) {
    refusal = on_setpoint(now_us, bytes);
  } else if (channel == channel::kOwnTrajectory) {
    refusal = on_announcement(now_us, bytes);
  }
  if (refusal != Refusal::kNone) report_.refused.count(refusal);
}

TimeWindow BridgeNode::window(std::int64_t now_us, std::int64_t max_age_us) const {
  return {now_us, max_age_us, to_us(config_.clock_limit_s)};
}

Refusal BridgeNode::on_setpoint(std::int64_t now_us, std::span<const std::uint8_t> bytes) {
  sogm_swarm::setpoint_t setpoint;
  const auto sane_and_in_order = [this](const sogm_swarm::setpoint_t& m) {
    const bool sane =
        within(Eigen::Vector3d(m.position), kMaxPosition_m) && within(Eigen::Vector3d(m.velocity), kMaxVelocity_mps) &&
        within(Eigen::Vector3d(m.acceleration), kMaxAcceleration_mps2) && std::abs(m.yaw_rate) <= kMaxVelocity_mps;
    return sane ? setpoint_gate_.pass(m.header) : Refusal::kValue;
  };
  const Refusal refusal =
      receive(bytes, FromRobot{config_.robot_id}, window(now_us, kSetpointAge_us), sane_and_in_order, &setpoint);
  if (refusal != Refusal::kNone) return refusal;
  const std::int64_t utime = setpoint.header.utime;
  const MotionState state{Eigen::Vector3d(setpoint.position), Eigen::Vector3d(setpoint.velocity),
                          Eigen::Vector3d(setpoint.acceleration), Eigen::Vector3d(setpoint.jerk)};
  setpoint_heard_us_ = now_us;
  yaw_ = setpoint.yaw;
  // The committed trajectory may have been sampled beyond it meanwhile: the robot is never led backwards.
  if (utime <= sent_utime_ && utime >= sent_utime_ - kSetpointAge_us) {
    ++report_.late;
  } else {
    ++report_.setpoints;
    send_target(utime, state, setpoint.yaw, setpoint.yaw_rate);
  }
  report_.led_by = LedBy::kSetpoints;
  return Refusal::kNone;
}

Refusal BridgeNode::on_announcement(std::int64_t now_us, std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  const Refusal refusal =
      receive(bytes, FromRobot{config_.robot_id}, window(now_us, kAnnouncementAge_us), announcement_gate_, &message);
  if (refusal != Refusal::kNone) return refusal;
  const Motion motion = motion_of(message);
  if (motion.committed.empty()) return Refusal::kInconsistent;
  motion_ = motion;
  announcement_heard_us_ = now_us;
  return Refusal::kNone;
}

void BridgeNode::on_frame(std::int64_t now_us, const mavlink::Message& message, Outbox& outbox) {
  follow_clock(now_us);
  if (const auto* const heartbeat = std::get_if<mavlink::Heartbeat>(&message)) on_controller(now_us, *heartbeat);
  if (const auto* const attitude = std::get_if<mavlink::Attitude>(&message)) on_controller(now_us, *attitude);
  if (const auto* const local = std::get_if<mavlink::LocalPositionNed>(&message)) on_controller(now_us, *local, outbox);
}

void BridgeNode::on_controller(std::int64_t now_us, const mavlink::Heartbeat& heartbeat) {
  if (heartbeat.autopilot == mavlink::Heartbeat::kNone) return;  // a camera, say
  report_.heartbeat_us = now_us;
  report_.heartbeat = heartbeat;
}

void BridgeNode::on_controller(std::int64_t now_us, const mavlink::Attitude& attitude) {
  if (!pass(&attitude_clock_, attitude.time_boot_ms)) return;
  if (!(std::abs(attitude.yaw) <= kMaxVelocity_mps)) return refuse(StateRefusal::kValue);
  attitude_us_ = now_us;
  attitude_yaw_ = frame_.yaw(attitude.yaw);
}

void BridgeNode::on_controller(std::int64_t now_us, const mavlink::LocalPositionNed& local, Outbox& outbox) {
  if (!pass(&position_clock_, local.time_boot_ms)) return;
  const Eigen::Vector3d position = frame_.position_to_world(to_vector(local.position));
  const Eigen::Vector3d velocity = frame_.to_world(to_vector(local.velocity));
  if (!within(position, kMaxPosition_m) || !within(velocity, kMaxVelocity_mps)) return refuse(StateRefusal::kValue);
  if (target_) report_.off_m = (position - *target_).norm();
  if (!attitude_us_ || now_us - *attitude_us_ > kAttitudeAge_us) return refuse(StateRefusal::kNoAttitude);
  if (!config_.publish_state) return;
  sogm_swarm::robot_state_t state{};
  state.header = state_headers_.next(now_us - to_us(config_.state_delay_s));
  Eigen::Map<Eigen::Vector3d>(state.position) = position;
  Eigen::Map<Eigen::Vector3d>(state.velocity) = velocity;
  state.yaw = attitude_yaw_;
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
    attitude_us_.reset();
    (void)clock->pass(time_ms);
  }
  return true;
}

std::int64_t BridgeNode::step(std::int64_t now_us, Outbox&) {
  follow_clock(now_us);
  if (now_us >= heartbeat_.due_us(now_us, kHeartbeatPeriod_us)) {
    mavlink::Heartbeat heartbeat;
    heartbeat.type = mavlink::Heartbeat::kOnboardController;
    heartbeat.autopilot = mavlink::Heartbeat::kNone;
    heartbeat.system_status = mavlink::Heartbeat::kActive;
    send(heartbeat);
    heartbeat_.done(now_us);
  }
  return std::max(now_us + 1, std::min(heartbeat_.due_us(now_us, kHeartbeatPeriod_us), guide(now_us)));
}

bool BridgeNode::on_clock_step(std::int64_t now_us, std::int64_t step_us) {
  follow_clock(now_us);
  const bool is_led = report_.led_by == LedBy::kSetpoints || report_.led_by == LedBy::kTrajectory;
  // What the broadcast daemon has just committed may still be on its way here.
  if (step_us == 0 || !is_led) {
    asked_us_.reset();
  } else if (!asked_us_) {
    asked_us_ = now_us;
  }
  const bool moves = motion_ && motion_->end_utime() > now_us;
  if (asked_us_ && (moves || now_us < *asked_us_ + kSetpointTimeout_us)) return false;
  asked_us_.reset();
  shift_times(step_us);
  return true;
}

// A clock that is set back must not make anything wait for the time that was before, nor fly again what was flown.
void BridgeNode::follow_clock(std::int64_t now_us) {
  if (!start_us_) start_us_ = now_us;
  if (now_us < now_us_) shift_times(now_us - now_us_);
  now_us_ = now_us;
}

void BridgeNode::shift_times(std::int64_t later_us) {
  for (std::int64_t* const time : {&now_us_, &setpoint_heard_us_, &announcement_heard_us_, &sent_utime_})
    *time += later_us;
  for (auto* const time : {&report_.heartbeat_us, &attitude_us_, &start_us_, &asked_us_})
    if (*time) **time += later_us;
  if (motion_) motion_->committed.shift(later_us), motion_->next.shift(later_us);
}

// Sends what is due of the committed trajectory; returns when to look again.
std::int64_t BridgeNode::guide(std::int64_t now_us) {
  if (report_.led_by == LedBy::kNone || report_.led_by == LedBy::kEnded) return kNever;
  const std::int64_t missing_us = setpoint_heard_us_ + kSetpointTimeout_us;
  if (now_us < missing_us) return missing_us;
  if (!motion_) {
    report_.led_by = LedBy::kLost;
    return kNever;
  }
  const std::int64_t gone_us = std::max(setpoint_heard_us_, announcement_heard_us_) + to_us(config_.timeout_s);
  if (now_us >= std::max(gone_us, motion_->end_utime()) + kRest_us) {
    report_.led_by = LedBy::kEnded;
    return kNever;
  }
  report_.led_by = LedBy::kTrajectory;
  if (now_us >= sample_.due_on_grid_us(now_us, kSamplePeriod_us)) {
    ++report_.samples;
    send_target(now_us, motion_->at(now_us), yaw_, 0.0);
    sample_.done(now_us);
  }
  return sample_.due_on_grid_us(now_us, kSamplePeriod_us);
}

// In W.
void BridgeNode::send_target(std::int64_t utime, const MotionState& state, double yaw_rad, double yaw_rate) {
  mavlink::SetPositionTargetLocalNed target;
  target.time_boot_ms = static_cast<std::uint32_t>(std::max<std::int64_t>(utime - *start_us_, 0) / 1000);
  target.position = to_floats(frame_.position_to_ned(state.position));
  target.velocity = to_floats(frame_.to_ned(state.velocity));
  target.acceleration = to_floats(frame_.to_ned(state.acceleration));
  target.yaw = static_cast<float>(frame_.yaw(yaw_rad));
  target.yaw_rate = static_cast<float>(-yaw_rate);
  target.target_system = to_byte(config_.target_system);
  target.target_component = to_byte(config_.target_component);
  send(target);
  sent_utime_ = utime;
  target_ = state.position;
}

}  // namespace swarm
