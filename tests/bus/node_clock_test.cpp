// The time of nodes while the wall clock drifts, is slewed and is stepped; and the numbers of starts.
#include "lcmtypes/bus/node_clock.h"

#include <chrono>
#include <string>

#include "lcmtypes/bus/boot.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

constexpr ClockReading kBegun = {1000s, kStart};

// A computer whose wall clock does as it is told, read a hundred times a second.
struct Computer {
  ClockReading at = kBegun;
  NodeClock clock{kBegun};
  Utime time = kBegun.wall;
  int steps = 0;
  double longest_s = 0.0, shortest_s = 1e9;  // by the node's time, per second of uptime

  // `rate`: of the wall clock, seconds per second.
  void run(double seconds, double rate = 1.0, Duration period = 10ms) {
    const ClockReading begun = at;
    while (at.uptime < begun.uptime + to_duration(seconds)) {
      at.uptime += period;
      at.wall = begun.wall + to_duration(rate * to_seconds(at.uptime - begun.uptime));
      const Utime before = time;
      time = clock.read(at);
      const double took = to_seconds(time - before) / to_seconds(period);
      longest_s = std::max(longest_s, took);
      shortest_s = std::min(shortest_s, took);
      steps += clock.step() != 0us;
    }
  }
  void expect_steady() const {
    EXPECT_LE(longest_s, 1.101);
    EXPECT_GE(shortest_s, 0.899);
  }
};

TEST(NodeClock, FollowsAClockThatDrifts) {
  for (const double rate : {1.0, 1.0 + 5e-5, 1.0 - 5e-4, 1.08, 0.92}) {
    for (const Duration period : {7us, 100us, Duration(10ms), Duration(100ms)}) {
      SCOPED_TRACE(std::to_string(rate) + " every " + std::to_string(period.count()) + " us");
      Computer computer;
      computer.run(period == 7us ? 2.0 : 100.0, rate, period);
      EXPECT_LE(std::chrono::abs(computer.time - computer.at.wall), 2us);
      EXPECT_EQ(computer.steps, 0);
    }
  }
}

TEST(NodeClock, TakesASmallStepBySlewing) {
  for (const Duration step : {Duration(-19ms), 3us, Duration(15ms)}) {
    Computer computer;
    computer.run(1.0);
    computer.at.wall += step;
    computer.run(0.1);
    EXPECT_EQ(std::chrono::abs(computer.time - computer.at.wall), std::max(std::chrono::abs(step) - 10ms, Duration()));
    computer.run(0.2);
    EXPECT_EQ(computer.time, computer.at.wall);
    EXPECT_EQ(computer.steps, 0);
    computer.expect_steady();
  }
}

// 5 s back, half a second forward, and a leap second, for which the clock is set back by one.
TEST(NodeClock, GoesOnThroughAStepUntilItIsAdopted) {
  for (const Duration step : {Duration(-5s), Duration(500ms), Duration(-1s), -20'001us, Duration(2000s)}) {
    SCOPED_TRACE(step.count());
    Computer computer;
    computer.run(1.0);
    const Utime started = computer.time - computer.at.uptime;
    computer.at.wall += step;
    computer.run(3.0);
    computer.expect_steady();
    EXPECT_EQ(computer.time - computer.at.uptime, started);
    EXPECT_EQ(computer.clock.step(), step);
    computer.clock.adopt_step();
    EXPECT_EQ(computer.clock.step(), 0us);
    EXPECT_EQ(computer.clock.read(computer.at), computer.at.wall);
    computer.time = computer.at.wall;
    computer.run(1.0);
    computer.expect_steady();
    EXPECT_EQ(computer.time, computer.at.wall);
  }
}

TEST(NodeClock, ForgetsAStepThatWasTakenBack) {
  Computer computer;
  computer.run(1.0);
  computer.at.wall += 3s;
  computer.run(1.0);
  EXPECT_EQ(computer.clock.step(), 3s);
  computer.at.wall -= 3s;
  computer.run(1.0);
  EXPECT_EQ(computer.clock.step(), 0us);
  EXPECT_EQ(computer.time, computer.at.wall);
  computer.expect_steady();
}

// Whoever lives by it is asked until he takes the step, and told when there is none any more.
TEST(NodeClock, AStepIsOfferedUntilItIsTaken) {
  using Offer = NodeClock::Offer;
  Computer computer;
  std::vector<Duration> asked;
  const auto offer = [&](bool takes) {
    return computer.clock.offer_step([&](Duration step) { return asked.push_back(step), takes; });
  };
  EXPECT_EQ(offer(true), Offer::kNone);
  computer.at.wall += 3s;
  computer.run(0.1);
  EXPECT_EQ(offer(false), Offer::kRefused);
  EXPECT_EQ(offer(false), Offer::kRefusedAgain);
  EXPECT_EQ(offer(true), Offer::kTaken);
  EXPECT_EQ(computer.clock.read(computer.at), computer.at.wall);
  EXPECT_EQ(offer(true), Offer::kNone);
  EXPECT_EQ(asked, (std::vector<Duration>{3s, 3s, 3s}));
  computer.time = computer.at.wall;
  computer.at.wall -= 1s;
  computer.run(0.1);
  EXPECT_EQ(offer(false), Offer::kRefused);
  computer.at.wall += 1s;
  computer.run(0.1);
  EXPECT_EQ(offer(true), Offer::kNone);
  EXPECT_EQ(offer(true), Offer::kNone);
  EXPECT_EQ(asked, (std::vector<Duration>{3s, 3s, 3s, -1s, 0s}));
}

TEST(NodeClock, TheComputersClocksGoOn) {
  const Duration up = uptime();
  const Utime wall = wall_utime();
  const std::chrono::duration<double> system = std::chrono::system_clock::now().time_since_epoch();
  EXPECT_NEAR(to_seconds(wall.time_since_epoch()), system.count(), 1.0);
  EXPECT_GT(up, 0us);
  EXPECT_GE(uptime(), up);
  const ClockReading reading = read_clocks();
  EXPECT_GE(reading.uptime, up);
  EXPECT_LE(std::chrono::abs(reading.wall - reading.uptime - (wall - up)), 1s);
}

TEST(NewBoot, GrowsAtEveryStartWithinTheSameSecond) {
  std::int32_t before = 0;
  const Duration begun = uptime();
  for (int i = 0; i < 5; ++i) {
    const std::int32_t boot = new_boot();
    EXPECT_GT(boot, before);
    before = boot;
  }
  EXPECT_LT(uptime() - begun, 1s);
  EXPECT_NEAR(before, 20 * to_seconds(uptime()), 20.0);
}

TEST(NewBoot, GrowsByTheWallClockWithinTheSameSecond) {
  const std::int32_t first = new_boot_by_wall_clock(), second = new_boot_by_wall_clock();
  EXPECT_GT(second, first);
  EXPECT_NEAR(second, to_seconds(wall_utime().time_since_epoch()), 2.0);
}

}  // namespace
}  // namespace swarm
