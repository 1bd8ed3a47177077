// The bridge to the flight controller, in simulated time.
#include "tools/bridge/bridge_node.h"

#include <limits>
#include <numbers>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_log.h"
#include "swarm_sim/lockstep.h"
#include "swarm_sim/recorder.h"
#include "swarm_sim/world_generator.h"
#include "tests/harness.h"
#include "tests/random_motion.h"
#include "tests/simulated_autopilot.h"
#include "tools/bridge/bridge_log.h"

namespace swarm::test {
namespace {

using sogm_swarm::announcement_t;
using sogm_swarm::robot_state_t;
using sogm_swarm::setpoint_t;

constexpr std::int32_t kBoot = 1'700'000'000;
constexpr int kRobot = 3;

BridgeConfig make_config() {
  BridgeConfig config;
  config.robot_id = kRobot;
  config.target_system = 4;
  return config;
}

// What the bridge has sent, and who hears it.
struct Wire {
  void put(std::span<const std::uint8_t> frame) {
    frames.emplace_back(frame.begin(), frame.end());
    if (take) take(frames.back());
  }
  std::vector<Bytes> frames;
  std::function<void(const Bytes&)> take;
};

// The bridge, an autopilot on its link, and what the broadcast daemon would say.
struct Flight : Wire, Bench<BridgeNode> {
  explicit Flight(const BridgeConfig& config_in = make_config())
      : Bench(config_in, kBoot, [this](auto frame) { put(frame); }), config(config_in) {
    take = [this](const Bytes& frame) { autopilot.receive(frame); };
    std::ranges::for_each(frames, take);
  }

  setpoint_t make_setpoint(const MotionState& state, double yaw = 0.0) {
    setpoint_t setpoint{};
    setpoint.header = make_header(kRobot, 1, setpoint_seq++, now_us);
    Eigen::Map<Eigen::Vector3d>(setpoint.position) = state.position;
    Eigen::Map<Eigen::Vector3d>(setpoint.velocity) = state.velocity;
    Eigen::Map<Eigen::Vector3d>(setpoint.acceleration) = state.acceleration;
    setpoint.yaw = yaw;
    return setpoint;
  }
  void say_setpoint(const MotionState& state, double yaw = 0.0) { send(channel::kSetpoint, make_setpoint(state, yaw)); }
  announcement_t make_announcement(const Trajectory& committed) {
    announcement_t message{};
    message.header = make_header(kRobot, 1, announcement_seq++, now_us);
    message.radius = 0.2f;
    message.committed = committed.to_wire();
    message.least_delay_us = announcement_t::kUnknown;
    return message;
  }
  void announce(const Trajectory& committed) { send(channel::kOwnTrajectory, make_announcement(committed)); }

  // The broadcast daemon lives: setpoints at 100 Hz, announcements at 20 Hz.
  void fly(const Trajectory& trajectory, double seconds) {
    for (int i = 0; i < std::lround(100 * seconds); ++i) {
      if (i % 5 == 0) announce(trajectory);
      say_setpoint(trajectory.at(now_us), 0.5);
      run_for(0.01);
    }
  }
  // Where a target is in W.
  Eigen::Vector3d place_of(const mavlink::SetPositionTargetLocalNed& target) const {
    return NedFrame(config.north_rad, config.origin)
        .position_to_world(Eigen::Vector3f::Map(target.position.data()).cast<double>());
  }
  std::size_t targets() const { return autopilot.targets.size(); }
  std::int32_t refused(Refusal refusal) const { return node.report().refused[refusal]; }
  std::int64_t refused(StateRefusal refusal) const {
    return node.report().states_refused[static_cast<std::size_t>(refusal)];
  }
  void hear(const mavlink::Message& message) {
    node.on_frame(now_us, message, out);
    step();
  }
  int states() const { return out.count(channel::kRobotState); }

  BridgeConfig config;
  std::int64_t setpoint_seq = 0, announcement_seq = 0;
  mavlink::Parser ears{controller_of(config)};
  SimulatedAutopilot autopilot{controller_of(config), bridge_of(config), [this](auto frame) {
                                 ears.feed(frame, [this](const mavlink::Message& message) { hear(message); });
                               }};
};

MotionState at_rest(const Eigen::Vector3d& position) {
  MotionState state;
  state.position = position;
  return state;
}

TEST(NedFrame, IsRightHandedAndComesBack) {
  Rng rng(1);
  for (int i = 0; i < 1000; ++i) {
    const NedFrame frame(uniform(rng, -6.3, 6.3), in_cube(rng, 100));
    const Eigen::Vector3d a = in_cube(rng, 10), b = in_cube(rng, 10);
    EXPECT_LT((frame.position_to_world(frame.position_to_ned(a)) - a).norm(), 1e-12);
    EXPECT_LT((frame.to_world(frame.to_ned(a)) - a).norm(), 1e-13);
    EXPECT_LT((frame.to_ned(a).cross(frame.to_ned(b)) - frame.to_ned(a.cross(b))).norm(), 1e-12);
    EXPECT_LT((frame.position_to_ned(a) - frame.position_to_ned(b) - frame.to_ned(a - b)).norm(), 1e-12);
    EXPECT_DOUBLE_EQ(frame.to_ned(a).z(), -a.z());
    // A robot that flies where it looks does so in both frames.
    const double yaw = uniform(rng, -std::numbers::pi, std::numbers::pi), ned_yaw = frame.yaw(yaw);
    const Eigen::Vector3d ahead(std::cos(yaw), std::sin(yaw), 0);
    EXPECT_LT((frame.to_ned(ahead) - Eigen::Vector3d(std::cos(ned_yaw), std::sin(ned_yaw), 0)).norm(), 1e-12);
    EXPECT_LE(std::abs(ned_yaw), std::numbers::pi);
    EXPECT_NEAR(std::remainder(frame.yaw(ned_yaw) - yaw, 2 * std::numbers::pi), 0.0, 1e-12);
  }
  const NedFrame plain(0, {0, 0, 0});
  EXPECT_EQ(plain.position_to_ned({1, 2, 3}), Eigen::Vector3d(1, -2, -3));
  EXPECT_EQ(plain.yaw(0.5), -0.5);
  // North along W's y axis: W is east, north, up, with its zero two metres above the controller's.
  const NedFrame enu(std::numbers::pi / 2, {0, 0, -2});
  EXPECT_LT((enu.position_to_ned({1, 2, 3}) - Eigen::Vector3d(2, 1, -5)).norm(), 1e-12);
  EXPECT_NEAR(enu.yaw(0), std::numbers::pi / 2, 1e-12);  // looking east
}

TEST(Bridge, SaysThatItIsThereAndNothingElseBeforeASetpoint) {
  Flight flight;
  flight.announce(Trajectory::hover(1, flight.now_us, {0, 0, 1}));
  flight.run_for(5.0);
  EXPECT_EQ(flight.targets(), 0u);
  ASSERT_EQ(flight.autopilot.heartbeats.size(), 6u);
  EXPECT_EQ(flight.autopilot.heartbeats[0].type, 18);
  EXPECT_EQ(flight.autopilot.heartbeats[0].autopilot, 8);
  EXPECT_EQ(flight.autopilot.heartbeats[0].mavlink_version, 3);
  EXPECT_EQ(flight.frames[0][5], 4);    // the system of the controller,
  EXPECT_EQ(flight.frames[0][6], 191);  // another part of it
  EXPECT_EQ(flight.node.report().led_by, LedBy::kNone);

  BridgeConfig config = make_config();
  config.system_id = 77, config.component_id = 195;
  EXPECT_EQ(Flight(config).frames.at(0)[5], 77);
  EXPECT_EQ(Flight(config).frames.at(0)[6], 195);
}

TEST(Bridge, PassesSetpointsOn) {
  BridgeConfig config = make_config();
  config.origin = {10, 20, 30};
  Flight flight(config);
  flight.run_for(2.0);
  setpoint_t setpoint = flight.make_setpoint({{11, 22, 33}, {1, 2, 3}, {4, 5, 6}, {7, 8, 9}}, 0.5);
  setpoint.yaw_rate = 0.25;
  flight.send(channel::kSetpoint, setpoint);
  ASSERT_EQ(flight.targets(), 1u);
  const mavlink::SetPositionTargetLocalNed& target = flight.autopilot.targets[0];
  EXPECT_EQ(target.time_boot_ms, 2000u);
  EXPECT_EQ(target.position, (std::array<float, 3>{1, -2, -3}));
  EXPECT_EQ(target.velocity, (std::array<float, 3>{1, -2, -3}));
  EXPECT_EQ(target.acceleration, (std::array<float, 3>{4, -5, -6}));
  EXPECT_EQ(target.yaw, -0.5f);
  EXPECT_EQ(target.yaw_rate, -0.25f);
  EXPECT_EQ(target.type_mask, 0);  // all of it counts
  EXPECT_EQ(target.frame, 1);
  EXPECT_EQ(target.target_system, 4);
  EXPECT_EQ(target.target_component, 1);
}

TEST(Bridge, RefusesBadSetpointsAndCountsThem) {
  Flight flight;
  flight.say_setpoint(at_rest({1, 1, 1}));
  ASSERT_EQ(flight.targets(), 1u);
  const auto send = [&](const std::function<void(setpoint_t&)>& spoil) {
    flight.run_for(0.001);
    setpoint_t setpoint = flight.make_setpoint(at_rest({1, 1, 1}));
    spoil(setpoint);
    flight.send(channel::kSetpoint, setpoint);
  };
  send([](setpoint_t& s) { s.header.utime -= 50'001; });
  EXPECT_EQ(flight.refused(Refusal::kTime), 1);
  send([](setpoint_t& s) { s.header.utime += 100'001; });
  EXPECT_EQ(flight.refused(Refusal::kTime), 2);
  send([](setpoint_t& s) { s.header.seq = 0; });  // again
  EXPECT_EQ(flight.refused(Refusal::kSequence), 1);
  send([](setpoint_t& s) { s.header.robot_id = 2; });
  EXPECT_EQ(flight.refused(Refusal::kRobot), 1);
  std::int32_t values = 0;
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e6,
                           1e300, -std::numeric_limits<double>::max()}) {
    send([&](setpoint_t& s) { s.position[2] = bad; });
    send([&](setpoint_t& s) { s.velocity[0] = bad; });
    send([&](setpoint_t& s) { s.acceleration[1] = bad; });
    send([&](setpoint_t& s) { s.yaw_rate = bad; });
    EXPECT_EQ(flight.refused(Refusal::kValue), values += 4) << bad;
  }
  Bytes damaged = encoded(flight.make_setpoint(at_rest({1, 1, 1})));
  damaged[60] ^= 1;
  flight.deliver(BusId::kOnboard, channel::kSetpoint, damaged);
  flight.deliver(BusId::kOnboard, channel::kSetpoint, Bytes(3));
  EXPECT_EQ(flight.refused(Refusal::kCrc), 1);
  EXPECT_EQ(flight.refused(Refusal::kSize), 1);
  EXPECT_EQ(flight.targets(), 1u);
  EXPECT_EQ(flight.node.report().setpoints, 1);
  send([](setpoint_t& s) { s.header.utime -= 500; });  // on its way for a while
  EXPECT_EQ(flight.targets(), 2u);
}

TEST(Bridge, RefusesBadAnnouncements) {
  Flight flight;
  const auto send = [&](const std::function<void(announcement_t&)>& spoil) {
    announcement_t message = flight.make_announcement(Trajectory::hover(1, flight.now_us, {0, 0, 1}));
    spoil(message);
    flight.send(channel::kOwnTrajectory, message);
  };
  flight.announcement_seq = 5;
  send([](announcement_t&) {});
  send([](announcement_t& m) { m.header.utime -= 1'000'001; });
  send([](announcement_t& m) { m.header.utime += 100'001; });
  send([](announcement_t& m) { m.header.robot_id = 0; });
  send([](announcement_t& m) { m.header.seq = 4; });
  send([](announcement_t& m) { m.committed = {}; });
  EXPECT_EQ(flight.refused(Refusal::kTime), 2);
  EXPECT_EQ(flight.refused(Refusal::kRobot), 1);
  EXPECT_EQ(flight.refused(Refusal::kSequence), 1);
  EXPECT_EQ(flight.refused(Refusal::kInconsistent), 1);
  EXPECT_EQ(flight.node.report().refused.total(), 5);
}

TEST(Bridge, FollowsTheCommittedTrajectoryWithoutSetpoints) {
  Flight flight;
  const Trajectory trajectory = quintic_to(at_rest({0, 0, 1}), flight.now_us, {2, 1, 1.5}, 3.0);
  flight.fly(trajectory, 1.0);
  const std::int64_t last_setpoint_us = flight.now_us - 10'000, began_us = kStart_us;
  ASSERT_EQ(flight.targets(), 100u);
  flight.run_until(last_setpoint_us + 49'999);
  ASSERT_EQ(flight.targets(), 100u);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kSetpoints);
  flight.run_until(last_setpoint_us + 50'000);
  ASSERT_EQ(flight.targets(), 101u);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  flight.run_for(1.5);
  EXPECT_NEAR(static_cast<double>(flight.node.report().samples), 150, 1);
  for (std::size_t i = 1; i < flight.targets(); ++i) {
    const auto &before = flight.autopilot.targets[i - 1], &target = flight.autopilot.targets[i];
    const std::int64_t utime = began_us + 1000 * std::int64_t{target.time_boot_ms};
    const MotionState state = trajectory.at(utime);
    ASSERT_LT((flight.place_of(target) - state.position).norm(), 1e-6) << i;
    ASSERT_NEAR(target.velocity[0], state.velocity.x(), 1e-6) << i;
    ASSERT_NEAR(target.acceleration[2], -state.acceleration.z(), 1e-5) << i;
    ASSERT_EQ(target.yaw, -0.5f);
    ASSERT_GT(target.time_boot_ms, before.time_boot_ms);
    ASSERT_LE(target.time_boot_ms - before.time_boot_ms, 50u);
  }
  // The broadcast daemon is back: on with its setpoints, never backwards.
  flight.fly(trajectory, 0.5);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kSetpoints);
  const std::int64_t samples = flight.node.report().samples;
  flight.fly(trajectory, 0.1);
  EXPECT_EQ(flight.node.report().samples, samples);
  for (std::size_t i = 1; i < flight.targets(); ++i)
    ASSERT_GT(flight.autopilot.targets[i].time_boot_ms, flight.autopilot.targets[i - 1].time_boot_ms);
}

// A setpoint that comes when the trajectory was sampled beyond it says that there are setpoints, and no more.
TEST(Bridge, LeadsNobodyBackwards) {
  Flight flight;
  const Trajectory trajectory = quintic_to(at_rest({0, 0, 1}), flight.now_us, {2, 1, 1.5}, 3.0);
  flight.fly(trajectory, 0.5);
  flight.run_for(0.3);
  const std::size_t targets = flight.targets();
  setpoint_t late = flight.make_setpoint(trajectory.at(flight.now_us - 20'000));
  late.header.utime -= 20'000;
  flight.send(channel::kSetpoint, late);
  EXPECT_EQ(flight.targets(), targets);
  EXPECT_EQ(flight.node.report().late, 1);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kSetpoints);
  flight.run_for(0.04);
  EXPECT_EQ(flight.targets(), targets);
}

TEST(Bridge, FollowsWhatIsCommittedNextAndNotWhatIsMerelyAnnounced) {
  for (const bool committed : {false, true}) {
    Flight flight;
    const Trajectory first = Trajectory::hover(1, flight.now_us, {0, 0, 1});
    Trajectory next = quintic_to(at_rest({0, 0, 1}), flight.now_us + 300'000, {1, 0, 1}, 1.0);
    next.set_seq(2);
    announcement_t message = flight.make_announcement(first);
    message.pending = next.to_wire();
    message.pending_state = committed ? announcement_t::kCommitted : announcement_t::kAnnounced;
    message.pending_stamp = flight.now_us;
    flight.send(channel::kOwnTrajectory, message);
    flight.say_setpoint(at_rest({0, 0, 1}));
    flight.run_for(1.4);
    EXPECT_EQ(flight.refused(Refusal::kInconsistent), 0);
    ASSERT_GT(flight.targets(), 1u);
    const Eigen::Vector3d end = flight.place_of(flight.autopilot.targets.back());
    EXPECT_LT((end - (committed ? Eigen::Vector3d(1, 0, 1) : Eigen::Vector3d(0, 0, 1))).norm(), 1e-6);
  }
}

TEST(Bridge, StopsAfterTheEndAtRest) {
  Flight flight;
  const Trajectory trajectory = quintic_to(at_rest({0, 0, 1}), flight.now_us, {2, 1, 1.5}, 3.0);
  flight.fly(trajectory, 0.5);
  flight.run_until(trajectory.end_utime() + 999'999);  // long after the time-out
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  EXPECT_LT((flight.place_of(flight.autopilot.targets.back()) - Eigen::Vector3d(2, 1, 1.5)).norm(), 1e-6);
  EXPECT_EQ(flight.autopilot.targets.back().velocity, (std::array<float, 3>{0, 0, 0}));
  const std::size_t targets = flight.targets(), heartbeats = flight.autopilot.heartbeats.size();
  flight.run_for(10.0);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kEnded);
  EXPECT_EQ(flight.targets(), targets);
  EXPECT_EQ(flight.autopilot.heartbeats.size(), heartbeats + 10);  // itself it is there

  flight.announce(Trajectory::hover(2, flight.now_us, {5, 5, 1}));  // no reason to lead the robot again
  flight.run_for(1.0);
  EXPECT_EQ(flight.targets(), targets);
  flight.say_setpoint(at_rest({2, 1, 1.5}));
  EXPECT_EQ(flight.targets(), targets + 1);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kSetpoints);
}

TEST(Bridge, WhereTheRobotRestsItStopsAfterTheTimeout) {
  BridgeConfig config = make_config();
  config.timeout_s = 2.0;
  Flight flight(config);
  flight.fly(Trajectory::hover(1, flight.now_us, {0, 0, 1}), 0.5);
  const std::int64_t last_us = flight.now_us - 10'000;
  flight.run_until(last_us + 2'999'999);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  flight.run_until(last_us + 3'000'000);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kEnded);
}

TEST(Bridge, GoesOnWhileTheBroadcastDaemonAnnounces) {
  Flight flight;
  const Trajectory hover = Trajectory::hover(1, flight.now_us, {0, 0, 1});
  flight.say_setpoint(hover.at(flight.now_us));
  for (int i = 0; i < 100; ++i) {
    flight.announce(hover);
    flight.run_for(0.1);
  }
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  EXPECT_NEAR(static_cast<double>(flight.targets()), 996, 2);
}

TEST(Bridge, WithoutATrajectoryThereIsNothingToFollow) {
  Flight flight;
  flight.say_setpoint(at_rest({0, 0, 1}));
  flight.run_for(1.0);
  EXPECT_EQ(flight.targets(), 1u);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kLost);
  flight.announce(Trajectory::hover(1, flight.now_us, {0, 0, 1}));
  EXPECT_EQ(flight.targets(), 2u);
}

TEST(Bridge, AClockThatIsSetBackStopsNothing) {
  Flight flight;
  flight.fly(Trajectory::hover(1, flight.now_us, {0, 0, 1}), 0.5);
  flight.now_us -= 3600'000'000;
  const std::size_t targets = flight.targets();
  flight.step();
  flight.fly(Trajectory::hover(2, flight.now_us, {0, 0, 1}), 3.0);
  EXPECT_GE(flight.targets(), targets + 299);
  EXPECT_EQ(flight.autopilot.heartbeats.size(), 4u);
  flight.run_for(0.1);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
}

TEST(Bridge, TellsTheRobotsState) {
  BridgeConfig config = make_config();
  config.origin = {10, 0, 0};
  config.state_delay_s = 0.02;
  Flight flight(config);
  flight.hear(mavlink::LocalPositionNed{100, {1, 2, -3}, {0.1f, 0.2f, -0.3f}});
  EXPECT_EQ(flight.refused(StateRefusal::kNoAttitude), 1);
  mavlink::Attitude attitude;
  attitude.time_boot_ms = 105;
  attitude.yaw = 0.5f;
  flight.hear(attitude);
  flight.hear(mavlink::LocalPositionNed{110, {1, 2, -3}, {0.5f, 0.25f, -0.75f}});
  ASSERT_EQ(flight.states(), 1);
  const auto state = flight.out.newest<robot_state_t>(channel::kRobotState);
  EXPECT_EQ(state.header.robot_id, kRobot);
  EXPECT_EQ(state.header.boot, kBoot);
  EXPECT_EQ(state.header.utime, flight.now_us - 20'000);
  EXPECT_EQ(Eigen::Vector3d(state.position), Eigen::Vector3d(11, -2, 3));
  EXPECT_EQ(Eigen::Vector3d(state.velocity), Eigen::Vector3d(0.5, -0.25, 0.75));
  EXPECT_EQ(state.yaw, -0.5);

  const float nan = std::numeric_limits<float>::quiet_NaN();
  flight.hear(mavlink::LocalPositionNed{120, {1, nan, -3}, {}});
  flight.hear(mavlink::LocalPositionNed{130, {1, 2, 3}, {0, 1e20f, 0}});
  attitude.time_boot_ms = 140;
  attitude.yaw = nan;
  flight.hear(attitude);
  EXPECT_EQ(flight.refused(StateRefusal::kValue), 3);
  flight.run_for(0.51);
  flight.hear(mavlink::LocalPositionNed{640, {1, 2, 3}, {}});
  EXPECT_EQ(flight.refused(StateRefusal::kNoAttitude), 2);
  EXPECT_EQ(flight.states(), 1);

  config.publish_state = false;
  Flight silent(config);
  silent.autopilot.report_state(100);
  EXPECT_EQ(silent.states(), 0);
}

TEST(Bridge, RefusesOldStatesAndNoticesARestart) {
  Flight flight;
  const auto report = [&](std::uint32_t time_ms) {
    flight.run_for(0.02);
    const int before = flight.states();
    flight.autopilot.report_state(time_ms);
    return flight.states() - before;
  };
  EXPECT_EQ(report(60'000), 1);
  EXPECT_EQ(report(60'000), 0);
  EXPECT_EQ(report(59'980), 0);
  EXPECT_EQ(report(60'020), 1);
  EXPECT_EQ(flight.refused(StateRefusal::kOld), 4);  // attitudes as well
  EXPECT_EQ(report(30'000), 0);                      // a stray
  EXPECT_EQ(report(60'040), 1);
  EXPECT_EQ(flight.node.report().restarts, 0);
  EXPECT_EQ(report(500), 0);
  EXPECT_EQ(report(520), 1);
  EXPECT_EQ(flight.node.report().restarts, 1);
  EXPECT_EQ(report(510), 0);
  EXPECT_EQ(report(540), 1);
  EXPECT_EQ(flight.node.report().restarts, 1);

  Flight old;  // on for 49.7 days, when its clock begins anew
  old.autopilot.report_state(0xFFFFFFF0u);
  old.autopilot.report_state(4);
  EXPECT_EQ(old.states(), 2);
  EXPECT_EQ(old.node.report().restarts, 0);
}

TEST(Bridge, KnowsWhetherTheControllerIsThereAndArmed) {
  Flight flight;
  EXPECT_FALSE(flight.node.report().heartbeat_us);
  flight.autopilot.report_heartbeat(false);
  EXPECT_EQ(flight.node.report().heartbeat_us, flight.now_us);
  EXPECT_FALSE(flight.node.report().armed());
  flight.autopilot.report_heartbeat(true);
  EXPECT_TRUE(flight.node.report().armed());
  mavlink::Heartbeat camera;
  camera.autopilot = mavlink::Heartbeat::kNone;
  flight.hear(camera);
  EXPECT_TRUE(flight.node.report().armed());
}

TEST(BridgeLog, TellsChangesOnceAndTheStateOfThingsEveryTenSeconds) {
  Flight flight;
  BridgeLog log;
  LinkReport link;
  const auto lines = [&] {
    std::string all;
    for (const LogLine& line : log.update(flight.now_us, flight.node.report(), link, flight.ears))
      all += (line.warning ? "! " : "- ") + line.text + "\n";
    return all;
  };
  EXPECT_EQ(lines(), "");
  link.connected = true;
  link.peer = "127.0.0.1:14580";
  flight.autopilot.report_heartbeat(false);
  EXPECT_EQ(lines(),
            "- link to 127.0.0.1:14580\n- the controller is there\n- the controller is disarmed, offboard mode\n");
  flight.autopilot.report_heartbeat(true);
  EXPECT_EQ(lines(), "- the controller is armed, offboard mode\n");
  flight.fly(Trajectory::hover(1, flight.now_us, {0, 0, 1}), 0.5);
  EXPECT_EQ(lines(), "- following setpoints\n");
  EXPECT_EQ(lines(), "");
  flight.run_for(0.2);
  EXPECT_EQ(lines(), "! following the committed trajectory\n");
  flight.run_for(4.0);
  EXPECT_EQ(lines(),
            "! the controller is silent\n! broadcast daemon gone, trajectory ended: nothing is sent any more\n");
  flight.run_for(5.3);
  flight.autopilot.report_state(100);
  flight.autopilot.report_state(90);
  const std::string summary = lines();
  for (const char* part : {"controller heard 10.0 s ago, armed, offboard mode", "50 setpoints (0 late)",
                           "refused from the bus: none", "states: old 2", "1 states"})
    EXPECT_NE(summary.find(part), summary.npos) << part << "\n" << summary;
  EXPECT_EQ(lines(), "");
  link.connected = false;
  link.peer = "";
  EXPECT_EQ(lines(), "! lost 127.0.0.1:14580; it is tried again every second\n");
}

// Through the bridge, over the wire, to the autopilot and back: the robot is where its setpoints were.
TEST(Bridge, ARecordedFlightComesBackAsItWasMeant) {
  TemporaryDirectory directory;
  const World world = make_world(Task::kCircle, Environment::kPure, 6, 1, {.robots = 2, .circle_m = 2.5});
  BusLog logs(directory.path(), {0, 1});
  FlightOptions options;
  options.time_limit_s = 4.0;
  run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
  logs.close();

  BridgeConfig config = make_config();
  config.robot_id = 1;
  config.north_rad = 0.7;
  config.origin = {3, -4, 0.5};
  Flight flight(config);
  LcmLog log(directory / "robot1.lcm");
  int setpoints = 0;
  double farthest_m = 0.0;
  for (LogEvent event; log.next(&event);) {
    if (event.channel != channel::kSetpoint && event.channel != channel::kOwnTrajectory) continue;
    if (flight.now_us > event.utime || setpoints == 0) flight.now_us = event.utime;  // the flight's own time
    flight.run_until(event.utime);
    flight.deliver(BusId::kOnboard, event.channel, event.bytes);
    if (event.channel != channel::kSetpoint) continue;
    setpoint_t setpoint;
    ASSERT_EQ(decode(event.bytes, &setpoint), Refusal::kNone);
    ++setpoints;
    flight.autopilot.report_state(static_cast<std::uint32_t>(10 * setpoints));
    const auto state = flight.out.newest<robot_state_t>(channel::kRobotState);
    flight.out.letters.clear();
    const Eigen::Vector3d meant(setpoint.position);
    ASSERT_LT((Eigen::Vector3d(state.position) - meant).norm(), 2e-6) << setpoints;
    ASSERT_LT((Eigen::Vector3d(state.velocity) - Eigen::Vector3d(setpoint.velocity)).norm(), 1e-6) << setpoints;
    ASSERT_NEAR(std::remainder(state.yaw - setpoint.yaw, 2 * std::numbers::pi), 0.0, 1e-6) << setpoints;
    ASSERT_EQ(state.header.utime, event.utime);
    farthest_m = std::max(farthest_m, (meant - world.robots[1].start).norm());
  }
  EXPECT_GT(setpoints, 400);
  EXPECT_GT(farthest_m, 2.0);
  EXPECT_EQ(flight.node.report().setpoints, setpoints);
  EXPECT_EQ(flight.node.report().samples, 0);
  EXPECT_EQ(flight.node.report().refused.total(), 0);
  EXPECT_EQ(flight.node.report().states, setpoints);
}

}  // namespace
}  // namespace swarm::test
