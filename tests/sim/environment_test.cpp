// The environment as nodes: when sensors speak, in every host alike; vehicles that track; clocks; who moves it on.
#include "swarm_sim/environment/environment_node.h"

#include "lcmtypes/bus/channels.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

// As long as setpoints have to arrive.
constexpr Duration kLatency = EnvironmentNode::kLatency;

World two_robots() {
  World world;
  world.robots = {{4, {-3, 0, 1}, {{{3, 0, 1}}}, 0.2}, {2, {3, 0, 1}, {{{-3, 0, 1}}}, 0.2}};
  WorldObstacle& near = world.obstacles.emplace_back();
  near.shape.kind = Shape::Kind::kSphere;
  near.shape.size = {0.5, 0, 0};
  near.center = {-3, 4, 1};
  near.velocity_mps = {0.5, 0};
  world.obstacles.push_back(near);
  world.obstacles[1].center = {-3, 6, 1};
  return world;
}

sogm_swarm::setpoint_t setpoint(int id, Utime utime, const Eigen::Vector3d& p, const Eigen::Vector3d& v) {
  sogm_swarm::setpoint_t message{};
  message.header = make_header(id, 1, utime.time_since_epoch() / 1ms, utime);
  Eigen::Map<Eigen::Vector3d>(message.position) = p;
  Eigen::Map<Eigen::Vector3d>(message.velocity) = v;
  return message;
}

TEST(Environment, SensorsSpeakAtTheirRatesAndOutOfPhase) {
  const World world = two_robots();
  for (std::size_t i = 0; i < 2; ++i) {
    SCOPED_TRACE(i);
    Simulation simulation(world, nullptr, {}, kStart, nullptr);
    simulation.start(kStart + 20ms);
    Bench<EnvironmentNode> bench(simulation, i);
    EXPECT_TRUE(bench.out.letters.empty());  // no tick yet
    bench.run_until(kStart + 1020ms + kLatency);
    const auto states = bench.out.all<sogm_swarm::robot_state_t>(channel::kRobotState);
    ASSERT_EQ(states.size(), 102u);
    for (std::size_t k = 0; k < states.size(); ++k) {
      EXPECT_EQ(to_utime(states[k].header.utime), kStart + static_cast<std::int64_t>(k + 1) * 10ms);
      EXPECT_EQ(states[k].header.robot_id, world.robots[i].id);
    }
    const auto obstacles = bench.out.all<sogm_swarm::obstacles_t>(channel::kObstacles);
    ASSERT_GE(obstacles.size(), 20u);
    for (std::size_t k = 1; k < obstacles.size(); ++k)  // the first one comes at once
      EXPECT_EQ((Duration(obstacles[k].header.utime) + static_cast<std::int64_t>(i) * 10ms) % 50ms, 0us);
    const auto goals = bench.out.all<sogm_swarm::goal_t>(channel::kGoal);
    ASSERT_EQ(goals.size(), 2u);  // from the start on
    EXPECT_EQ(to_utime(goals[0].header.utime), kStart + 20ms);
    EXPECT_EQ(to_utime(goals[1].header.utime), kStart + 1020ms);
    EXPECT_EQ(goals[0].waypoints[0].position[0], world.robots[i].goal().x());
  }
}

TEST(Environment, NoGoalForRobotsThatOthersTell) {
  World world = two_robots();
  world.robots[1].is_told = true;
  for (std::size_t i = 0; i < 2; ++i) {
    Simulation simulation(world, nullptr, {}, kStart, nullptr);
    simulation.start(kStart + 20ms);
    Bench<EnvironmentNode> bench(simulation, i);
    bench.run_for(2.1);
    EXPECT_EQ(bench.out.all<sogm_swarm::goal_t>(channel::kGoal).empty(), i == 1);
  }
}

TEST(Environment, ObstaclesInReachAreSeenAndStandBeforeTheStart) {
  World world = two_robots();
  world.sensor.rate_hz = 100.0;
  Simulation simulation(world, nullptr, {}, kStart, nullptr);
  Bench<EnvironmentNode> bench(simulation, std::size_t{0});
  bench.run_for(0.1);
  auto seen = bench.out.newest<sogm_swarm::obstacles_t>(channel::kObstacles);
  ASSERT_EQ(seen.num_obstacles, 1);  // the other one is too far away
  EXPECT_EQ(seen.obstacles[0].position[0], -3.0);
  EXPECT_EQ(seen.obstacles[0].velocity[0], 0.0);
  EXPECT_EQ(bench.out.count(channel::kGoal), 0);
  simulation.start(simulation.now() + 2 * Simulation::kTick);
  bench.run_for(1.03);
  seen = bench.out.newest<sogm_swarm::obstacles_t>(channel::kObstacles);
  ASSERT_EQ(seen.num_obstacles, 1);
  EXPECT_EQ(seen.obstacles[0].velocity[0], 0.5);
  EXPECT_NEAR(seen.obstacles[0].position[0], -3.0 + 0.5 * simulation.t_s(simulation.now()), 1e-9);
  EXPECT_THROW(simulation.start(simulation.now()), std::invalid_argument);
  EXPECT_THROW(simulation.start(simulation.now() + 1us), std::invalid_argument);
}

// Whoever comes first moves all robots on; each sees the same moment.
TEST(Environment, TheFirstNodeMovesTheWorldOnForAll) {
  const World world = two_robots();
  std::vector<double> ticks;
  Simulation simulation(world, nullptr, {.time_limit_s = 0.5}, kStart,
                        [&](double t_s, const Simulation&) { ticks.push_back(t_s); });
  simulation.start(kStart + 10ms);
  Bench<EnvironmentNode> first(simulation, std::size_t{0}), second(simulation, std::size_t{1});
  first.run_for(0.1 + to_seconds(kLatency));
  EXPECT_EQ(ticks.size(), 10u);
  EXPECT_EQ(second.out.letters.size(), 0u);
  second.now = first.now;
  second.step();
  EXPECT_EQ(ticks.size(), 10u);
  EXPECT_EQ(to_utime(second.out.newest<sogm_swarm::robot_state_t>(channel::kRobotState).header.utime), kStart + 100ms);
  second.run_for(1.0);  // no further than the end
  EXPECT_TRUE(simulation.judge().finished());
  EXPECT_NEAR(ticks.back(), 0.5, 1e-9);
}

// A setpoint of the very moment counts, though it takes a while to arrive.
TEST(Environment, VehiclesAreWhereTheirSetpointsSay) {
  const World world = two_robots();
  Simulation simulation(world, nullptr, {.clock_offset_ms = 8}, kStart, nullptr);
  simulation.start(kStart + 10ms);
  Bench<EnvironmentNode> bench(simulation, std::size_t{0});  // its id is the higher: 4 ms ahead
  const Utime tick = kStart + 50ms, own_time = tick + 4ms;
  bench.run_until(tick + kLatency / 2);
  bench.send(channel::kSetpoint, setpoint(2, own_time, {9, 9, 9}, {0, 0, 0}));  // not his
  bench.send(channel::kSetpoint, setpoint(4, own_time, {-2, 0, 1}, {1, 0, 0}));
  bench.send(channel::kSetpoint, setpoint(4, own_time - 1ms, {9, 9, 9}, {0, 0, 0}));  // overtaken
  bench.run_until(tick + kLatency);
  auto state = bench.out.newest<sogm_swarm::robot_state_t>(channel::kRobotState);
  EXPECT_EQ(to_utime(state.header.utime), own_time);
  EXPECT_EQ(state.position[0], -2.0);
  EXPECT_EQ(state.velocity[0], 1.0);
  bench.run_until(tick + 10ms + kLatency);
  state = bench.out.newest<sogm_swarm::robot_state_t>(channel::kRobotState);
  EXPECT_NEAR(state.position[0], -1.99, 1e-9);
}

// Setpoints of a clock that is not the robot's are of the moment at which they come, in the order of their numbers.
TEST(Environment, AVehicleFliesOnWhereItsClockIsSet) {
  const World world = two_robots();
  Simulation simulation(world, nullptr, {.clock_steps = {{4, 0.1, -3s}, {2, 0.1, 1h}}}, kStart, nullptr);
  simulation.start(kStart + 10ms);
  Bench<EnvironmentNode> bench(simulation, std::size_t{0});
  const auto state = [&] { return bench.out.newest<sogm_swarm::robot_state_t>(channel::kRobotState); };
  bench.run_until(kStart + 200ms);
  const Utime own_time = kStart + 200ms - 3s;
  EXPECT_NEAR(to_ms(to_utime(state().header.utime) - own_time), 0.0, 10.0);
  bench.send(channel::kSetpoint, setpoint(4, kStart + 200ms, {-2, 0, 1}, {1, 0, 0}));  // the node has not taken it yet
  bench.run_until(kStart + 220ms);
  EXPECT_NEAR(state().position[0], -1.98, 0.0101);
  auto later = setpoint(4, own_time + 30ms, {-1, 0, 1}, {1, 0, 0});  // now it has
  later.header.seq = to_us(kStart);
  bench.send(channel::kSetpoint, later);
  bench.run_until(kStart + 240ms);
  EXPECT_NEAR(state().position[0], -0.99, 0.0101);
}

// A late setpoint, as on a busy computer, does not make the vehicle late for good.
TEST(Environment, AVehicleIsOnTimeAgainAfterALateSetpoint) {
  const World world = two_robots();
  Simulation simulation(world, nullptr, {}, kStart, nullptr);
  simulation.start(kStart + 10ms);
  Bench<EnvironmentNode> bench(simulation, std::size_t{0});
  bench.run_until(kStart + 200ms);
  bench.send(channel::kSetpoint, setpoint(4, kStart + 145ms, {-2, 0, 1}, {1, 0, 0}));
  bench.send(channel::kSetpoint, setpoint(4, kStart + 190ms, {-1, 0, 1}, {1, 0, 0}));
  bench.run_until(kStart + 220ms + kLatency);
  EXPECT_NEAR(simulation.vehicles()[0].state().position.x(), -0.97, 1e-9);
}

// Without setpoints it follows what its robot is bound to.
TEST(Environment, AVehicleWithoutSetpointsFliesWhatWasAnnounced) {
  const World world = two_robots();
  Simulation simulation(world, nullptr, {}, kStart, nullptr);
  Bench<EnvironmentNode> bench(simulation, std::size_t{0});
  MotionState from;
  from.position = {-3, 0, 1};
  sogm_swarm::announcement_t announcement{};
  announcement.header = make_header(4, 1, 0, kStart);
  announcement.radius = 0.2f;
  announcement.committed = quintic_to(from, kStart, {-2, 0, 1}, 1.0).to_wire();
  announcement.pending_state = sogm_swarm::announcement_t::kNone;
  bench.send(channel::kOwnTrajectory, announcement);
  bench.send(channel::kSetpoint, setpoint(4, kStart, {-3, 0, 1}, {0, 0, 0}));
  bench.run_for(0.5 + to_seconds(kLatency));
  EXPECT_NEAR(simulation.vehicles()[0].state().position.x(), -2.5, 1e-4);
  bench.run_for(0.6);
  EXPECT_NEAR(simulation.vehicles()[0].state().position.x(), -2.0, 1e-4);
}

}  // namespace
}  // namespace swarm::test
