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

std::string at(Utime utime) {
  return std::to_string((utime - kStart).count());
}

// Listens to channel A and says its name on channel A every `period`, if that is positive.
class Talker : public Node {
 public:
  Talker(std::string name, BusId bus, Duration period, Diary& diary, bool takes_steps = true)
      : takes_steps_(takes_steps), name_(std::move(name)), bus_(bus), period_(period), diary_(diary) {
    diary_.push_back(name_ + " begins");
  }
  ~Talker() override { diary_.push_back(name_ + " ends"); }

  std::vector<Subscription> subscriptions() const override { return {{bus_, "A"}}; }
  void on_message(Utime now, BusId, std::string_view, std::span<const std::uint8_t> bytes, Outbox&) override {
    diary_.push_back(name_ + " hears " + std::string(bytes.begin(), bytes.end()) + " at " + at(now));
  }
  bool on_clock_step(Utime now, Duration step) override {
    diary_.push_back(name_ + " is set by " + std::to_string(step.count()) + " at " + at(now));
    if (takes_steps_) wake_ += step;
    return takes_steps_;
  }
  Utime step(Utime now, Outbox& outbox) override {
    if (period_ == 0us) return now + 1s;
    if (now < wake_) return wake_;
    outbox.publish_bytes(bus_, "A", {reinterpret_cast<const std::uint8_t*>(name_.data()), name_.size()});
    outbox.publish_bytes(bus_, "B", {});  // nobody listens
    return wake_ = now + period_;
  }

 private:
  bool takes_steps_;
  std::string name_;
  BusId bus_;
  Duration period_;
  Utime wake_{};
  Diary& diary_;
};

// Stops the host at a time.
class Stopper : public Node {
 public:
  Stopper(LockstepHost& host, Utime stop) : host_(host), stop_(stop) {}
  std::vector<Subscription> subscriptions() const override { return {}; }
  void on_message(Utime, BusId, std::string_view, std::span<const std::uint8_t>, Outbox&) override {}
  Utime step(Utime now, Outbox&) override {
    if (now >= stop_) host_.stop();
    return now < stop_ ? stop_ : now + 1us;
  }

 private:
  LockstepHost& host_;
  Utime stop_;
};

class LockstepHostTest : public testing::Test {
 protected:
  LockstepHostTest() : host_(kStart) {
    host_.add_bus("own", 10us);
    host_.add_bus("other", 10us);
    host_.listen([this](Utime now, BusId, int robot_id, std::string_view channel, auto) {
      if (channel == "A") sent_.push_back(std::to_string(robot_id) + " at " + at(now));
    });
  }
  std::size_t add(const LockstepHost::Seat& seat, const std::string& name, Duration period,
                  BusId bus = BusId::kOnboard) {
    return host_.add(seat, [=, this] { return std::make_unique<Talker>(name, bus, period, diary_); });
  }
  void run_until(Duration time) {
    host_.add({.onboard = "own"}, [=, this] { return std::make_unique<Stopper>(host_, kStart + time); });
    diary_.clear();
    host_.run();
    EXPECT_EQ(host_.now(), kStart + time);
  }

  Diary diary_, sent_;
  LockstepHost host_;
};

TEST_F(LockstepHostTest, MessagesStayOnTheirBusAndTakeBusAndWork) {
  add({.robot_id = 0, .onboard = "own", .work = 5us}, "x", 100us);
  add({.robot_id = 0, .onboard = "own"}, "y", 0us);
  add({.robot_id = 1, .onboard = "other"}, "z", 0us);
  run_until(115us);
  EXPECT_EQ(diary_, (Diary{"x hears x at 15", "y hears x at 15", "x hears x at 115", "y hears x at 115"}));
  EXPECT_EQ(sent_, (Diary{"0 at 0", "0 at 100"}));
}

// Seats decide among events of one moment; who sends first is heard first.
TEST_F(LockstepHostTest, TiesAreBrokenBySeatThenByTheOrderOfSending) {
  add({.onboard = "own"}, "x", 100us);
  add({.onboard = "own"}, "y", 100us);
  run_until(50us);
  EXPECT_EQ(diary_, (Diary{"x hears x at 10", "x hears y at 10", "y hears x at 10", "y hears y at 10"}));
}

TEST_F(LockstepHostTest, ANodeSeesItsOwnClock) {
  add({.onboard = "own", .clock_offset = 7us}, "x", 100us);
  add({.onboard = "own", .clock_offset = -3us}, "y", 0us);
  run_until(120us);
  EXPECT_EQ(diary_, (Diary{"x hears x at 17", "y hears x at 7", "x hears x at 117", "y hears x at 107"}));
  EXPECT_EQ(sent_, (Diary{"0 at 0", "0 at 100"}));  // by the host's
}

// Whoever does not take a step is asked before each call, and told when the clock is back.
TEST_F(LockstepHostTest, ClocksAreSetAndNodesTakeItWhenTheyWill) {
  const std::size_t x = add({.onboard = "own"}, "x", 100ms);
  const std::size_t y = host_.add(
      {.onboard = "own"}, [this] { return std::make_unique<Talker>("y", BusId::kOnboard, 0us, diary_, false); });
  for (const std::size_t seat : {x, y}) host_.step_clock(seat, kStart + 50ms, 1s);
  host_.step_clock(y, kStart + 150ms, -1s);
  run_until(210ms);
  EXPECT_EQ(diary_, (Diary{"x hears x at 10", "y hears x at 10", "x is set by 1000000 at 50000",
                           "y is set by 1000000 at 50000", "x hears x at 1100010", "y is set by 1000000 at 100010",
                           "y hears x at 100010", "y is set by 1000000 at 100010", "y is set by 0 at 150000",
                           "x hears x at 1200010", "y hears x at 200010"}));
  EXPECT_EQ(sent_, (Diary{"0 at 0", "0 at 100000", "0 at 200000"}));
}

// By up to 20 ms it is no step: a tenth of the time that passes is slewed.
TEST_F(LockstepHostTest, ALittleIsSlewed) {
  const std::size_t y = add({.onboard = "own"}, "y", 0us);
  add({.onboard = "own"}, "x", 50ms);
  host_.step_clock(y, kStart + 20ms, 4ms);
  run_until(101ms);
  EXPECT_EQ(diary_, (Diary{"y hears x at 10", "x hears x at 10", "y hears x at 54010", "x hears x at 50010",
                           "y hears x at 104010", "x hears x at 100010"}));
}

TEST_F(LockstepHostTest, TheLinkStandsBetweenRobotsOnly) {
  std::vector<std::array<int, 2>> asked;
  std::vector<Duration> copies;
  host_.add_bus("air", 20us, [&](int from, int to, Utime) {
    asked.push_back({from, to});
    copies = to == 2 ? std::vector<Duration>{5us, 1us} : std::vector<Duration>{};
    return std::span<const Duration>(copies);
  });
  add({.robot_id = 1, .onboard = "", .swarm = "air"}, "x", 1ms, BusId::kSwarm);
  add({.robot_id = 1, .onboard = "", .swarm = "air"}, "y", 0us, BusId::kSwarm);
  add({.robot_id = 2, .onboard = "", .swarm = "air"}, "z", 0us, BusId::kSwarm);
  add({.robot_id = 3, .onboard = "", .swarm = "air"}, "lost", 0us, BusId::kSwarm);
  run_until(500us);
  EXPECT_EQ(asked, (std::vector<std::array<int, 2>>{{1, 2}, {1, 3}}));
  EXPECT_EQ(diary_, (Diary{"x hears x at 20", "y hears x at 20", "z hears x at 21", "z hears x at 25"}));
}

// Robots wait for each other in the air, not for themselves; what takes longer by the link does so after that.
TEST_F(LockstepHostTest, ARadioStandsBetweenRobotsBeforeTheLink) {
  RadioChannel radio(6, 1);
  const std::array<Duration, 1> later = {1ms};
  host_.add_bus(
      "air", 20us, [&](int, int, Utime) { return std::span<const Duration>(later); }, &radio);
  add({.robot_id = 1, .onboard = "", .swarm = "air"}, "x", 5ms, BusId::kSwarm);
  add({.robot_id = 1, .onboard = "", .swarm = "air"}, "y", 0us, BusId::kSwarm);
  add({.robot_id = 2, .onboard = "", .swarm = "air"}, "z", 0us, BusId::kSwarm);
  run_until(9ms);
  ASSERT_EQ(diary_.size(), 6u);
  EXPECT_EQ(diary_[0], "x hears x at 20");
  EXPECT_EQ(diary_[1], "y hears x at 20");
  EXPECT_EQ(diary_[3], "x hears x at 5020");
  const Duration least = frame_duration(datagram_bytes("A", 1), 6) + 1020us;
  for (const std::size_t i : {2u, 5u}) {
    ASSERT_EQ(diary_[i].substr(0, 13), "z hears x at ");
    const Duration took = Duration(std::stoi(diary_[i].substr(13))) - (i == 2 ? 0ms : 5ms);
    EXPECT_GE(took, least);
    EXPECT_LE(took, least + RadioChannel::kMostHandOver);
  }
  EXPECT_EQ(radio.counts().sent, 2);
}

TEST_F(LockstepHostTest, ACrashedNodeHearsAndSaysNothingUntilItIsMadeAgain) {
  add({.onboard = "own"}, "x", 100us);
  const std::size_t y = add({.onboard = "own"}, "y", 1ms);
  host_.crash(y, kStart + 100us, kStart + 250us);
  run_until(320us);
  EXPECT_EQ(diary_, (Diary{"x hears x at 10", "x hears y at 10", "y hears x at 10", "y hears y at 10", "y ends",
                           "x hears x at 110", "x hears x at 210", "y begins", "x hears y at 260", "y hears y at 260",
                           "x hears x at 310", "y hears x at 310"}));
}

TEST_F(LockstepHostTest, ANodeNeedsTheBusesItListensTo) {
  EXPECT_THROW(add({.onboard = "none"}, "x", 0us), std::out_of_range);
  EXPECT_THROW(add({.onboard = "own"}, "x", 0us, BusId::kSwarm), std::out_of_range);
}

// Listens to channel B for a while.
class Wanderer : public Node {
 public:
  explicit Wanderer(Diary& diary) : diary_(diary) {}
  std::vector<Subscription> subscriptions() const override { return {}; }
  void on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t>, Outbox&) override {
    diary_.push_back("hears " + std::string(channel) + " at " + at(now));
  }
  Utime step(Utime now, Outbox& outbox) override {
    outbox.listen(BusId::kSwarm, "B", now >= kStart + 15ms && now < kStart + 35ms);
    return now + 5ms;
  }

 private:
  Diary& diary_;
};

TEST(LockstepHost, NodesListenAndListenNoMore) {
  Diary diary, ignored;
  LockstepHost host(kStart);
  host.add_bus("air", 1ms);
  host.add({1, "", "air"}, [&] { return std::make_unique<Talker>("a", BusId::kSwarm, 10ms, ignored); });
  const std::size_t seat = host.add({2, "", "air"}, [&] { return std::make_unique<Wanderer>(diary); });
  host.crash(seat, kStart + 32ms, kStart + 50ms);
  host.add({3, "", "air"}, [&] { return std::make_unique<Stopper>(host, kStart + 100ms); });
  host.run();
  EXPECT_EQ(diary, (Diary{"hears B at 21000", "hears B at 31000"}));
}

// What is said goes out in the order of the seats, whoever was ready first.
TEST(LockstepHost, AnyNumberOfThreadsGivesTheSame) {
  constexpr int kTalkers = 9;
  const auto run = [](int threads) {
    std::array<Diary, kTalkers + 1> diaries;  // of each its own; the last: what was sent
    LockstepHost host(kStart, threads);
    host.add_bus("air", 1ms);
    for (std::size_t i = 0; i < kTalkers; ++i) {
      const Duration period = 5ms * (1 + i % 3);
      host.add({.robot_id = static_cast<int>(i / 2), .swarm = "air", .is_alone = i == 6}, [&diaries, i, period] {
        return std::make_unique<Talker>(std::to_string(i), BusId::kSwarm, period, diaries[i]);
      });
    }
    host.crash(4, kStart + 20ms, kStart + 30ms);
    host.listen([&](Utime now, BusId, int robot_id, std::string_view channel, auto bytes) {
      diaries.back().push_back(std::to_string(robot_id) + std::string(channel) + std::to_string(bytes.size()) +
                               at(now));
    });
    host.add({.swarm = "air", .is_alone = true}, [&] { return std::make_unique<Stopper>(host, kStart + 100ms); });
    host.run();
    return diaries;
  };
  const auto alone = run(1);
  EXPECT_GT(alone.back().size(), 200u);
  EXPECT_EQ(run(2), alone);
  EXPECT_EQ(run(4), alone);
}

TEST(LockstepHost, NothingIsHeardAtTheMomentItIsSaid) {
  LockstepHost host(kStart);
  EXPECT_THROW(host.add_bus("air", 0us), std::invalid_argument);
}

}  // namespace
}  // namespace swarm::test
