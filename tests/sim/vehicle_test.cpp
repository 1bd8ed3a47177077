// A simulated robot whose flight controller is told what to do another way than on the bus.
#include "swarm_sim/environment/vehicle.h"

#include <cmath>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

constexpr int kRobot = 3;
constexpr double kGravity_mps2 = 9.81;

struct Told {
  Told() : vehicle(kRobot, place, {}, {.kind = "quadrotor"}, "vehicle_test") {
    sogm_swarm::setpoint_t setpoint{};
    setpoint.header = make_header(kRobot, 1, 0, now);
    Eigen::Map<Eigen::Vector3d>(setpoint.position) = place;
    vehicle.on_setpoint(now, encoded(setpoint));
  }
  template <class Tell>
  void fly(double seconds, const Tell& tell) {
    for (int k = 0; k < std::lround(100 * seconds); ++k) {
      tell();
      now += 10ms;
      vehicle.move_to(now);
    }
  }
  Eigen::Vector3d place{0, 0, 1};
  Utime now = kStart;
  Vehicle vehicle;
};

TEST(Vehicle, PushedByThrustItHoldsItsPlaceWhenNobodyTellsAnyMore) {
  Told told;
  told.fly(1.0, [&] { told.vehicle.on_thrust(told.now, {1.0, 0, kGravity_mps2}, 0.7); });
  const Eigen::Vector3d heard_last = told.vehicle.state().position;
  EXPECT_NEAR(heard_last.x(), 0.45, 0.1);
  EXPECT_EQ(told.vehicle.yaw_rad(), 0.7);
  EXPECT_LT((told.vehicle.reference().position - told.place).norm(), 1e-9);  // the bus still says so
  told.fly(0.4, [] {});
  EXPECT_GT(told.vehicle.state().acceleration.x(), 0.5);  // a gap is no end
  told.fly(10.0, [] {});
  EXPECT_LT((told.vehicle.state().position - heard_last).norm(), 0.05);
  EXPECT_LT(told.vehicle.state().velocity.norm(), 0.01);
}

TEST(Vehicle, ToldAPositionItStopsThereWhenNobodyTellsAnyMore) {
  Told told;
  MotionState target;
  target.position = {1, 0, 1};
  target.velocity = {0.5, 0, 0};
  told.vehicle.on_target(told.now, target, 0.0);
  told.fly(10.0, [] {});
  EXPECT_LT((told.vehicle.state().position - target.position).norm(), 0.05);
}

}  // namespace
}  // namespace swarm::test
