// What goes wrong in flight (daemons that crash, clocks that are set, robots that something runs into): how it is asked
// for, and that the swarm gets over it.
#include "swarm_sim/hosts/faults.h"

#include <gtest/gtest.h>

#include "lcmtypes/bus/option_set.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

TEST(Faults, KillsAreRead) {
  EXPECT_TRUE(parse_kills("").empty());
  const std::vector<Kill> kills = parse_kills("planner:2@4.5,broadcast:0@1-3,map:11@0,keeper@5-7");
  ASSERT_EQ(kills.size(), 4u);
  EXPECT_STREQ(kDaemons[kills[0].daemon], "planner");
  EXPECT_EQ(kills[0].robot_id, 2);
  EXPECT_EQ(kills[0].at_s, 4.5);
  EXPECT_EQ(kills[0].back_s, 4.6);
  EXPECT_STREQ(kDaemons[kills[1].daemon], "broadcast");
  EXPECT_EQ(kills[1].back_s, 3.0);
  EXPECT_STREQ(kDaemons[kills[2].daemon], "map");
  EXPECT_EQ(kills[2].robot_id, 11);
  EXPECT_EQ(kills[3].daemon, Kill::kKeeper);
  EXPECT_EQ(kills[3].back_s, 7.0);
}

TEST(Faults, KillsThatMakeNoSenseAreRefused) {
  for (const char* text :
       {"planner", "planner:1", "planner@1", "planner:1@", "plan:1@2", "planner:x@2", "planner:1@2-1", "planner:1@2-2",
        "planner:1@-2", "planner:1@1-2-3", "planner:1@2,", "planner:1@2@3", "planner:1:2@3", "planner:1@nan",
        "map:1@3-6,map:1@4-5", "map:1@3,map:1@3", "keeper", "keeper:1@3", "keeper@3-5,keeper@4"}) {
    SCOPED_TRACE(text);
    EXPECT_THROW((void)parse_kills(text), OptionError);
  }
}

RunReport fly(const std::string& kills, double delay_ms = 0.0) {
  FlightOptions options;
  options.kills = parse_kills(kills);
  options.planner.calm_period_s = 0.0;  // a plan for each map, so that missing ones show
  options.link.delay_ms = delay_ms;
  options.link.loss = delay_ms > 0.0 ? 0.2 : 0.0;
  const World world = make_world(Task::kCross, Environment::kMixed, 20, 7);
  return run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
}

TEST(Faults, EveryDaemonMayCrashOnce) {
  for (const char* daemon : daemons_in({})) {
    for (const double delay_ms : kSanitized ? std::vector{100.0} : std::vector{0.0, 100.0}) {
      SCOPED_TRACE(testing::Message() << daemon << ", " << delay_ms << " ms");
      std::string kills;
      for (int robot = 0; robot < 4; ++robot)
        kills += (robot > 0 ? "," : "") + std::string(daemon) + ":" + std::to_string(robot) + "@" +
                 std::to_string(2 + robot);
      const RunReport report = fly(kills, delay_ms);
      EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
      EXPECT_EQ(report.commit_conflicts, 0);
    }
  }
}

// Three seconds without: the robot flies to the end of what it announced and waits there, the others pass.
TEST(Faults, WhoeverIsDownWaitsWhereItPromisedTo) {
  const double usual_s = *fly("").robots[1].verdict.flight_time_s;
  for (const char* daemon : daemons_in({})) {
    SCOPED_TRACE(daemon);
    const RunReport report = fly(std::string(daemon) + ":1@3-6");
    EXPECT_TRUE(report.touches.empty()) << summary_table(report);
    EXPECT_EQ(report.commit_conflicts, 0);
    EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
    EXPECT_GT(report.robots[1].verdict.flight_time_s.value_or(0.0), usual_s + 0.8);
    if (std::string(daemon) == "broadcast") continue;  // the planner goes on, without an answer
    EXPECT_LT(report.robots[1].plan_rate_hz, report.robots[0].plan_rate_hz - 1.0);
  }
}

// A robot that sees nothing more makes no map: it flies to the end of what it announced and waits there until it sees.
TEST(Faults, WhoIsBlindWaitsWhereItPromisedTo) {
  if (kSanitized) GTEST_SKIP() << "scans take too long";
  World world = make_world(Task::kCross, Environment::kPure, 5, 3);
  world.sensor.kind = "lidar";
  const auto fly_by_sight = [&](const std::string& kills) {
    FlightOptions options;
    options.kills = parse_kills(kills);
    return run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
  };
  const RunReport usual = fly_by_sight(""), blind = fly_by_sight("perception:1@2-5");
  for (const RunReport* report : {&usual, &blind}) {
    EXPECT_EQ(report->outcome, Outcome::kSuccess) << summary_table(*report);
    EXPECT_TRUE(report->touches.empty());
  }
  EXPECT_GT(blind.robots[1].verdict.flight_time_s.value_or(0.0), *usual.robots[1].verdict.flight_time_s + 1.0);
}

// It rests at the end of what it has committed to, as its daemons wait, and goes on.
TEST(Faults, ARobotThatIsNotToldWhereItIsWaits) {
  const World world = make_world(Task::kCross, Environment::kPure, 0, 1);
  const auto fly_with = [&](const char* outages) {
    FlightOptions options;
    options.state_outages = parse_outages(outages);
    return run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
  };
  const RunReport usual = fly_with(""), lost = fly_with("1:2:7");
  for (const RunReport* report : {&usual, &lost})
    EXPECT_EQ(report->outcome, Outcome::kSuccess) << summary_table(*report);
  EXPECT_GT(lost.robots[1].verdict.flight_time_s.value_or(0.0), *usual.robots[1].verdict.flight_time_s + 2.0);
  EXPECT_THROW((void)fly_with("9:1:2"), OptionError);
}

// Who is in nobody's roster flies through the middle of the others: they keep off each other without a word.
TEST(Faults, StrangersAreKeptOff) {
  for (int seed = 1; seed <= (kSanitized ? 2 : 6); ++seed) {
    FlightOptions options;
    options.strangers = {seed % 4};
    const World world = make_world(Task::kCross, Environment::kMixed, 10, static_cast<std::uint64_t>(seed));
    const RunReport report = run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
    EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
    for (const RobotReport& robot : report.robots)
      EXPECT_EQ(robot.refused[static_cast<std::size_t>(Refusal::kRobot)], 0) << "nobody is refused";
  }
}

// The robots wait for a silent one, an obstacle comes: they get out of its way without its word.
TEST(Faults, WhoeverWaitsForASilentPeerIsNotHit) {
  std::int64_t forced = 0;
  for (int seed = 3; seed <= (kSanitized ? 4 : 8); ++seed) {
    FlightOptions options;
    options.link.outages = parse_outages("0:3:9");
    const World world = make_world(Task::kCross, Environment::kMixed, 20, static_cast<std::uint64_t>(seed));
    const RunReport report = run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
    EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
    EXPECT_EQ(report.commit_conflicts, 0);
    forced += report.forced_commits;
  }
  EXPECT_GT(forced, 0);
}

// Whichever robot's broadcaster is dead for good, on the way across the circle: the others give it up and arrive.
TEST(Faults, NoRobotStopsTheOthers) {
  constexpr int kRobots = 6;
  const World world = make_world(Task::kCircle, Environment::kEmpty, 0, 1, {.robots = kRobots, .circle_m = 4.0});
  for (int dead = 0; dead < kRobots; ++dead) {
    SCOPED_TRACE(dead);
    FlightOptions options;
    options.kills = parse_kills("broadcast:" + std::to_string(dead) + "@1-100");
    options.time_limit_s = 20.0;
    const RunReport report = run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
    EXPECT_TRUE(report.touches.empty()) << summary_table(report);
    EXPECT_EQ(report.commit_conflicts, 0);
    for (int robot = 0; robot < kRobots; ++robot) {
      const bool arrived = report.robots[static_cast<std::size_t>(robot)].verdict.flight_time_s.has_value();
      EXPECT_EQ(arrived, robot != dead) << robot;
    }
    if (kSanitized) return;
  }
}

// Robots that fly close together are thrown off their courses: they go on from where they are.
TEST(Faults, WhoIsShovedOffItsCourseGoesOn) {
  World world = make_world(Task::kCircle, Environment::kEmpty, 0, 1, {.robots = 8, .circle_m = 5.0});
  world.vehicle.kind = "quadrotor";
  world.vehicle.shove_mps = 4.0;
  const RunReport report = run_lockstep(world, nullptr, {}, {}, nullptr, nullptr, nullptr);
  EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
  EXPECT_EQ(report.commit_conflicts, 0);
  EXPECT_GT(report.forced_commits, 0);
}

TEST(Faults, KillsOfUnknownRobotsAreRefused) {
  EXPECT_THROW((void)fly("map:9@1"), OptionError);
  EXPECT_THROW((void)fly("perception:0@1"), OptionError) << "it has none";
}

TEST(Faults, ClocksThatAreSetAreRead) {
  EXPECT_TRUE(parse_clock_steps("").empty());
  const std::vector<ClockStep> steps = parse_clock_steps("2:4.5:-3,0:1:0.05");
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_EQ(steps[0].robot_id, 2);
  EXPECT_EQ(steps[0].at_s, 4.5);
  EXPECT_EQ(steps[0].by, -3s);
  EXPECT_EQ(steps[1].by, 50ms);
  for (const char* text : {"1", "1:2", "1:2:3:4", "x:2:3", "1:-2:3", "1:2:--3", "1:2:", "1:2:nan", "1:2:1e7", ","}) {
    SCOPED_TRACE(text);
    EXPECT_THROW((void)parse_clock_steps(text), OptionError);
  }
}

RunReport fly_with_clocks(const std::string& steps) {
  FlightOptions options;
  options.clock_steps = parse_clock_steps(steps);
  options.time_limit_s = 30.0;
  const World world = make_world(Task::kCross, Environment::kPure, 20, 1);
  return run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
}

// In the middle of the flight a robot's clock is set, and three seconds later set right; or all robots' are, for good.
// Everybody arrives, nothing touches, and nobody leaps.
TEST(Faults, ClocksMayBeSetInFlight) {
  for (const char* steps : {"1:3:3,1:6:-3", "1:3:-3,1:6:3", "1:3:0.05,1:6:-0.05", "1:3:0.01", "1:3:3600,1:6:-3600",
                            "0:3:1,1:3:1,2:3:1,3:3:1", "0:3:-1,1:3:-1,2:3:-1,3:3:-1"}) {
    SCOPED_TRACE(steps);
    const RunReport report = fly_with_clocks(steps);
    EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
    EXPECT_EQ(report.commit_conflicts, 0);
    for (const RobotReport& robot : report.robots) EXPECT_LT(robot.verdict.max_position_jump_m, 0.01);
    if (kSanitized) return;
  }
}

// One clock is wrong for good: that robot commits to nothing but what gets it out of an obstacle's way.
TEST(Faults, WithAWrongClockNobodyTouches) {
  for (const char* steps : {"1:3:3", "1:3:-3", "1:3:0.05"}) {
    SCOPED_TRACE(steps);
    const RunReport report = fly_with_clocks(steps);
    EXPECT_TRUE(report.touches.empty()) << summary_table(report);
    EXPECT_FALSE(report.robots[1].verdict.flight_time_s);
    for (const int other : {0, 2, 3}) EXPECT_TRUE(report.robots[other].verdict.flight_time_s) << other;
    if (kSanitized) return;
  }
}

}  // namespace
}  // namespace swarm::test
