#include "swarm_sim/hosts/autopilot.h"

#include <Eigen/Geometry>
#include <algorithm>
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
constexpr std::uint32_t kOffboard = 6 << 16, kHoldMode = 3 << 24 | 4 << 16;
constexpr Duration kTargetTimeout = 500ms;       // offboard mode is left without a target
constexpr double kLow_m = 0.02, kHigh_m = 0.05;  // above the ground: it stands, it flies
constexpr int kLowReports = 25;
constexpr double kHoverThrust = 0.45;  // share of the most thrust at which it hovers; the bridge takes it for 0.5

}  // namespace

Autopilot::Autopilot(boost::asio::io_context& io, int port, Simulation& simulation, std::size_t index,
                     const AutopilotOptions& options)
    : simulation_(simulation),
      index_(index),
      frame_(0.0, Eigen::Vector3d::Zero()),
      encoder_(kSelf),
      parser_(kBridge),
      socket_(io, udp::endpoint(boost::asio::ip::address_v4::loopback(), 0)),
      bridge_(boost::asio::ip::address_v4::loopback(), static_cast<std::uint16_t>(port)),
      timer_(io),
      battery_s_(options.battery_s),
      ground_m_(options.on_ground ? simulation.vehicle(index).state().position.z() : 0.0),
      armed_(!options.on_ground),
      offboard_(armed_),
      stands_(options.on_ground) {
  held_.position = simulation.vehicle(index).estimate().position;
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
            if (const auto* const command = std::get_if<mavlink::CommandLong>(&message)) obey(*command);
          });
        }
        listen();
      });
}

void Autopilot::obey(const mavlink::SetPositionTargetLocalNed& target) {
  target_heard_ = wall_utime();
  if (!is_led()) return;
  MotionState told;
  told.position = frame_.position_to_world(to_vector(target.position));
  told.velocity = frame_.to_world(to_vector(target.velocity));
  told.acceleration = frame_.to_world(to_vector(target.acceleration));
  if (told.position.z() < ground_m_) {
    told.position.z() = ground_m_;
    told.velocity.z() = told.acceleration.z() = 0.0;
  }
  simulation_.vehicle(index_).on_target(wall_utime(), told, frame_.yaw(target.yaw));
}

void Autopilot::obey(const mavlink::SetAttitudeTarget& target) {
  target_heard_ = wall_utime();
  if (!is_led()) return;
  const auto [w, x, y, z] = target.turn;
  const Eigen::Matrix3d axes = Eigen::Quaternionf(w, x, y, z).normalized().cast<double>().toRotationMatrix();
  const Eigen::Vector3d thrust =
      frame_.to_world(-MotionLimits::kGravity_mps2 / kHoverThrust * target.thrust * axes.col(2));
  // The ground holds it.
  const bool is_low = simulation_.vehicle(index_).state().position.z() <= ground_m_ + kLow_m;
  if (is_low && thrust.z() < MotionLimits::kGravity_mps2) {
    held_.position = simulation_.vehicle(index_).estimate().position;
    held_.position.z() = ground_m_;
    return simulation_.vehicle(index_).on_target(wall_utime(), held_, simulation_.vehicle(index_).yaw_rad());
  }
  simulation_.vehicle(index_).on_thrust(wall_utime(), thrust, frame_.yaw(std::atan2(axes(1, 0), axes(0, 0))));
}

void Autopilot::obey(const mavlink::CommandLong& command) {
  constexpr std::uint8_t kDenied = 2;
  bool is_good = false;
  if (command.command == mavlink::CommandLong::kSetMode) {
    is_good = command.parameters[1] == 6.0f && wall_utime() - target_heard_ <= kTargetTimeout;
    offboard_ = offboard_ || is_good;
  } else if (command.command == mavlink::CommandLong::kArm) {
    is_good = stands_;
    if (is_good) armed_ = command.parameters[0] == 1.0f;
    if (!armed_) offboard_ = false;
  }
  held_.position = simulation_.vehicle(index_).estimate().position;
  send(mavlink::CommandAck{command.command, is_good ? mavlink::CommandAck::kAccepted : kDenied});
  reports_ = 0;  // it tells at once
}

void Autopilot::fly() {
  Vehicle& vehicle = simulation_.vehicle(index_);
  const double height_m = vehicle.state().position.z() - ground_m_;
  low_ = height_m <= kLow_m ? low_ + 1 : 0;
  if (low_ >= kLowReports) stands_ = true;
  if (height_m > kHigh_m) stands_ = false;
  if (armed_) armed_s_ += to_seconds(kReportPeriod);
  const bool was_led = is_led();
  if (wall_utime() - target_heard_ > kTargetTimeout && target_heard_ != Utime()) offboard_ = false;
  if (is_led()) return;
  if (was_led) held_.position = vehicle.estimate().position;
  vehicle.on_target(wall_utime(), held_, vehicle.yaw_rad());
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
  fly();
  const Vehicle& vehicle = simulation_.vehicle(index_);
  const auto time_boot_ms = static_cast<std::uint32_t>(simulation_.now().time_since_epoch() / 1ms);
  if (reports_++ % kHeartbeatEvery == 0) {
    mavlink::Heartbeat heartbeat;
    heartbeat.autopilot = mavlink::Heartbeat::kPx4;
    heartbeat.base_mode = armed_ ? mavlink::Heartbeat::kArmed : 0;
    heartbeat.custom_mode = offboard_ ? kOffboard : kHoldMode;
    send(heartbeat);
    mavlink::SysStatus status;
    if (battery_s_ > 0.0)
      status.battery_percent = static_cast<std::uint8_t>(100.0 * std::max(0.0, 1.0 - armed_s_ / battery_s_));
    send(status);
  }
  using mavlink::ExtendedSysState;
  send(ExtendedSysState{0, stands_ ? ExtendedSysState::kOnGround : ExtendedSysState::kInAir});
  if (!simulation_.tells_state(index_)) return;
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
