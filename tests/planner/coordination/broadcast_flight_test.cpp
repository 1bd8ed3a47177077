// The broadcast daemon's node from the ground to the ground: its robot's vehicle is at once where setpoints lead it.
#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

using sogm_swarm::flight_status_t;
using sogm_swarm::order_t;
using sogm_swarm::setpoint_t;
using sogm_swarm::vehicle_status_t;

// Robot 1 on the ground at (0, 0, 0), under a planner that goes at once where it is told to.
class Flyer : public Robot {
 public:
  Flyer() : Robot(1, false) {
    say();
    for (auto& [other, peer] : peers) hear(other);
  }

  flight_status_t status() const { return out.newest<flight_status_t>(channel::kFlightStatus); }
  Eigen::Vector3d place() const { return node.motion()->at(now).position; }
  void order(std::int16_t what, double height = 0.0) {
    order_t order{};
    order.header = make_header(1, 1, next_++, now);
    order.order = what;
    order.height = height;
    send(channel::kFlightOrder, order);
  }
  void say() {
    vehicle_status_t vehicle{};
    vehicle.header = make_header(1, 1, next_++, now);
    vehicle.armed = armed ? 1 : 0;
    vehicle.obeys = armed ? 1 : 0;
    vehicle.place = at.z() < 0.01 ? vehicle_status_t::kOnGround : vehicle_status_t::kInAir;
    vehicle.battery = -1.0f;
    send(channel::kVehicleStatus, vehicle);
    send(channel::kRobotState, state_at(1, at, next_++, now));
  }
  // The robots answer all that is announced; the vehicle follows, above the ground.
  void fly(double seconds) {
    for (const Utime end = now + to_duration(seconds); now < end;) {
      run_for(0.05);
      const announcement_t own = announced();
      const bool has_heard = own.pending_state == announcement_t::kAnnounced;
      for (const int other : {0, 2}) {
        if (has_heard && (answers || other == 2))
          hear_verdict(other, own.pending.seq, ack_t::kAck);
        else
          hear(other);
      }
      at = place().cwiseMax(Eigen::Vector3d(-1e5, -1e5, 0));
      if (!armed) at.z() = 0.0;
      say();
      if (status().led_to == flight_status_t::kDestination && now >= planned_ + 3s) {
        propose(plan(Eigen::Vector3d(status().destination), 0.2, 2.0));
        planned_ = now;
      }
    }
  }
  void take_off() {
    order(order_t::kTakeOff, 1.5);
    armed = true;
    fly(12.0);
    ASSERT_EQ(status().state, flight_status_t::kFlying);
  }

  Eigen::Vector3d at = Eigen::Vector3d::Zero();
  bool armed = false, answers = true;

 private:
  std::int64_t next_ = 0;
  Utime planned_{};
};

TEST(BroadcastFlight, OnTheGroundNothingIsCommitted) {
  Flyer flyer;
  flyer.fly(1.0);
  EXPECT_EQ(flyer.status().state, flight_status_t::kOnGround);
  EXPECT_EQ(flyer.status().led_to, flight_status_t::kNowhere);
  EXPECT_EQ(flyer.status().order_boot, -1);
  flyer.propose(flyer.plan({1, 0, 1}));
  flyer.propose(flyer.plan({1, 0, 1}), true);
  EXPECT_EQ(flyer.node.rejected(Rejection::kNotLed), 2);
  EXPECT_EQ(flyer.out.newest<broadcast_status_t>(channel::kBroadcastStatus).state, broadcast_status_t::kFlying);
}

TEST(BroadcastFlight, TakesOffAndLands) {
  Flyer flyer;
  flyer.fly(1.0);
  flyer.take_off();
  EXPECT_EQ(flyer.node.protocol().forced(), 0) << "it stood where it was bound to be";
  EXPECT_NEAR(flyer.place().z(), 1.5, 0.05);
  EXPECT_EQ(flyer.status().led_to, flight_status_t::kGoal);
  flyer.propose(flyer.plan({1, 0, 1}));
  EXPECT_EQ(flyer.node.rejected(Rejection::kNotLed), 0);
  flyer.order(order_t::kLand);
  EXPECT_EQ(flyer.status().state, flight_status_t::kLanding);
  EXPECT_EQ(flyer.status().order_boot, 1);
  flyer.fly(15.0);
  EXPECT_EQ(flyer.status().state, flight_status_t::kOnGround);
  EXPECT_NEAR(flyer.place().z(), 0.0, 0.03) << "bound to be where it stands";
  EXPECT_EQ(flyer.out.newest<setpoint_t>(channel::kSetpoint).velocity[2], 0.0);
}

// The way up is asked for like any other.
TEST(BroadcastFlight, NobodyRisesIntoAnother) {
  Flyer flyer;
  flyer.peers.at(0).committed = Trajectory::hover(2, flyer.now, {0, 0, 0.6});
  flyer.fly(1.0);
  flyer.order(order_t::kTakeOff, 1.5);
  flyer.armed = true;
  flyer.fly(5.0);
  EXPECT_EQ(flyer.status().state, flight_status_t::kTakeOff);
  EXPECT_EQ(flyer.place().z(), 0.0);
  flyer.peers.at(0).committed = Trajectory::hover(3, flyer.now, {5, 0, 0.6});
  flyer.fly(10.0);
  EXPECT_EQ(flyer.status().state, flight_status_t::kFlying);
}

TEST(BroadcastFlight, WithoutAnAnswerNobodyRises) {
  Flyer flyer;
  flyer.fly(1.0);
  flyer.answers = false;
  flyer.order(order_t::kTakeOff, 1.5);
  flyer.armed = true;
  flyer.fly(5.0);
  EXPECT_EQ(flyer.place().z(), 0.0);
  flyer.answers = true;
  flyer.fly(2.0);
  EXPECT_GT(flyer.place().z(), 0.1);
}

TEST(BroadcastFlight, OrdersOfOthersAndOldOnesAreRefused) {
  Flyer flyer;
  flyer.fly(1.0);
  const auto refused = [&](Refusal refusal) { return flyer.node.refused()[refusal]; };
  order_t order{};
  order.order = order_t::kHold;
  order.header = make_header(2, 9, 0, flyer.now);
  flyer.send(channel::kFlightOrder, order);
  EXPECT_EQ(refused(Refusal::kRobot), 1);
  order.header = make_header(1, 9, 0, flyer.now - 1001ms);
  flyer.send(channel::kFlightOrder, order);
  EXPECT_EQ(refused(Refusal::kTime), 1);
  order.header = make_header(1, 9, 0, flyer.now);
  flyer.send(channel::kFlightOrder, order);
  EXPECT_EQ(flyer.status().verdict, flight_status_t::kNotNow);
  EXPECT_EQ(flyer.status().order_boot, 9);
  flyer.send(channel::kFlightOrder, order);
  EXPECT_EQ(refused(Refusal::kSequence), 1);
}

}  // namespace
}  // namespace swarm::test
