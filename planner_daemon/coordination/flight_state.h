// Where a robot is in its flight, from the ground to the ground: what orders, its vehicle, its battery and the flight
// space make of it, and who leads it. Knows neither bus nor clock.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "planner_daemon/trajectory/motion.h"
#include "planner_daemon/trajectory/motion_limits.h"
#include "sogm_swarm/flight_status_t.hpp"
#include "sogm_swarm/order_t.hpp"
#include "sogm_swarm/vehicle_status_t.hpp"

namespace swarm {

// In words: "on the ground", "landing".
const char* name_of_flight_state(std::int16_t state);
// The same, and what led to it: "flying home: the battery is low".
std::string text_of_flight(const sogm_swarm::flight_status_t& flight);

struct FlightRules {
  // Flight space of the robot's centre, W [m]; by so much it may be left before the robot turns home.
  Eigen::Vector3d space_min = Eigen::Vector3d::Constant(-1e5), space_max = Eigen::Vector3d::Constant(1e5);
  double fence_m = 0.5;
  double vertical_mps = 0.5;                      // straight up and down, at most
  double battery_home = 0.2, battery_land = 0.1;  // of what is left, below: home, or down where it is
};

// In the air the planner leads the robot, to its goal or to a place that is told here. Between the ground and where it
// may plan, the robot goes straight up or down by legs that are committed as any plan is. A robot of whose vehicle
// nothing is heard flies from the beginning, and whether it stands on the ground is told by what it does not follow.
// One that a pilot takes over holds its place where he leaves it, or goes on where it flew to its goal.
class FlightState {
 public:
  using Status = sogm_swarm::flight_status_t;

  // The robot as it is asked about.
  struct Robot {
    MotionState measured;   // position and velocity
    const Motion& motion;   // that it is bound to
    bool is_ready = false;  // it may commit
  };

  // `kept`: as it was before the daemon crashed.
  FlightState(const FlightRules& rules, const MotionLimits& limits, const std::optional<Status>& kept);

  void on_vehicle(Utime now, const sogm_swarm::vehicle_status_t& vehicle);
  void on_order(Utime now, const sogm_swarm::order_t& order, const Robot& robot);
  // Says of an order that it was heard, and what became of it.
  void answer(const sogm_swarm::order_t& order, std::int16_t verdict);
  void advance(Utime now, const Robot& robot);
  // The clock is set, to so much later.
  void shift(Duration later);

  // The way straight up or down that is to be proposed now, if there is one and the robot rests.
  std::optional<Trajectory> next_leg(Utime now, const Motion& motion) const;
  // Whether the robot is to be bound to rest where it is, as it stands on the ground: once.
  bool take_rests_here() { return std::exchange(rests_here_, false); }
  // Whether status() has changed since the last call.
  bool take_news() { return std::exchange(news_, false); }

  std::int16_t state() const { return status_.state; }
  bool is_led_by_planner() const { return status_.led_to != Status::kNowhere; }
  // All but the header.
  const Status& status() const { return status_; }

 private:
  enum class Phase : std::uint8_t { kArming, kVertical, kPlanned };

  void go(Utime now, std::int16_t state, std::int16_t cause, Phase phase, const Eigen::Vector3d& destination);
  void go(Utime now, std::int16_t state, std::int16_t cause, Phase phase);
  void set_home(const Eigen::Vector3d& place);
  void stand(Utime now, std::int16_t cause);
  void land(Utime now, std::int16_t cause, const Robot& robot);
  void go_home(Utime now, std::int16_t cause, const Robot& robot);
  std::int16_t obey(Utime now, const sogm_swarm::order_t& order, const Robot& robot);
  std::int16_t take_off(Utime now, double height_m, const Robot& robot);
  // What the vehicle did by itself; what battery and flight space demand; what comes next by itself.
  void follow_vehicle(Utime now, const Robot& robot);
  void guard(Utime now, const Robot& robot);
  void go_on(Utime now, const Robot& robot);
  bool hears_vehicle(Utime now) const { return vehicle_heard_ && now - *vehicle_heard_ <= kVehicleAge; }
  bool touches_ground(Utime now, const Robot& robot);
  // Where the robot comes to rest when it brakes now; within the flight space, at a height at which it may plan.
  Eigen::Vector3d stop_place(Utime now, const Robot& robot) const;
  double lowest_m() const;  // at which it is led by the planner
  bool is_there(const Robot& robot, Utime now) const;
  bool is_vertical() const;

  static constexpr Duration kVehicleAge = 2s;

  FlightRules rules_;
  MotionLimits limits_;
  Status status_ = [] {
    Status status{};
    status.state = Status::kFlying;
    status.led_to = Status::kGoal;
    status.order_boot = -1;
    return status;
  }();
  Phase phase_ = Phase::kPlanned;
  Utime since_{};                                          // this phase
  Eigen::Vector3d destination_ = Eigen::Vector3d::Zero();  // of the planner, or straight up
  std::optional<Eigen::Vector3d> home_;                    // where it stood last, or began
  std::optional<Utime> vehicle_heard_, stands_since_;      // while it is led down: it does not follow any more
  sogm_swarm::vehicle_status_t vehicle_{};                 // the newest
  bool may_be_handed_over_ = false;                        // while it stands: somebody else may take off
  std::optional<std::int16_t> before_pilot_;               // its state, when a pilot took it over
  bool rests_here_ = false, news_ = true;
};

}  // namespace swarm
