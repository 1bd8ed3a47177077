// The channel that all robots share: who waits, who collides, what is dropped.
#include "swarm_sim/hosts/radio_channel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>

#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

constexpr std::size_t kBytes = 200;
const Duration kFrame = frame_duration(kBytes, 6);

// A channel, and when what was sent over it was heard.
class RadioChannelTest : public testing::Test {
 protected:
  void send(Duration at, int robot, std::string what = "") {
    channel_.advance(kStart + at);
    now_ = at;
    channel_.send(kStart + at, robot, kBytes, [this, what = std::move(what)] { heard_.emplace_back(now_, what); });
  }
  void advance(Duration until) {
    for (Utime due = channel_.due(); due <= kStart + until; due = channel_.due()) {
      now_ = due - kStart;
      channel_.advance(due);
    }
  }

  RadioChannel channel_{6, 7};
  Duration now_{};
  std::vector<std::pair<Duration, std::string>> heard_;
};

TEST_F(RadioChannelTest, AFreeChannelIsTakenAtOnce) {
  EXPECT_EQ(channel_.due(), kNever);
  send(10ms, 1, "a");
  advance(20ms);
  ASSERT_EQ(heard_.size(), 1u);
  EXPECT_GE(heard_[0].first, 10ms + kFrame);
  EXPECT_LE(heard_[0].first, 10ms + RadioChannel::kMostHandOver + kFrame);
  EXPECT_EQ(channel_.due(), kNever);
}

// Of all that is sent in the same moment over and over, either both are heard, with at least a DIFS between them, or
// neither is.
TEST_F(RadioChannelTest, OfTwoAtOnceOneWaitsOrBothAreLost) {
  int lost = 0;
  for (int i = 0; i < 2'000; ++i) {
    const Duration at = i * 10ms;
    heard_.clear();
    send(at, 1, "a");
    send(at, 2, "b");
    advance(at + 9ms);
    if (heard_.empty()) {
      ++lost;
      continue;
    }
    ASSERT_EQ(heard_.size(), 2u);
    const Duration gap = heard_[1].first - heard_[0].first;
    ASSERT_GE(gap, kFrame + kDifs);
    ASSERT_LE(gap, std::max(kFrame + kDifs + kMostBackoffSlots * kSlotTime, RadioChannel::kMostHandOver));
  }
  EXPECT_EQ(channel_.counts().sent, 4'000);
  EXPECT_EQ(channel_.counts().collided, 2 * lost);
  EXPECT_EQ(channel_.counts().dropped, 0);
  // Of two that come at any time within 500 us, those within a slot of each other collide: 2 * 9 / 500.
  EXPECT_NEAR(lost / 2'000.0, 2 * 9.0 / 500, 0.012);
}

// Who always has something to send and a window that never widens begins in a slot with probability 2 / 17; a frame
// collides unless all others are quiet (Bianchi, IEEE JSAC 18(3), 2000).
TEST_F(RadioChannelTest, SaturatedRobotsCollideAsBianchiSays) {
  for (const int robots : {2, 5, 10}) {
    SCOPED_TRACE(robots);
    RadioChannel channel(6, 3);
    std::int64_t delivered = 0;
    for (Duration at{}; at < 40s; at += 10ms) {  // more than 30 in 10 ms, which are more than fit
      channel.advance(kStart + at);
      for (int copy = 0; copy < 30 / robots + 1; ++copy) {
        for (int robot = 0; robot < robots; ++robot) channel.send(kStart + at, robot, kBytes, [&] { ++delivered; });
      }
    }
    const auto collided = static_cast<double>(channel.counts().collided);
    const double share = collided / (collided + static_cast<double>(delivered));
    EXPECT_NEAR(share, 1 - std::pow(1 - 2.0 / 17, robots - 1), 0.04);
  }
}

TEST_F(RadioChannelTest, OfTooManyTheOldestAreDroppedInOrder) {
  const auto most = static_cast<int>(RadioChannel::kMostQueued);
  for (int i = 0; i < most + 4; ++i) send(0us, 1, std::to_string(i));
  advance(1s);
  const auto dropped = static_cast<int>(channel_.counts().dropped);
  EXPECT_GE(dropped, 2);
  EXPECT_LE(dropped, 4);
  ASSERT_EQ(heard_.size(), static_cast<std::size_t>(most + 4 - dropped));
  int before = -1;
  for (const auto& [at, what] : heard_) {
    EXPECT_GT(std::stoi(what), before);
    before = std::stoi(what);
  }
  EXPECT_EQ(before, most + 3) << "the newest is kept";
  EXPECT_EQ(channel_.counts().collided, 0) << "one alone does not collide";
  for (std::size_t i = 1; i < heard_.size(); ++i) EXPECT_GE(heard_[i].first - heard_[i - 1].first, kFrame + kDifs);
}

TEST_F(RadioChannelTest, TheSeedDecides) {
  const auto times = [](std::uint64_t seed) {
    RadioChannel channel(24, seed);
    std::vector<Utime> heard;
    for (int i = 0; i < 500; ++i)
      channel.send(kStart, i % 7, kBytes, [&heard, &channel] { heard.push_back(channel.due()); });
    channel.advance(kStart + 10s);
    return heard;
  };
  EXPECT_EQ(times(1), times(1));
  EXPECT_NE(times(1), times(2));
}

// The same bytes every time; collisions cost time, not safety.
TEST(RadioFlights, ADeterministicChannelLosesSome) {
  const World world = make_world(Task::kCircle, Environment::kEmpty, 0, 3, {.robots = 6, .circle_m = 3.0});
  FlightOptions options;
  options.link.rate_mbps = 6;
  const auto fly = [&](const std::filesystem::path& out) {
    BusLog logs(out, {0, 1, 2, 3, 4, 5});
    const RunReport report = run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
    logs.close();
    return report;
  };
  TemporaryDirectory first, second;
  const RunReport report = fly(first.path());
  (void)fly(second.path());
  EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
  EXPECT_TRUE(report.touches.empty());
  EXPECT_EQ(report.commit_conflicts, 0);
  EXPECT_EQ(read_text(first / "swarm.lcm"), read_text(second / "swarm.lcm"));
  ASSERT_TRUE(report.air.radio);
  EXPECT_EQ(report.air.radio->sent, report.air.datagrams);
  EXPECT_GT(report.air.radio->collided, 0);
  EXPECT_LT(report.air.radio->collided_share(), 0.3);
  double sent_hz = 0.0, received_hz = 0.0;
  for (const RobotReport& robot : report.robots) {
    sent_hz += robot.sent_hz;
    received_hz += robot.received_hz;
  }
  EXPECT_NEAR(received_hz, 5 * sent_hz * (1 - report.air.radio->collided_share()), 5.0);  // some are under way
}

}  // namespace
}  // namespace swarm::test
