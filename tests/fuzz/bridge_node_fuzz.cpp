// The MAVLink bridge's node: whatever comes from the bus and from the controller, heartbeats and targets go out as
// whole frames of finite numbers, and a controller that is led is not left alone.
#include "tools/bridge/bridge_node.h"

#include <cmath>
#include <optional>

#include "tests/fuzz/fuzz_node.h"

namespace swarm::fuzz {
namespace {

using sogm_swarm::announcement_t;

class Bench : public NodeBench<Bench, BridgeNode> {
 public:
  static BridgeConfig config() {
    BridgeConfig config;
    config.robot_id = kRobot;
    config.north_rad = 0.5;
    config.origin = {1, 2, 3};
    config.targets = "attitude";  // positions while it does not know where the robot is
    return config;
  }
  Bench() : NodeBench(config(), 1, [this](auto frame) { on_frame(frame); }) { step(); }

  void feed(std::span<const std::uint8_t> bytes) {
    const Bytes copy(bytes.begin(), bytes.end());
    from_controller_.feed(copy, [this](const mavlink::Message& message) { node.on_frame(now, message, *this); });
    step();
  }
  void on_step_of_clock(Duration) { last_heartbeat_ = last_target_ = elapsed; }
  void check() {
    expect(elapsed - last_heartbeat_ <= 1s, "heartbeats go out");
    // 50 ms without setpoints, then it samples the trajectory.
    // But for a controller that takes off by itself.
    if (node.report().controller.heartbeat.autopilot == mavlink::Heartbeat::kArdupilot) last_target_ = elapsed;
    if (node.report().led_by == LedBy::kTrajectory) expect(elapsed - last_target_ <= 60ms, "targets keep their rate");
  }

 private:
  void on_frame(std::span<const std::uint8_t> frame) {
    const std::int64_t before = sent_.frames();
    sent_.feed(frame, [this](const mavlink::Message& message) {
      if (std::holds_alternative<mavlink::Heartbeat>(message)) last_heartbeat_ = elapsed;
      if (const auto* target = std::get_if<mavlink::SetAttitudeTarget>(&message)) check_attitude(*target);
      const auto* target = std::get_if<mavlink::SetPositionTargetLocalNed>(&message);
      if (target == nullptr) return;
      last_target_ = elapsed;
      for (const auto* values : {&target->position, &target->velocity, &target->acceleration}) {
        for (const float value : *values) expect(std::isfinite(value), "targets are finite");
      }
      expect(std::isfinite(target->yaw) && std::isfinite(target->yaw_rate), "so is yaw");
    });
    expect(sent_.frames() == before + 1, "a frame is sent as a whole");
  }

  void check_attitude(const mavlink::SetAttitudeTarget& target) {
    last_target_ = elapsed;
    const Eigen::Vector4f turn = Eigen::Vector4f::Map(target.turn.data());
    expect(std::abs(turn.norm() - 1.0f) < 1e-5f, "a turn is one");
    expect(std::acos(1.0f - 2.0f * turn.segment<2>(1).squaredNorm()) <= 0.786f, "tilt is limited");
    expect(target.thrust > 0.05f && target.thrust <= 1.00001f, "thrust is a share");
    for (const float rate : target.rates) expect(std::isfinite(rate), "rates are finite");
  }

  mavlink::Parser from_controller_{controller_of(config())}, sent_{bridge_of(config())};
  Duration last_heartbeat_{}, last_target_{};
};

void send_setpoint(FuzzInput& input, Bench* bench) {
  sogm_swarm::setpoint_t setpoint{};
  setpoint.header = bench->header(input, Bench::kRobot);
  for (auto* values : {&setpoint.position, &setpoint.velocity, &setpoint.acceleration, &setpoint.jerk}) {
    const bool any = input.byte() % 16 == 0;
    for (double& value : *values) value = any ? input.any_real() : input.real(-3, 3);
  }
  setpoint.yaw = input.real(-3.14, 3.14);
  setpoint.yaw_rate = input.byte() % 16 == 0 ? input.any_real() : input.real(-2, 2);
  bench->send(BusId::kOnboard, channel::kSetpoint, setpoint);
}

void send_announcement(FuzzInput& input, Bench* bench) {
  announcement_t message{};
  message.header = bench->header(input, Bench::kRobot);
  message.radius = 0.2f;
  const Eigen::Vector3d at = place(input, 3.0);
  const Trajectory committed = trajectory(input, bench->now - Bench::duration(input), at, 1);
  message.committed = committed.to_wire();
  if (input.flag()) {
    const Utime start = bench->now + Bench::duration(input);
    message.pending = trajectory(input, start, committed.at(start).position, 2).to_wire();
    message.pending_state = input.flag() ? announcement_t::kCommitted : announcement_t::kAnnounced;
  }
  bench->send(BusId::kOnboard, channel::kOwnTrajectory, message);
}

void send_frame(FuzzInput& input, mavlink::Encoder* encoder, Bench* bench) {
  const auto number = [&] { return static_cast<float>(input.byte() % 16 == 0 ? input.any_real() : input.real(-3, 3)); };
  const auto time = [&] {
    return static_cast<std::uint32_t>(input.byte() % 16 == 0 ? input.word(4)
                                                             : static_cast<std::uint64_t>(to_us(bench->now) / 1000));
  };
  mavlink::Message message;
  switch (input.byte() % 7) {
    case 4:
      message = mavlink::ExtendedSysState{0, input.byte()};
      break;
    case 5:
      message = mavlink::CommandAck{static_cast<std::uint16_t>(input.word(2)), input.byte()};
      break;
    case 6: {
      mavlink::SysStatus status;
      status.battery_percent = input.byte();
      message = status;
      break;
    }
    case 0:
      message = mavlink::Heartbeat{0, input.byte(), input.byte(), input.byte(), input.byte(), 3};
      break;
    case 1:
      message = mavlink::Attitude{time(), number(), number(), number(), 0, 0, 0};
      break;
    default:
      message = mavlink::LocalPositionNed{time(), {number(), number(), number()}, {number(), number(), number()}};
  }
  bench->feed(encoder->encode(message));
}

}  // namespace

void try_input(FuzzInput input) {
  Bench bench;
  mavlink::Encoder controller({1, 1});
  play(input, 13, 30s, &bench, [&](int number) {
    if (number == 0) {
      bench.deliver_anything(input);
    } else if (number == 2) {
      bench.feed(input.part());
    } else if (number <= 4) {
      send_setpoint(input, &bench);
    } else if (number <= 6) {
      send_announcement(input, &bench);
    } else if (number <= 9) {
      send_frame(input, &controller, &bench);
    } else if (number == 10) {
      bench.send(BusId::kOnboard, channel::kFlightStatus, flight_status(input, bench.header(input, Bench::kRobot)));
    }
    return number <= 10;
  });
}

}  // namespace swarm::fuzz
