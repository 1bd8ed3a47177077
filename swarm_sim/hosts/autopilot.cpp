#include "swarm_sim/hosts/autopilot.h"

#include <Eigen/Geometry>
#include <boost/asio/buffer.hpp>
#include <cmath>
#include <span>
#include <variant>

#include "lcmtypes/bus/node_clock.h"
#include "planner_daemon/trajectory/motion_limits.h"

namespace swarm {
namespace {

using boost::asio::ip::udp;

constexpr Duration kReportPeriod = 20ms;  // as controllers are set up to
constexpr int kHeartbeatEvery = 50;       // reports
constexpr std::uint32_t kOffboard = 6 << 16;
constexpr double kHoverThrust = 0.45;  // share of the most thrust at which it hovers; the bridge takes it for 0.5

}  // namespace

Autopilot::Autopilot(boost::asio::io_context& io, int port, Simulation& simulation, std::size_t index)
    : simulation_(simulation),
      index_(index),
      frame_(0.0, Eigen::Vector3d::Zero()),
      encoder_(kSelf),
      parser_(kBridge),
      socket_(io, udp::endpoint(boost::asio::ip::address_v4::loopback(), 0)),
      bridge_(boost::asio::ip::address_v4::loopback(), static_cast<std::uint16_t>(port)),
      timer_(io) {
  socket_.non_blocking(true);
  listen();
  report_soon();
}

void Autopilot::listen() {
  socket_.async_receive_from(
      boost::asio::buffer(datagram_), from_, [this](const boost::system::error_code& error, std::size_t size) {
        if (error == boost::asio::error::operation_aborted) return;
        if (!error && from_ == bridge_) {  // refused: the bridge is not there yet
          parser_.feed(std::span(datagram_).first(size), [this](const mavlink::Message& message) {
            if (const auto* const target = std::get_if<mavlink::SetPositionTargetLocalNed>(&message)) obey(*target);
            if (const auto* const target = std::get_if<mavlink::SetAttitudeTarget>(&message)) obey(*target);
          });
        }
        listen();
      });
}

void Autopilot::obey(const mavlink::SetPositionTargetLocalNed& target) {
  MotionState told;
  told.position = frame_.position_to_world(to_vector(target.position));
  told.velocity = frame_.to_world(to_vector(target.velocity));
  told.acceleration = frame_.to_world(to_vector(target.acceleration));
  simulation_.vehicle(index_).on_target(wall_utime(), told, frame_.yaw(target.yaw));
}

void Autopilot::obey(const mavlink::SetAttitudeTarget& target) {
  const auto [w, x, y, z] = target.turn;
  const Eigen::Matrix3d axes = Eigen::Quaternionf(w, x, y, z).normalized().cast<double>().toRotationMatrix();
  const double thrust = MotionLimits::kGravity_mps2 / kHoverThrust * target.thrust;
  simulation_.vehicle(index_).on_thrust(wall_utime(), frame_.to_world(-thrust * axes.col(2)),
                                        frame_.yaw(std::atan2(axes(1, 0), axes(0, 0))));
}

void Autopilot::report_soon() {
  timer_.expires_after(kReportPeriod);
  timer_.async_wait([this](const boost::system::error_code& error) {
    if (error) return;
    report();
    report_soon();
  });
}

void Autopilot::report() {
  const Vehicle& vehicle = simulation_.vehicle(index_);
  const auto time_boot_ms = static_cast<std::uint32_t>(simulation_.now().time_since_epoch() / 1ms);
  if (reports_++ % kHeartbeatEvery == 0) {
    mavlink::Heartbeat heartbeat;
    heartbeat.autopilot = mavlink::Heartbeat::kPx4;
    heartbeat.base_mode = mavlink::Heartbeat::kArmed;
    heartbeat.custom_mode = kOffboard;
    send(heartbeat);
  }
  mavlink::Attitude attitude;
  attitude.time_boot_ms = time_boot_ms;
  attitude.yaw = static_cast<float>(frame_.yaw(vehicle.yaw_rad()));
  send(attitude);
  send(mavlink::LocalPositionNed{time_boot_ms, to_floats(frame_.position_to_ned(vehicle.estimate().position)),
                                 to_floats(frame_.to_ned(vehicle.estimate().velocity))});
}

void Autopilot::send(const mavlink::Message& message) {
  boost::system::error_code ignored;  // the bridge is not there yet
  const std::span<const std::uint8_t> frame = encoder_.encode(message);
  socket_.send_to(boost::asio::buffer(frame.data(), frame.size()), bridge_, 0, ignored);
}

}  // namespace swarm
