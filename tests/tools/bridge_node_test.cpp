// The bridge leads the flight controller: along setpoints, the committed trajectory, and to its end.
#include <limits>

#include "tests/support/bridge_flight.h"

namespace swarm::test {
namespace {

using sogm_swarm::announcement_t;
using sogm_swarm::setpoint_t;

TEST(Bridge, SaysThatItIsThereAndNothingElseBeforeASetpoint) {
  Flight flight;
  flight.announce(Trajectory::hover(1, flight.now, {0, 0, 1}));
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

// Commands take 0.02 s to act, the acceleration lags by 0.07 s, air holds back by 0.3 /s.
TEST(Bridge, TellsTheControllerWhatFitsTheVehicle) {
  BridgeConfig config = make_config();
  config.fit = {0.02, 0.07, 0.3};
  Flight flight(config);
  const MotionState state{{1, 2, 3}, {1, -2, 0.5}, {4, 0, -1}, {10, 20, -30}};
  setpoint_t setpoint = flight.make_setpoint(state);
  Eigen::Map<Eigen::Vector3d>(setpoint.jerk) = state.jerk;
  flight.send(channel::kSetpoint, setpoint);
  ASSERT_EQ(flight.targets(), 1u);
  const mavlink::SetPositionTargetLocalNed& target = flight.autopilot.targets[0];
  EXPECT_NEAR(target.position[0], 1 + 0.02 + 0.0002 * 4 + 0.02 * 0.02 * 0.02 / 6 * 10, 1e-6);
  EXPECT_NEAR(target.velocity[0], 1 + 0.08 + 0.0002 * 10, 1e-6);
  EXPECT_NEAR(target.acceleration[0], 4 + 0.2 + 0.7 + 0.3 * (1.08 + 0.002), 1e-6);
  EXPECT_NEAR(target.acceleration[2], -(-1 - 0.6 - 2.1 + 0.3 * (0.5 - 0.02 - 0.006)), 1e-5);
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
    send([&](setpoint_t& s) { s.jerk[2] = bad; });
    send([&](setpoint_t& s) { s.yaw_rate = bad; });
    EXPECT_EQ(flight.refused(Refusal::kValue), values += 5) << bad;
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
    announcement_t message = flight.make_announcement(Trajectory::hover(1, flight.now, {0, 0, 1}));
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
  const Trajectory trajectory = quintic_to(at_rest({0, 0, 1}), flight.now, {2, 1, 1.5}, 3.0);
  flight.fly(trajectory, 1.0);
  const Utime last_setpoint = flight.now - 10ms;
  ASSERT_EQ(flight.targets(), 100u);
  flight.run_until(last_setpoint + 49'999us);
  ASSERT_EQ(flight.targets(), 100u);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kSetpoints);
  flight.run_until(last_setpoint + 50ms);
  ASSERT_EQ(flight.targets(), 101u);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  flight.run_for(1.5);
  EXPECT_NEAR(static_cast<double>(flight.node.report().samples), 150, 1);
  for (std::size_t i = 1; i < flight.targets(); ++i) {
    const auto &before = flight.autopilot.targets[i - 1], &target = flight.autopilot.targets[i];
    const Utime utime = kStart + target.time_boot_ms * 1ms;
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
  const Trajectory trajectory = quintic_to(at_rest({0, 0, 1}), flight.now, {2, 1, 1.5}, 3.0);
  flight.fly(trajectory, 0.5);
  flight.run_for(0.3);
  const std::size_t targets = flight.targets();
  setpoint_t late = flight.make_setpoint(trajectory.at(flight.now - 20ms));
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
    const Trajectory first = Trajectory::hover(1, flight.now, {0, 0, 1});
    Trajectory next = quintic_to(at_rest({0, 0, 1}), flight.now + 300ms, {1, 0, 1}, 1.0);
    next.set_seq(2);
    announcement_t message = flight.make_announcement(first);
    message.pending = next.to_wire();
    message.pending_state = committed ? announcement_t::kCommitted : announcement_t::kAnnounced;
    message.pending_stamp = to_us(flight.now);
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
  const Trajectory trajectory = quintic_to(at_rest({0, 0, 1}), flight.now, {2, 1, 1.5}, 3.0);
  flight.fly(trajectory, 0.5);
  flight.run_until(trajectory.end_utime() + 999'999us);  // long after the time-out
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  EXPECT_LT((flight.place_of(flight.autopilot.targets.back()) - Eigen::Vector3d(2, 1, 1.5)).norm(), 1e-6);
  EXPECT_EQ(flight.autopilot.targets.back().velocity, (std::array<float, 3>{0, 0, 0}));
  const std::size_t targets = flight.targets(), heartbeats = flight.autopilot.heartbeats.size();
  flight.run_for(10.0);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kEnded);
  EXPECT_EQ(flight.targets(), targets);
  EXPECT_EQ(flight.autopilot.heartbeats.size(), heartbeats + 10);  // itself it is there

  flight.announce(Trajectory::hover(2, flight.now, {5, 5, 1}));  // no reason to lead the robot again
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
  flight.fly(Trajectory::hover(1, flight.now, {0, 0, 1}), 0.5);
  const Utime last = flight.now - 10ms;
  flight.run_until(last + 2'999'999us);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  flight.run_until(last + 3s);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kEnded);
}

TEST(Bridge, GoesOnWhileTheBroadcastDaemonAnnounces) {
  Flight flight;
  const Trajectory hover = Trajectory::hover(1, flight.now, {0, 0, 1});
  flight.say_setpoint(hover.at(flight.now));
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
  flight.announce(Trajectory::hover(1, flight.now, {0, 0, 1}));
  EXPECT_EQ(flight.targets(), 2u);
}

TEST(Bridge, AClockThatIsSetBackStopsNothing) {
  Flight flight;
  flight.fly(Trajectory::hover(1, flight.now, {0, 0, 1}), 0.5);
  flight.now -= 1h;
  const std::size_t targets = flight.targets();
  flight.step();
  flight.fly(Trajectory::hover(2, flight.now, {0, 0, 1}), 3.0);
  EXPECT_GE(flight.targets(), targets + 299);
  EXPECT_EQ(flight.autopilot.heartbeats.size(), 4u);
  flight.run_for(0.1);
  EXPECT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
}

// Without setpoints the bridge flies on by itself, whatever becomes of the clock.
TEST(Bridge, TheCommittedTrajectoryGoesOnWhenTheClockIsSetBack) {
  Flight flight;
  const Trajectory trajectory = quintic_to(at_rest({0, 0, 1}), flight.now, {3, 0, 1}, 3.0);
  const Utime start = flight.now;
  flight.fly(trajectory, 0.5);
  flight.run_for(0.5);
  ASSERT_EQ(flight.node.report().led_by, LedBy::kTrajectory);
  const std::size_t targets = flight.targets();
  flight.now -= 5s;
  flight.step();
  flight.run_for(1.0);
  EXPECT_NEAR(static_cast<double>(flight.targets() - targets), 100.0, 2.0);
  for (std::size_t i = 1; i < flight.targets(); ++i) {
    const auto& before = flight.autopilot.targets[i - 1];
    const auto& target = flight.autopilot.targets[i];
    ASSERT_GE(target.time_boot_ms, before.time_boot_ms);
    EXPECT_LT((flight.place_of(target) - trajectory.at(start + target.time_boot_ms * 1ms).position).norm(), 0.01)
        << target.time_boot_ms;
  }
}

// Asked, it takes no step of the clock before the robot rests, as the broadcast daemon whose setpoints it follows.
TEST(Bridge, TakesAStepOfTheClockAtRest) {
  for (const Duration step : {-5000ms, 500ms, 10'000ms}) {
    SCOPED_TRACE(to_seconds(step));
    Flight flight;
    const Utime start = flight.now;
    const Trajectory trajectory = quintic_to(at_rest({0, 0, 1}), start, {3, 0, 1}, 2.005);
    flight.fly(trajectory, 1.0);
    flight.wall_ahead = step;
    flight.fly(trajectory, 1.0);
    EXPECT_EQ(flight.now, start + 2s);
    EXPECT_EQ(flight.refused(Refusal::kTime), 0);
    flight.now += 5ms;
    flight.step();
    EXPECT_EQ(flight.wall_ahead, Duration());
    EXPECT_EQ(flight.now, start + 2005ms + step);
    const Trajectory hover = Trajectory::hover(2, flight.now, {3, 0, 1});
    flight.fly(hover, 1.0);
    EXPECT_EQ(flight.refused(Refusal::kTime), 0);
    EXPECT_NEAR(static_cast<double>(flight.targets()), 300.0, 15.0);
    for (std::size_t i = 1; i < flight.targets(); ++i) {
      const auto& target = flight.autopilot.targets[i];
      const std::int64_t since_ms = target.time_boot_ms - flight.autopilot.targets[i - 1].time_boot_ms;
      EXPECT_GE(since_ms, 0);
      EXPECT_LE(since_ms, 60);
      EXPECT_LT((flight.place_of(target) - trajectory.at(start + target.time_boot_ms * 1ms).position).norm(), 0.01);
    }
    EXPECT_EQ(flight.node.report().led_by, LedBy::kSetpoints);
  }
}

}  // namespace
}  // namespace swarm::test
