// The real-time host while the wall clock is set: time goes on until the node agrees.
#include "lcmtypes/bus/realtime_host.h"

#include <vector>

namespace swarm {
namespace {

constexpr std::int64_t kPeriod_us = 2'000, kSecond_us = 1'000'000;
std::int64_t wall_is_set_by_us = 0;

ClockReading read_set_clocks() {
  ClockReading reading = read_clocks();
  reading.wall_us += wall_is_set_by_us;
  return reading;
}

// Lets the wall clock be set at its tenth step, and agrees when it was asked five times.
class ClockWatcher : public Node {
 public:
  ClockWatcher(RealtimeHost& host, std::int64_t set_by_us) : host_(host), set_by_us_(set_by_us) {}

  std::vector<Subscription> subscriptions() const override { return {}; }
  void on_message(std::int64_t, BusId, std::string_view, std::span<const std::uint8_t>, Outbox&) override {}
  std::int64_t step(std::int64_t now_us, Outbox&) override {
    times_us.push_back(now_us);
    if (times_us.size() == 10) wall_is_set_by_us = set_by_us_;
    if (times_us.size() == 30) host_.stop();
    return now_us + kPeriod_us;
  }
  bool on_clock_step(std::int64_t now_us, std::int64_t step_us) override {
    EXPECT_NEAR(static_cast<double>(step_us), static_cast<double>(set_by_us_), 1000.0);
    EXPECT_GE(now_us, times_us.back());
    asked_at.push_back(times_us.size());
    return asked_at.size() == 5;
  }

  std::vector<std::int64_t> times_us;
  std::vector<std::size_t> asked_at;  // before which step

 private:
  RealtimeHost& host_;
  std::int64_t set_by_us_;
};

TEST(RealtimeHostClock, GoesOnUntilTheNodeTakesTheStep) {
  for (const std::int64_t set_by_us : {-5 * kSecond_us, 10 * kSecond_us}) {
    SCOPED_TRACE(set_by_us);
    wall_is_set_by_us = 0;
    RealtimeHost host;
    ClockWatcher node(host, set_by_us);
    host.add("watcher", node, "", "", {.read = &read_set_clocks});
    host.run();
    EXPECT_EQ(node.asked_at, (std::vector<std::size_t>{10, 11, 12, 13, 14}));
    ASSERT_EQ(node.times_us.size(), 30u);
    for (std::size_t i = 1; i < node.times_us.size(); ++i) {
      const std::int64_t passed_us = node.times_us[i] - node.times_us[i - 1] - (i == 14 ? set_by_us : 0);
      EXPECT_GE(passed_us, kPeriod_us - 1000) << i;
      EXPECT_LT(passed_us, kSecond_us) << i;  // however busy the computer is
    }
  }
}

// Who takes his time from messages takes the wall clock as it is.
TEST(RealtimeHostClock, ReplaysAskNobody) {
  wall_is_set_by_us = 0;
  RealtimeHost host;
  ClockWatcher node(host, 10 * kSecond_us);
  host.add("watcher", node, "", "", {.source = TimeSource::kMessages, .read = &read_set_clocks});
  host.run();
  EXPECT_TRUE(node.asked_at.empty());
  EXPECT_GE(node.times_us[10] - node.times_us[9], 10 * kSecond_us);
}

}  // namespace
}  // namespace swarm
