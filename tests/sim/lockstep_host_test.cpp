// The event queue by itself: who hears what when, clocks, links, crashes.
#include "swarm_sim/hosts/lockstep_host.h"

#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

// What happened to all nodes of a test, in order.
using Diary = std::vector<std::string>;

std::string at(std::int64_t utime) {
  return std::to_string(utime - kStart_us);
}

// Listens to channel A and says its name on channel A every `period_us`, if that is positive.
class Talker : public Node {
 public:
  Talker(std::string name, BusId bus, std::int64_t period_us, Diary& diary)
      : name_(std::move(name)), bus_(bus), period_us_(period_us), diary_(diary) {
    diary_.push_back(name_ + " begins");
  }
  ~Talker() override { diary_.push_back(name_ + " ends"); }

  std::vector<Subscription> subscriptions() const override { return {{bus_, "A"}}; }
  void on_message(std::int64_t now_us, BusId, std::string_view, std::span<const std::uint8_t> bytes, Outbox&) override {
    diary_.push_back(name_ + " hears " + std::string(bytes.begin(), bytes.end()) + " at " + at(now_us));
  }
  std::int64_t step(std::int64_t now_us, Outbox& outbox) override {
    if (period_us_ == 0) return now_us + 1'000'000;
    if (now_us < wake_us_) return wake_us_;
    outbox.publish_bytes(bus_, "A", {reinterpret_cast<const std::uint8_t*>(name_.data()), name_.size()});
    outbox.publish_bytes(bus_, "B", {});  // nobody listens
    return wake_us_ = now_us + period_us_;
  }

 private:
  std::string name_;
  BusId bus_;
  std::int64_t period_us_, wake_us_ = 0;
  Diary& diary_;
};

// Stops the host at a time.
class Stopper : public Node {
 public:
  Stopper(LockstepHost& host, std::int64_t stop_us) : host_(host), stop_us_(stop_us) {}
  std::vector<Subscription> subscriptions() const override { return {}; }
  void on_message(std::int64_t, BusId, std::string_view, std::span<const std::uint8_t>, Outbox&) override {}
  std::int64_t step(std::int64_t now_us, Outbox&) override {
    if (now_us >= stop_us_) host_.stop();
    return now_us < stop_us_ ? stop_us_ : now_us + 1;
  }

 private:
  LockstepHost& host_;
  std::int64_t stop_us_;
};

class LockstepHostTest : public testing::Test {
 protected:
  LockstepHostTest() : host_(kStart_us) {
    host_.add_bus("own", 10);
    host_.add_bus("other", 10);
    host_.listen([this](std::int64_t now_us, BusId, int robot_id, std::string_view channel, auto) {
      if (channel == "A") sent_.push_back(std::to_string(robot_id) + " at " + at(now_us));
    });
  }
  std::size_t add(const LockstepHost::Seat& seat, const std::string& name, std::int64_t period_us,
                  BusId bus = BusId::kOnboard) {
    return host_.add(seat, [=, this](std::int64_t) { return std::make_unique<Talker>(name, bus, period_us, diary_); });
  }
  void run_until(std::int64_t us) {
    host_.add({.onboard = "own"}, [=, this](std::int64_t) { return std::make_unique<Stopper>(host_, kStart_us + us); });
    diary_.clear();
    host_.run();
    EXPECT_EQ(host_.now_us(), kStart_us + us);
  }

  Diary diary_, sent_;
  LockstepHost host_;
};

TEST_F(LockstepHostTest, MessagesStayOnTheirBusAndTakeBusAndWork) {
  add({.robot_id = 0, .onboard = "own", .work_us = 5}, "x", 100);
  add({.robot_id = 0, .onboard = "own"}, "y", 0);
  add({.robot_id = 1, .onboard = "other"}, "z", 0);
  run_until(115);
  EXPECT_EQ(diary_, (Diary{"x hears x at 15", "y hears x at 15", "x hears x at 115", "y hears x at 115"}));
  EXPECT_EQ(sent_, (Diary{"0 at 0", "0 at 100"}));
}

// Seats decide among events of one moment; who sends first is heard first.
TEST_F(LockstepHostTest, TiesAreBrokenBySeatThenByTheOrderOfSending) {
  add({.onboard = "own"}, "x", 100);
  add({.onboard = "own"}, "y", 100);
  run_until(50);
  EXPECT_EQ(diary_, (Diary{"x hears x at 10", "x hears y at 10", "y hears x at 10", "y hears y at 10"}));
}

TEST_F(LockstepHostTest, ANodeSeesItsOwnClock) {
  add({.onboard = "own", .clock_offset_us = 7}, "x", 100);
  add({.onboard = "own", .clock_offset_us = -3}, "y", 0);
  run_until(120);
  EXPECT_EQ(diary_, (Diary{"x hears x at 17", "y hears x at 7", "x hears x at 117", "y hears x at 107"}));
  EXPECT_EQ(sent_, (Diary{"0 at 0", "0 at 100"}));  // by the host's
}

TEST_F(LockstepHostTest, TheLinkStandsBetweenRobotsOnly) {
  std::vector<std::array<int, 2>> asked;
  std::vector<std::int64_t> copies;
  host_.add_bus("air", 20, [&](int from, int to, std::int64_t) {
    asked.push_back({from, to});
    copies = to == 2 ? std::vector<std::int64_t>{5, 1} : std::vector<std::int64_t>{};
    return std::span<const std::int64_t>(copies);
  });
  add({.robot_id = 1, .onboard = "", .swarm = "air"}, "x", 1'000, BusId::kSwarm);
  add({.robot_id = 1, .onboard = "", .swarm = "air"}, "y", 0, BusId::kSwarm);
  add({.robot_id = 2, .onboard = "", .swarm = "air"}, "z", 0, BusId::kSwarm);
  add({.robot_id = 3, .onboard = "", .swarm = "air"}, "lost", 0, BusId::kSwarm);
  run_until(500);
  EXPECT_EQ(asked, (std::vector<std::array<int, 2>>{{1, 2}, {1, 3}}));
  EXPECT_EQ(diary_, (Diary{"x hears x at 20", "y hears x at 20", "z hears x at 21", "z hears x at 25"}));
}

TEST_F(LockstepHostTest, ACrashedNodeHearsAndSaysNothingUntilItIsMadeAgain) {
  add({.onboard = "own"}, "x", 100);
  const std::size_t y = add({.onboard = "own"}, "y", 1'000);
  host_.crash(y, kStart_us + 100, kStart_us + 250);
  run_until(320);
  EXPECT_EQ(diary_, (Diary{"x hears x at 10", "x hears y at 10", "y hears x at 10", "y hears y at 10", "y ends",
                           "x hears x at 110", "x hears x at 210", "y begins", "x hears y at 260", "y hears y at 260",
                           "x hears x at 310", "y hears x at 310"}));
}

TEST_F(LockstepHostTest, ANodeNeedsTheBusesItListensTo) {
  EXPECT_THROW(add({.onboard = "none"}, "x", 0), std::out_of_range);
  EXPECT_THROW(add({.onboard = "own"}, "x", 0, BusId::kSwarm), std::out_of_range);
}

}  // namespace
}  // namespace swarm::test
