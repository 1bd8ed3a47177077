// Between the onboard bus and a flight controller that speaks MAVLink 2: setpoints go out, the robot's state comes in.
// A broadcast daemon that dies does not stop the robot in the air: the bridge follows the committed trajectory itself.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/receive.h"
#include "lcmtypes/bus/recurring.h"
#include "planner_daemon/trajectory/motion.h"
#include "tools/bridge/bridge_config.h"
#include "tools/bridge/mavlink.h"
#include "tools/bridge/ned_frame.h"
#include "tools/bridge/position_controller.h"
#include "tools/bridge/vehicle_orders.h"

namespace swarm {

// What the controller is led by.
enum class LedBy : std::uint8_t {
  kNone,        // no setpoint yet: nothing is sent but heartbeats
  kSetpoints,   // as they come
  kTrajectory,  // no setpoints for 50 ms: the committed trajectory, sampled here
  kLost,        // no setpoints, and no committed trajectory was ever heard
  kEnded,       // the broadcast daemon is gone and the trajectory has ended: the controller is left to itself
};

// Why a state of the controller was not passed on.
enum class StateRefusal : std::uint8_t {
  kOld,         // not newer than the one before, by the controller's own clock
  kValue,       // not finite or out of range
  kNoAttitude,  // no attitude within half a second
};
inline constexpr int kNumStateRefusals = 3;
const char* to_string(StateRefusal reason);

struct BridgeReport {
  LedBy led_by = LedBy::kNone;
  std::optional<Utime> heard_utime;   // when the controller was last heard
  Controller controller;              // as it said then
  std::optional<std::uint16_t> told;  // the newest command, and what the controller said to it
  std::optional<std::uint8_t> answered;
  std::int64_t setpoints = 0;  // passed on
  std::int64_t late = 0;       // not passed on: older than what was sent already
  std::int64_t samples = 0;    // of the committed trajectory, sent
  bool blind = false;          // positions are sent in place of attitudes: no state of late
  std::int64_t states = 0;     // published, or passed to the controller
  std::int64_t restarts = 0;   // of the controller
  double off_m = 0.0;          // how far the robot was from its target when both were known last [m]
  RefusalCounts refused;       // messages from the bus
  std::array<std::int64_t, kNumStateRefusals> states_refused{};
};

class BridgeNode : public Node {
 public:
  // A whole frame for the controller; the bytes are valid during the call only.
  using FrameSink = std::function<void(std::span<const std::uint8_t>)>;

  // `boot` as in HeaderSource. Throws what verify() throws.
  BridgeNode(const BridgeConfig& config, std::int32_t boot, FrameSink sink);

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  // A message of the controller; a step has to follow.
  void on_frame(Utime now, const mavlink::Message& message, Outbox& outbox);
  Utime step(Utime now, Outbox& outbox) override;
  // Not while the robot moves: the broadcast daemon keeps its time then, too.
  bool on_clock_step(Utime now, Duration step) override;

  const BridgeReport& report() const { return report_; }

 private:
  // Whether times of the controller's clock go on. Modulo 2^32 ms.
  class BootClock {
   public:
    enum class Verdict { kNewer, kOld, kRestarted };
    Verdict pass(std::uint32_t time_ms);

   private:
    std::optional<std::uint32_t> newest_ms_, suspect_ms_;
  };

  Refusal on_setpoint(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_announcement(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_flight_status(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_state(Utime now, std::span<const std::uint8_t> bytes);
  void on_controller(Utime now, const mavlink::Heartbeat& heartbeat);
  void on_controller(Utime now, const mavlink::Attitude& attitude);
  void on_controller(Utime now, const mavlink::LocalPositionNed& local, Outbox& outbox);
  // False when it is refused. A restart of the controller is one of both clocks.
  bool pass(BootClock* clock, std::uint32_t time_ms);
  void refuse(StateRefusal reason) { ++report_.states_refused[static_cast<std::size_t>(reason)]; }

  TimeWindow window(Utime now, Duration max_age) const;
  void follow_clock(Utime now);
  void shift_times(Duration later);
  Utime guide(Utime now);
  // Tells the controller what the flight's state demands, and the bus how the vehicle is.
  void command(Utime now);
  bool hears_controller(Utime now) const;
  void publish_vehicle(Utime now, Outbox& outbox);
  // As fits the vehicle.
  void send_target(Utime utime, const MotionState& state, double yaw_rad, double yaw_rate);
  void send_position(std::uint32_t time_ms, const MotionState& told, double yaw_rad, double yaw_rate);
  // `wanted`: now.
  void send_attitude(std::uint32_t time_ms, const MotionState& wanted, const MotionState& told, double yaw_rad,
                     double yaw_rate);
  void send(const mavlink::Message& message) { sink_(encoder_.encode(message)); }

  BridgeConfig config_;
  FrameSink sink_;
  NedFrame frame_;
  mavlink::Encoder encoder_;
  HeaderSource state_headers_, vehicle_headers_;
  SequenceGate setpoint_gate_, announcement_gate_, flight_gate_, state_gate_;
  BridgeReport report_;

  std::optional<Utime> start_;
  std::optional<Utime> asked_;  // when it first heard of a step of the clock that it has not taken
  Utime now_{};
  Utime setpoint_heard_{}, announcement_heard_{};
  Utime sent_utime_{};                     // of the newest target,
  std::optional<Eigen::Vector3d> target_;  // which is here, in W
  Recurring sample_, heartbeat_, vehicle_;
  VehicleOrders orders_;
  std::optional<sogm_swarm::flight_status_t> flight_;  // the newest, heard
  Utime flight_heard_{};
  float battery_ = -1.0f;  // what is left of it; -1: not known
  bool has_vehicle_news_ = false;
  double yaw_rad_ = 0.0;          // of the newest setpoint, in W
  std::optional<Motion> motion_;  // what the robot is bound to

  BootClock position_clock_, attitude_clock_;
  std::optional<Utime> attitude_heard_;  // when it was heard
  double attitude_yaw_rad_ = 0.0;        // in W

  PositionController position_controller_;
  Utime controlled_utime_{};          // when it was asked last
  std::optional<Utime> state_utime_;  // of the robot's newest state:
  MotionState state_;                 // position and velocity, in W
};

}  // namespace swarm
