#include "planner_daemon/coordination/flight_state.h"

#include <algorithm>
#include <cmath>

namespace swarm {
namespace {

using sogm_swarm::order_t;
using sogm_swarm::vehicle_status_t;
using Status = FlightState::Status;

constexpr double kLeastHeight_m = 0.5;  // over the ground where it stood, to be led by the planner
constexpr double kLeg_m = 1.0;          // of the ways straight up and down
constexpr Duration kLead = 300ms;       // from a leg's proposal to its beginning
constexpr double kThere_m = 0.3, kThere_mps = 0.1;
constexpr double kStands_m = 0.3, kStands_mps = 0.1;  // so far above its motion and so slow, it is held by something
constexpr Duration kStands = 1s;                      // for so long
constexpr Duration kArming = 15s, kRising = 20s, kBraking = 5s;
constexpr double kRisen_m = 0.2;

// Straight from rest to rest: the quintic of least jerk, whose velocity peaks at 15/8 of its mean, acceleration at
// 10/sqrt(3) and jerk at 60 of what its way and duration make.
Trajectory leg(Utime start, const Eigen::Vector3d& from, double to_z, double v_mps, const MotionLimits& limits) {
  const double way_m = std::abs(to_z - from.z());
  double duration_s = std::max({0.5, 1.875 * way_m / std::min(v_mps, limits.v_max_mps),
                                std::sqrt(5.78 * way_m / (0.5 * limits.axis_mps2().z()))});
  if (limits.limits_jerk()) duration_s = std::max(duration_s, std::cbrt(60.0 * way_m / limits.j_max_mps3));
  Trajectory leg(1, start, to_duration(duration_s), 1);
  MotionState state;
  state.position = from;
  leg.set_knot(0, state);
  state.position.z() = to_z;
  leg.set_knot(1, state);
  return leg;
}

}  // namespace

const char* name_of_flight_state(std::int16_t state) {
  switch (state) {
    case Status::kOnGround:
      return "on the ground";
    case Status::kTakeOff:
      return "taking off";
    case Status::kFlying:
      return "flying";
    case Status::kHold:
      return "holding its place";
    case Status::kHome:
      return "flying home";
    case Status::kLanding:
      return "landing";
    default:
      return "emergency: coming down";
  }
}

std::string text_of_flight(const Status& flight) {
  std::string text = name_of_flight_state(flight.state);
  if (flight.cause == Status::kBattery) text += ": the battery is low";
  if (flight.cause == Status::kFence) text += ": it left the flight space";
  if (flight.cause == Status::kGaveUp) text += ": the vehicle did not arm or did not rise";
  return text;
}

FlightState::FlightState(const FlightRules& rules, const MotionLimits& limits, const std::optional<Status>& kept)
    : rules_(rules), limits_(limits) {
  if (!kept) return;
  status_ = *kept;
  home_ = Eigen::Vector3d(kept->home);
  destination_ = kept->led_to == Status::kDestination ? Eigen::Vector3d(kept->destination) : *home_;
  if (state() == Status::kTakeOff) destination_.z() = std::max(destination_.z(), lowest_m());
  phase_ = kept->led_to == Status::kNowhere ? Phase::kVertical : Phase::kPlanned;
}

void FlightState::on_vehicle(Utime now, const vehicle_status_t& vehicle) {
  const bool is_first = !vehicle_heard_;
  vehicle_heard_ = now;
  vehicle_ = vehicle;
  const bool seems_to_fly = state() == Status::kFlying || state() == Status::kHold || state() == Status::kHome;
  if (is_first && seems_to_fly && vehicle.place == vehicle_status_t::kOnGround) {
    stand(now, Status::kVehicle);
    may_be_handed_over_ = true;
  }
  if (vehicle.armed == 0 && status_.state == Status::kOnGround) {
    may_be_handed_over_ = true;
    if (status_.cause != Status::kGaveUp && status_.cause != Status::kVehicle) {
      status_.cause = Status::kVehicle;
      news_ = true;
    }
  }
}

void FlightState::on_order(Utime now, const order_t& order, const Robot& robot) {
  answer(order, obey(now, order, robot));
}

void FlightState::answer(const order_t& order, std::int16_t verdict) {
  status_.order_boot = order.header.boot;
  status_.order_seq = order.header.seq;
  status_.verdict = verdict;
  news_ = true;
}

std::int16_t FlightState::obey(Utime now, const order_t& order, const Robot& robot) {
  if (before_pilot_) return Status::kNotNow;
  const bool stands = state() == Status::kOnGround;
  const bool arms = state() == Status::kTakeOff && phase_ == Phase::kArming;
  switch (order.order) {
    case order_t::kTakeOff:
      return take_off(now, order.height, robot);
    case order_t::kFly:
      if (stands || arms || (state() == Status::kTakeOff && is_vertical())) return Status::kNotNow;
      if (is_vertical()) {  // on its way down: up again
        Eigen::Vector3d above = robot.measured.position;
        above.z() = lowest_m();
        go(now, Status::kTakeOff, Status::kOrdered, Phase::kVertical, above);
      } else if (state() != Status::kFlying) {
        go(now, Status::kFlying, Status::kOrdered, Phase::kPlanned);
      }
      return Status::kAccepted;
    case order_t::kHold:
    case order_t::kHome:
      if (stands || arms || is_vertical()) return Status::kNotNow;
      if (order.order == order_t::kHold && state() != Status::kHold)
        go(now, Status::kHold, Status::kOrdered, Phase::kPlanned, stop_place(now, robot));
      if (order.order == order_t::kHome && state() != Status::kHome) go_home(now, Status::kOrdered, robot);
      return Status::kAccepted;
    default: {  // kLand, kEmergency
      const std::int16_t down = order.order == order_t::kLand ? Status::kLanding : Status::kEmergency;
      if (stands || state() == down || state() == Status::kEmergency) return Status::kAccepted;
      if (arms) {
        stand(now, Status::kOrdered);
      } else if (is_vertical()) {
        go(now, down, Status::kOrdered, Phase::kVertical);
      } else if (down == Status::kLanding) {
        land(now, Status::kOrdered, robot);
      } else {
        go(now, down, Status::kOrdered, Phase::kPlanned, stop_place(now, robot));
      }
      return Status::kAccepted;
    }
  }
}

std::int16_t FlightState::take_off(Utime now, double height_m, const Robot& robot) {
  if (state() == Status::kTakeOff) return Status::kAccepted;
  if (state() != Status::kOnGround) return Status::kNotNow;
  if (!hears_vehicle(now)) return Status::kNoVehicle;
  const bool is_low = vehicle_.battery >= 0.0f && vehicle_.battery < static_cast<float>(rules_.battery_home);
  if (!robot.is_ready || is_low) return Status::kNotReady;
  set_home(robot.measured.position);
  rests_here_ = true;
  Eigen::Vector3d above = *home_;
  above.z() = std::clamp(above.z() + height_m, lowest_m(), std::max(lowest_m(), rules_.space_max.z()));
  go(now, Status::kTakeOff, Status::kOrdered, Phase::kArming, above);
  return Status::kAccepted;
}

void FlightState::go(Utime now, std::int16_t state, std::int16_t cause, Phase phase,
                     const Eigen::Vector3d& destination) {
  destination_ = destination;
  go(now, state, cause, phase);
}

void FlightState::go(Utime now, std::int16_t state, std::int16_t cause, Phase phase) {
  status_.state = state;
  status_.cause = cause;
  phase_ = phase;
  since_ = now;
  stands_since_.reset();
  const bool is_planned = state != Status::kOnGround && phase == Phase::kPlanned;
  status_.led_to = !is_planned ? Status::kNowhere : state == Status::kFlying ? Status::kGoal : Status::kDestination;
  Eigen::Map<Eigen::Vector3d> told(status_.destination);
  told.setZero();
  if (status_.led_to == Status::kDestination) told = destination_;
  status_.climb = state == Status::kTakeOff && home_ ? std::max(0.0, lowest_m() - home_->z()) : 0.0;
  news_ = true;
}

void FlightState::set_home(const Eigen::Vector3d& place) {
  home_ = place;
  Eigen::Map<Eigen::Vector3d>(status_.home) = place;
}

void FlightState::stand(Utime now, std::int16_t cause) {
  before_pilot_.reset();
  go(now, Status::kOnGround, cause, Phase::kVertical);
  may_be_handed_over_ = false;
  rests_here_ = true;
}

void FlightState::land(Utime now, std::int16_t cause, const Robot& robot) {
  Eigen::Vector3d low = stop_place(now, robot);
  low.z() = lowest_m();
  go(now, Status::kLanding, cause, Phase::kPlanned, low);
}

void FlightState::go_home(Utime now, std::int16_t cause, const Robot& robot) {
  Eigen::Vector3d above = *home_;
  above.z() = stop_place(now, robot).z();
  go(now, Status::kHome, cause, Phase::kPlanned, above);
}

void FlightState::advance(Utime now, const Robot& robot) {
  if (!home_) set_home(robot.measured.position);
  if (since_ == Utime()) since_ = now;
  since_ = std::min(since_, now);  // the clock may have been set back
  if (stands_since_) stands_since_ = std::min(*stands_since_, now);
  if (state() == Status::kHold && !is_led_by_planner() && !before_pilot_)  // a pilot had it when the daemon crashed
    go(now, Status::kHold, Status::kVehicle, Phase::kPlanned, stop_place(now, robot));
  if (hears_vehicle(now)) follow_vehicle(now, robot);
  if (state() == Status::kOnGround) set_home(robot.measured.position);
  guard(now, robot);
  go_on(now, robot);
}

void FlightState::follow_vehicle(Utime now, const Robot& robot) {
  const bool arms = state() == Status::kTakeOff && phase_ == Phase::kArming;
  const bool is_led = state() != Status::kOnGround && !arms;
  if (is_led && vehicle_.armed != 0 && vehicle_.obeys == 0) {
    if (!before_pilot_) {
      before_pilot_ = state();
      go(now, Status::kHold, Status::kVehicle, Phase::kPlanned, robot.measured.position);
      status_.led_to = Status::kNowhere;
      Eigen::Map<Eigen::Vector3d>(status_.destination).setZero();
    }
  } else if (before_pilot_ && vehicle_.obeys != 0) {
    const bool flew = std::exchange(before_pilot_, std::nullopt) == Status::kFlying;
    go(now, flew ? Status::kFlying : Status::kHold, Status::kVehicle, Phase::kPlanned, stop_place(now, robot));
  }
  const bool is_off = vehicle_.armed == 0 && vehicle_.place != vehicle_status_t::kInAir;  // else it cannot be true
  if (is_off && state() != Status::kOnGround && !arms) {
    stand(now, Status::kVehicle);
    may_be_handed_over_ = true;
  }
  // Somebody else took off, and hands it over.
  if (state() == Status::kOnGround && may_be_handed_over_ && vehicle_.obeys != 0 &&
      vehicle_.place != vehicle_status_t::kOnGround)
    go(now, Status::kFlying, Status::kVehicle, Phase::kPlanned);
}

void FlightState::guard(Utime now, const Robot& robot) {
  if (before_pilot_) return;
  const bool roams = state() == Status::kFlying || state() == Status::kHold;
  if (!roams && state() != Status::kHome) return;
  const double battery = hears_vehicle(now) && vehicle_.battery >= 0.0f ? vehicle_.battery : 1.0;
  if (battery < rules_.battery_land) return land(now, Status::kBattery, robot);
  const Eigen::Array3d place = robot.measured.position.array();
  const bool is_outside = (place < rules_.space_min.array() - rules_.fence_m).any() ||
                          (place > rules_.space_max.array() + rules_.fence_m).any();
  if (!roams || (battery >= rules_.battery_home && !is_outside)) return;
  go_home(now, is_outside ? Status::kFence : Status::kBattery, robot);
}

void FlightState::go_on(Utime now, const Robot& robot) {
  const Duration since = now - since_;
  const bool rests = robot.motion.end_utime() <= now;
  switch (state()) {
    case Status::kTakeOff:
      if (phase_ == Phase::kArming) {
        const bool is_led = hears_vehicle(now) && vehicle_.obeys != 0;
        if (is_led) go(now, Status::kTakeOff, status_.cause, Phase::kVertical);
        if (!is_led && since > kArming) stand(now, Status::kGaveUp);
      } else if (phase_ == Phase::kVertical) {
        if (rests && robot.motion.at(now).position.z() >= lowest_m() - 0.02)
          go(now, Status::kTakeOff, status_.cause, Phase::kPlanned);
        else if (since > kRising && robot.measured.position.z() < home_->z() + kRisen_m)
          stand(now, Status::kGaveUp);
      } else if (is_there(robot, now) || since > kRising) {
        go(now, Status::kFlying, Status::kArrived, Phase::kPlanned);
      }
      return;
    case Status::kHome:
      if (is_there(robot, now)) land(now, status_.cause, robot);
      return;
    case Status::kLanding:
    case Status::kEmergency: {
      const bool is_planned = phase_ == Phase::kPlanned;
      const bool is_low =
          state() == Status::kLanding ? is_there(robot, now) : (rests && since >= kLead) || since > kBraking;
      if (is_planned && is_low) go(now, state(), status_.cause, Phase::kVertical);
      if (!is_planned && touches_ground(now, robot)) stand(now, Status::kArrived);
      return;
    }
    default:
      return;
  }
}

bool FlightState::touches_ground(Utime now, const Robot& robot) {
  if (hears_vehicle(now) && vehicle_.place == vehicle_status_t::kOnGround) return true;
  const bool stands = robot.measured.position.z() - robot.motion.at(now).position.z() > kStands_m &&
                      std::abs(robot.measured.velocity.z()) < kStands_mps;
  if (!stands) stands_since_.reset();
  if (stands && !stands_since_) stands_since_ = now;
  return stands_since_ && now - *stands_since_ >= kStands;
}

Eigen::Vector3d FlightState::stop_place(Utime now, const Robot& robot) const {
  const MotionState state = robot.motion.at(now);
  const double braking_s = state.velocity.cwiseAbs().maxCoeff() / limits_.stopping_mps2();
  Eigen::Vector3d place = state.position + 0.5 * braking_s * state.velocity;
  place.z() = std::max(place.z(), lowest_m());
  return place.cwiseMax(rules_.space_min).cwiseMin(rules_.space_max);
}

double FlightState::lowest_m() const {
  const double over_ground = home_->z() + kLeastHeight_m;
  return std::min(std::max(over_ground, rules_.space_min.z()), std::max(over_ground, rules_.space_max.z()));
}

bool FlightState::is_vertical() const {
  const bool goes = state() == Status::kTakeOff || state() == Status::kLanding || state() == Status::kEmergency;
  return goes && phase_ == Phase::kVertical;
}

bool FlightState::is_there(const Robot& robot, Utime now) const {
  return robot.motion.at(now).velocity.norm() <= kThere_mps &&
         (robot.measured.position - destination_).norm() <= kThere_m;
}

std::optional<Trajectory> FlightState::next_leg(Utime now, const Motion& motion) const {
  if (!is_vertical() || motion.end_utime() > now) return std::nullopt;
  const Eigen::Vector3d from = motion.at(now).position;
  const double way_m = state() == Status::kTakeOff ? std::min(lowest_m() - from.z(), kLeg_m) : -kLeg_m;
  if (state() == Status::kTakeOff && way_m < 0.01) return std::nullopt;
  return leg(now + kLead, from, from.z() + way_m, rules_.vertical_mps, limits_);
}

void FlightState::shift(Duration later) {
  since_ += later;
  if (vehicle_heard_) *vehicle_heard_ += later;
  if (stands_since_) *stands_since_ += later;
}

}  // namespace swarm
