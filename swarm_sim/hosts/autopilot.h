// A simulated flight controller behind MAVLink: mavlink_bridge leads a robot's vehicle through it, and hears where it
// is. As PX4 does, it follows targets in offboard mode while they come, and holds its place otherwise; it arms and
// disarms on the ground.
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdint>

#include "swarm_sim/environment/simulation.h"
#include "tools/bridge/mavlink.h"
#include "tools/bridge/ned_frame.h"

namespace swarm {

struct AutopilotOptions {
  bool on_ground = false;  // it begins there, disarmed; false: in the air, in offboard mode, over ground at z = 0
  double battery_s = 0.0;  // for so long its battery lasts while it is armed; 0: it tells nothing of it
};

class Autopilot {
 public:
  static constexpr mavlink::Sender kSelf{1, 1}, kBridge{1, 191};  // the bridge's defaults

  // Of the vehicle of robot `index`; the bridge listens on `port` of this computer. `simulation` and `io` must outlive
  // it. Throws boost::system::system_error.
  Autopilot(boost::asio::io_context& io, int port, Simulation& simulation, std::size_t index,
            const AutopilotOptions& options = {});

 private:
  void listen();
  void obey(const mavlink::SetPositionTargetLocalNed& target);
  void obey(const mavlink::SetAttitudeTarget& target);
  void obey(const mavlink::CommandLong& command);
  bool is_led() const { return armed_ && offboard_; }
  // What it does by itself: its place is held while it is not led, and who stands is noticed.
  void fly();
  void report_soon();
  void report();
  void send(const mavlink::Message& message);

  Simulation& simulation_;
  std::size_t index_;
  NedFrame frame_;
  mavlink::Encoder encoder_;
  mavlink::Parser parser_;
  boost::asio::ip::udp::socket socket_;
  boost::asio::ip::udp::endpoint bridge_, from_;
  boost::asio::steady_timer timer_;
  std::array<std::uint8_t, 2048> datagram_{};
  std::int64_t reports_ = 0;

  double battery_s_, ground_m_;
  bool armed_, offboard_, stands_;
  MotionState held_;      // where, while it is not led
  Utime target_heard_{};  // the newest
  int low_ = 0;           // reports, since it is on the ground
  double armed_s_ = 0.0;
};

}  // namespace swarm
