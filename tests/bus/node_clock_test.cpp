// The time of nodes while the wall clock drifts, is slewed and is stepped; and the numbers of starts.
#include "lcmtypes/bus/node_clock.h"

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <string>

#include "lcmtypes/bus/boot.h"

namespace swarm {
namespace {

constexpr std::int64_t kBooted_us = 1'000'000'000, kWall_us = 1'700'000'000'000'000;

// A computer whose wall clock does as it is told, read a hundred times a second.
struct Computer {
  std::int64_t steady_us = kBooted_us, wall_us = kWall_us;
  NodeClock clock{ClockReading{kBooted_us, kWall_us}};
  std::int64_t time_us = kWall_us, steps = 0;
  double longest_s = 0.0, shortest_s = 1e9;  // by the node's time, per second of the steady clock

  // `rate`: of the wall clock, seconds per second.
  void run(double seconds, double rate = 1.0, std::int64_t period_us = 10'000) {
    const std::int64_t begun_us = steady_us, wall_begun_us = wall_us;
    while (steady_us < begun_us + std::llround(1e6 * seconds)) {
      steady_us += period_us;
      wall_us = wall_begun_us + std::llround(rate * static_cast<double>(steady_us - begun_us));
      const std::int64_t before_us = time_us;
      time_us = clock.read({steady_us, wall_us});
      const double took = static_cast<double>(time_us - before_us) / static_cast<double>(period_us);
      longest_s = std::max(longest_s, took);
      shortest_s = std::min(shortest_s, took);
      steps += clock.step_us() != 0;
    }
  }
  void expect_steady() const {
    EXPECT_LE(longest_s, 1.101);
    EXPECT_GE(shortest_s, 0.899);
  }
};

TEST(NodeClock, FollowsAClockThatDrifts) {
  for (const double rate : {1.0, 1.0 + 5e-5, 1.0 - 5e-4, 1.08, 0.92}) {
    for (const std::int64_t period_us : {7, 100, 10'000, 100'000}) {
      SCOPED_TRACE(std::to_string(rate) + " every " + std::to_string(period_us));
      Computer computer;
      computer.run(period_us == 7 ? 2.0 : 100.0, rate, period_us);
      EXPECT_LE(std::abs(computer.time_us - computer.wall_us), 2);
      EXPECT_EQ(computer.steps, 0);
    }
  }
}

TEST(NodeClock, TakesASmallStepBySlewing) {
  for (const std::int64_t step_us : {-19'000, 3, 15'000}) {
    Computer computer;
    computer.run(1.0);
    computer.wall_us += step_us;
    computer.run(0.1);
    EXPECT_EQ(std::abs(computer.time_us - computer.wall_us), std::max<std::int64_t>(std::abs(step_us) - 10'000, 0));
    computer.run(0.2);
    EXPECT_EQ(computer.time_us, computer.wall_us);
    EXPECT_EQ(computer.steps, 0);
    computer.expect_steady();
  }
}

// 5 s back, half a second forward, and a leap second, for which the clock is set back by one.
TEST(NodeClock, GoesOnThroughAStepUntilItIsAdopted) {
  for (const int step_us : {-5'000'000, 500'000, -1'000'000, -20'001, 2'000'000'000}) {
    SCOPED_TRACE(step_us);
    Computer computer;
    computer.run(1.0);
    const std::int64_t offset_us = computer.time_us - computer.steady_us;
    computer.wall_us += step_us;
    computer.run(3.0);
    computer.expect_steady();
    EXPECT_EQ(computer.time_us - computer.steady_us, offset_us);
    EXPECT_EQ(computer.clock.step_us(), step_us);
    computer.clock.adopt_step();
    EXPECT_EQ(computer.clock.step_us(), 0);
    EXPECT_EQ(computer.clock.read({computer.steady_us, computer.wall_us}), computer.wall_us);
    computer.time_us = computer.wall_us;
    computer.run(1.0);
    computer.expect_steady();
    EXPECT_EQ(computer.time_us, computer.wall_us);
  }
}

TEST(NodeClock, ForgetsAStepThatWasTakenBack) {
  Computer computer;
  computer.run(1.0);
  computer.wall_us += 3'000'000;
  computer.run(1.0);
  EXPECT_EQ(computer.clock.step_us(), 3'000'000);
  computer.wall_us -= 3'000'000;
  computer.run(1.0);
  EXPECT_EQ(computer.clock.step_us(), 0);
  EXPECT_EQ(computer.time_us, computer.wall_us);
  computer.expect_steady();
}

TEST(NodeClock, TheComputersClocksGoOn) {
  const std::int64_t steady = steady_us(), wall_us = wall_utime();
  const std::chrono::duration<double> system = std::chrono::system_clock::now().time_since_epoch();
  EXPECT_NEAR(1e-6 * static_cast<double>(wall_us), system.count(), 1.0);
  EXPECT_GT(steady, 0);
  EXPECT_GE(steady_us(), steady);
  const ClockReading reading = read_clocks();
  EXPECT_GE(reading.steady_us, steady);
  EXPECT_NEAR(static_cast<double>(reading.wall_us - reading.steady_us), static_cast<double>(wall_us - steady), 1e6);
}

TEST(NewBoot, GrowsAtEveryStartWithinTheSameSecond) {
  std::int32_t before = 0;
  const std::int64_t begun_us = steady_us();
  for (int i = 0; i < 5; ++i) {
    const std::int32_t boot = new_boot();
    EXPECT_GT(boot, before);
    before = boot;
  }
  EXPECT_LT(steady_us() - begun_us, 1'000'000);
  EXPECT_NEAR(before, 20e-6 * static_cast<double>(steady_us()), 20.0);
}

}  // namespace
}  // namespace swarm
