// From the ground to the ground: what orders, vehicle, battery and flight space make of a flight.
#include "planner_daemon/coordination/flight_state.h"

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::order_t;
using sogm_swarm::vehicle_status_t;
using Status = FlightState::Status;

// A robot that is at once where it is led to.
class Flight {
 public:
  explicit Flight(const FlightRules& rules = {}, const std::optional<Status>& kept = {})
      : state(rules, MotionLimits(), kept), motion{Trajectory::hover(1, kStart - 1s, {1, 2, 0}), {}} {
    measured.position = {1, 2, 0};
    advance();
  }

  FlightState::Robot robot() const { return {measured, motion, is_ready}; }
  void advance() { state.advance(now, robot()); }
  std::int16_t order(std::int16_t what, double height = 0.0) {
    order_t order{};
    order.header = make_header(0, 5, seq++, now);
    order.order = what;
    order.height = height;
    state.on_order(now, order, robot());
    return state.status().verdict;
  }
  void say_vehicle(bool armed, bool obeys, std::int16_t place, float battery = -1.0f) {
    vehicle.emplace();
    vehicle->armed = armed ? 1 : 0, vehicle->obeys = obeys ? 1 : 0, vehicle->place = place, vehicle->battery = battery;
    state.on_vehicle(now, *vehicle);
    advance();
  }
  // Time goes by: the vehicle is heard, legs are committed, what it is bound to is flown down to the ground at
  // `ground`.
  void fly(double seconds, double ground = 0.0) {
    for (const Utime end = now + to_duration(seconds); now < end; now += 100ms) {
      if (vehicle) state.on_vehicle(now, *vehicle);
      if (state.take_rests_here()) motion = {Trajectory::hover(1, now, measured.position), {}};
      if (const auto leg = state.next_leg(now, motion)) motion = {*leg, {}}, ++legs;
      if (state.status().led_to == Status::kDestination)
        motion = {Trajectory::hover(1, now - 1s, Eigen::Vector3d(state.status().destination)), {}};
      measured = motion.at(now);
      if (measured.position.z() < ground) measured.position.z() = ground, measured.velocity.setZero();
      advance();
    }
  }
  void begin_on_ground() { say_vehicle(false, false, vehicle_status_t::kOnGround); }
  // In the air, at 1.5 m.
  void take_off() {
    begin_on_ground();
    ASSERT_EQ(order(order_t::kTakeOff, 1.5), Status::kAccepted);
    say_vehicle(true, true, vehicle_status_t::kUnknown);
    fly(10.0);
    ASSERT_EQ(state.state(), Status::kFlying);
  }

  FlightState state;
  Motion motion;
  MotionState measured;
  bool is_ready = true;
  Utime now = kStart;
  std::optional<vehicle_status_t> vehicle;
  int legs = 0;
  std::int64_t seq = 0;
};

TEST(FlightState, WithoutAVehicleItFlies) {
  Flight flight;
  flight.fly(20.0);
  EXPECT_EQ(flight.state.state(), Status::kFlying);
  EXPECT_EQ(flight.state.status().led_to, Status::kGoal);
  EXPECT_EQ(flight.order(order_t::kTakeOff, 1.0), Status::kNotNow);
}

TEST(FlightState, TakesOffByLegsThatKeepTheLimits) {
  FlightRules rules;
  rules.space_min = {-9, -9, 2.2};
  rules.space_max = {9, 9, 4.0};
  Flight flight(rules);
  flight.begin_on_ground();
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
  EXPECT_EQ(flight.state.status().led_to, Status::kNowhere);
  EXPECT_EQ(flight.state.status().cause, Status::kVehicle);
  EXPECT_EQ(flight.order(order_t::kTakeOff, 9.0), Status::kAccepted);
  EXPECT_EQ(flight.state.status().order_boot, 5);
  EXPECT_EQ(flight.order(order_t::kTakeOff, 9.0), Status::kAccepted) << "said twice";
  EXPECT_NEAR(flight.state.status().climb, 2.2, 1e-9);
  flight.fly(1.0);
  EXPECT_EQ(flight.legs, 0) << "its motors do not turn";
  flight.say_vehicle(true, true, vehicle_status_t::kOnGround);
  ASSERT_TRUE(flight.state.next_leg(flight.now, flight.motion));
  EXPECT_TRUE(keeps(*flight.state.next_leg(flight.now, flight.motion), MotionLimits()));
  flight.fly(15.0);
  EXPECT_EQ(flight.legs, 3);
  EXPECT_EQ(flight.state.state(), Status::kFlying);
  EXPECT_EQ(flight.state.status().cause, Status::kArrived);
  EXPECT_LT((flight.measured.position - Eigen::Vector3d(1, 2, 4.0)).norm(), 1e-6) << "no higher than the flight space";
}

TEST(FlightState, NobodyTakesOffWhoIsNotReady) {
  Flight flight;
  flight.begin_on_ground();
  flight.is_ready = false;
  EXPECT_EQ(flight.order(order_t::kTakeOff, 1.0), Status::kNotReady);
  flight.is_ready = true;
  flight.say_vehicle(false, false, vehicle_status_t::kOnGround, 0.15f);
  EXPECT_EQ(flight.order(order_t::kTakeOff, 1.0), Status::kNotReady) << "the battery is low";
  flight.now += 3s;
  flight.advance();
  EXPECT_EQ(flight.order(order_t::kTakeOff, 1.0), Status::kNoVehicle) << "it fell silent";
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
}

TEST(FlightState, GivesUpWhereTheVehicleDoesNotArmOrDoesNotRise) {
  Flight flight;
  flight.begin_on_ground();
  ASSERT_EQ(flight.order(order_t::kTakeOff, 1.0), Status::kAccepted);
  flight.fly(14.0);
  EXPECT_EQ(flight.state.state(), Status::kTakeOff);
  flight.fly(2.0);
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
  EXPECT_EQ(flight.state.status().cause, Status::kGaveUp);
  ASSERT_EQ(flight.order(order_t::kTakeOff, 1.0), Status::kAccepted);
  flight.say_vehicle(true, true, vehicle_status_t::kOnGround);
  for (int i = 0; i < 210; ++i) {
    flight.now += 100ms;
    flight.state.on_vehicle(flight.now, *flight.vehicle);
    flight.advance();
  }
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
  EXPECT_EQ(flight.state.status().cause, Status::kGaveUp);
}

TEST(FlightState, LandsWhereItIsAndStands) {
  Flight flight;
  flight.take_off();
  EXPECT_EQ(flight.order(order_t::kLand), Status::kAccepted);
  EXPECT_EQ(flight.state.status().led_to, Status::kDestination);
  EXPECT_NEAR(flight.state.status().destination[2], 0.5, 1e-9);
  flight.fly(2.0);
  EXPECT_EQ(flight.state.status().led_to, Status::kNowhere) << "straight down";
  flight.fly(10.0);
  EXPECT_EQ(flight.state.state(), Status::kOnGround) << "held by the ground for a second";
  EXPECT_EQ(flight.state.status().cause, Status::kArrived);
  // Its motors still turn: that is no take-off by somebody else.
  flight.say_vehicle(true, true, vehicle_status_t::kInAir);
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
  flight.say_vehicle(false, false, vehicle_status_t::kOnGround);
  EXPECT_EQ(flight.state.status().cause, Status::kVehicle);
  flight.say_vehicle(true, true, vehicle_status_t::kInAir);
  EXPECT_EQ(flight.state.state(), Status::kFlying) << "its pilot took off, and hands it over";
}

TEST(FlightState, LandsOnALowerFloorAndAsSoonAsTheVehicleSaysSo) {
  Flight flight;
  flight.take_off();
  ASSERT_EQ(flight.order(order_t::kLand), Status::kAccepted);
  flight.fly(12.0, -2.0);
  EXPECT_EQ(flight.state.state(), Status::kLanding);
  EXPECT_LT(flight.measured.position.z(), -0.5);
  flight.say_vehicle(true, true, vehicle_status_t::kOnGround);
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
}

TEST(FlightState, HoldsGoesOnAndComesHome) {
  Flight flight;
  flight.take_off();
  flight.motion = {Trajectory::hover(1, flight.now, {7, 2, 3}), {}};
  flight.fly(0.5);
  ASSERT_EQ(flight.order(order_t::kHold), Status::kAccepted);
  EXPECT_EQ(flight.state.state(), Status::kHold);
  EXPECT_EQ(Eigen::Vector3d(flight.state.status().destination), Eigen::Vector3d(7, 2, 3));
  ASSERT_EQ(flight.order(order_t::kFly), Status::kAccepted);
  EXPECT_EQ(flight.state.status().led_to, Status::kGoal);
  ASSERT_EQ(flight.order(order_t::kHome), Status::kAccepted);
  EXPECT_EQ(Eigen::Vector3d(flight.state.status().destination), Eigen::Vector3d(1, 2, 3));
  flight.fly(15.0);
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
  EXPECT_LT((flight.measured.position - Eigen::Vector3d(1, 2, 0)).norm(), 0.01);
}

TEST(FlightState, AnEmergencyStopsAndComesDownWithoutThePlanner) {
  Flight flight;
  flight.take_off();
  MotionState from, to;
  from.position = flight.measured.position, from.velocity = {2, 0, 0};
  to.position = from.position + Eigen::Vector3d(4, 0, 0);
  Trajectory fast(1, flight.now, 2s, 1);
  fast.set_knot(0, from), fast.set_knot(1, to);
  flight.motion = {fast, {}};
  ASSERT_EQ(flight.order(order_t::kEmergency), Status::kAccepted);
  EXPECT_EQ(flight.state.status().led_to, Status::kDestination);
  EXPECT_LT(flight.state.status().destination[0], 2.5) << "it brakes at once";
  flight.fly(3.0);
  EXPECT_EQ(flight.state.status().led_to, Status::kNowhere);
  EXPECT_EQ(flight.order(order_t::kHold), Status::kNotNow);
  EXPECT_EQ(flight.order(order_t::kLand), Status::kAccepted);
  EXPECT_EQ(flight.state.state(), Status::kEmergency) << "it comes down already";
  flight.fly(10.0);
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
}

TEST(FlightState, LandingIsCalledOff) {
  Flight flight;
  flight.take_off();
  ASSERT_EQ(flight.order(order_t::kLand), Status::kAccepted);
  flight.fly(2.0);
  ASSERT_EQ(flight.state.status().led_to, Status::kNowhere);
  flight.fly(0.6);
  ASSERT_EQ(flight.order(order_t::kFly), Status::kAccepted);
  EXPECT_EQ(flight.state.state(), Status::kTakeOff);
  flight.fly(10.0);
  EXPECT_EQ(flight.state.state(), Status::kFlying);
  EXPECT_NEAR(flight.measured.position.z(), 0.5, 1e-6);
}

TEST(FlightState, TheBatteryLeadsHomeAndThenDown) {
  Flight flight;
  flight.take_off();
  flight.motion = {Trajectory::hover(1, flight.now, {7, 2, 3}), {}};
  flight.fly(0.5);
  flight.say_vehicle(true, true, vehicle_status_t::kInAir, 0.21f);
  EXPECT_EQ(flight.state.state(), Status::kFlying);
  flight.say_vehicle(true, true, vehicle_status_t::kInAir, 0.19f);
  EXPECT_EQ(flight.state.state(), Status::kHome);
  EXPECT_EQ(flight.state.status().cause, Status::kBattery);
  flight.say_vehicle(true, true, vehicle_status_t::kInAir, 0.09f);
  EXPECT_EQ(flight.state.state(), Status::kLanding);
  EXPECT_EQ(flight.state.status().cause, Status::kBattery);
}

TEST(FlightState, WhoLeavesTheFlightSpaceIsLedHome) {
  FlightRules rules;
  rules.space_min = {-5, -5, 0.3}, rules.space_max = {5, 5, 3};
  Flight flight(rules);
  flight.take_off();
  for (const double x : {5.4, 5.6}) {
    flight.measured.position.x() = x;
    flight.advance();
    EXPECT_EQ(flight.state.state(), x < 5.5 ? Status::kFlying : Status::kHome);
  }
  EXPECT_EQ(flight.state.status().cause, Status::kFence);
  EXPECT_LE(flight.state.status().destination[0], 5.0);
}

// The daemon crashes while a pilot flies the robot.
TEST(FlightState, WhoWasAPilotsHoldsItsPlace) {
  Flight before;
  before.take_off();
  before.say_vehicle(true, false, vehicle_status_t::kInAir);
  ASSERT_EQ(before.state.status().led_to, Status::kNowhere);
  Flight after;
  after.now = before.now, after.motion = before.motion, after.measured = before.measured;
  after.state = FlightState({}, MotionLimits(), before.state.status());
  after.say_vehicle(true, true, vehicle_status_t::kInAir);
  EXPECT_EQ(after.state.state(), Status::kHold);
  EXPECT_EQ(after.state.status().led_to, Status::kDestination);
  after.fly(5.0);
  EXPECT_LT((after.measured.position - before.measured.position).norm(), 0.01);
}

// The daemon crashes and starts again: the flight goes on.
TEST(FlightState, WhatWasKeptGoesOn) {
  for (const std::int16_t what : {order_t::kFly, order_t::kHold, order_t::kHome, order_t::kLand, order_t::kEmergency}) {
    Flight before;
    before.take_off();
    before.motion = {Trajectory::hover(1, before.now, {7, 2, 3}), {}};
    before.fly(0.5);
    ASSERT_EQ(before.order(what), Status::kAccepted);
    if (what == order_t::kLand || what == order_t::kEmergency) before.fly(2.0);
    Flight after({}, before.state.status());
    after.now = before.now;
    after.motion = before.motion;
    after.measured = before.measured;
    after.vehicle = before.vehicle;
    EXPECT_EQ(after.state.state(), before.state.state());
    EXPECT_EQ(after.state.status().led_to, before.state.status().led_to);
    EXPECT_EQ(Eigen::Vector3d(after.state.status().home), Eigen::Vector3d(1, 2, 0));
    before.fly(20.0), after.fly(20.0);
    EXPECT_EQ(after.state.state(), before.state.state());
    EXPECT_LT((after.measured.position - before.measured.position).norm(), 0.01);
  }
}

TEST(FlightState, APilotTakesOverAndHandsBack) {
  for (const bool holds : {false, true}) {
    Flight flight;
    flight.take_off();
    if (holds) flight.order(order_t::kHold);
    flight.say_vehicle(true, false, vehicle_status_t::kInAir, 0.05f);
    EXPECT_EQ(flight.state.state(), Status::kHold);
    EXPECT_EQ(flight.state.status().cause, Status::kVehicle);
    EXPECT_EQ(flight.state.status().led_to, Status::kNowhere);
    EXPECT_EQ(flight.order(order_t::kLand), Status::kNotNow) << "the pilot's";
    flight.say_vehicle(true, true, vehicle_status_t::kInAir);
    EXPECT_EQ(flight.state.state(), holds ? Status::kHold : Status::kFlying);
    EXPECT_EQ(flight.order(order_t::kLand), Status::kAccepted);
  }
}

// A message that cannot be true stops nobody in the air.
TEST(FlightState, NobodyIsDisarmedInTheAir) {
  Flight flight;
  flight.take_off();
  flight.say_vehicle(false, false, vehicle_status_t::kInAir);
  EXPECT_EQ(flight.state.state(), Status::kFlying);
  flight.say_vehicle(false, false, vehicle_status_t::kOnGround);
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
}

// A pilot has armed it on the ground before anything was heard of it, and takes off himself.
TEST(FlightState, WhoStandsArmedDoesNotFly) {
  Flight flight;
  flight.say_vehicle(true, true, vehicle_status_t::kOnGround);
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
  flight.say_vehicle(true, false, vehicle_status_t::kInAir);
  EXPECT_EQ(flight.state.state(), Status::kOnGround);
  flight.say_vehicle(true, true, vehicle_status_t::kInAir);
  EXPECT_EQ(flight.state.state(), Status::kFlying);
}

TEST(FlightState, NewsAreToldOnce) {
  Flight flight;
  EXPECT_TRUE(flight.state.take_news());
  flight.fly(1.0);
  EXPECT_FALSE(flight.state.take_news());
  flight.order(order_t::kHold);
  EXPECT_TRUE(flight.state.take_news());
  EXPECT_FALSE(flight.state.take_news());
}

}  // namespace
}  // namespace swarm::test
