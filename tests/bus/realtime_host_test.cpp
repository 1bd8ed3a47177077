// The real-time host while the wall clock is set: time goes on until the node agrees.
#include "lcmtypes/bus/realtime_host.h"

#include <vector>

namespace swarm {
namespace {

constexpr Duration kPeriod = 2ms;
Duration wall_is_set_by{};

ClockReading read_set_clocks() {
  ClockReading reading = read_clocks();
  reading.wall += wall_is_set_by;
  return reading;
}

// Lets the wall clock be set at its tenth step, and agrees when it was asked five times.
class ClockWatcher : public Node {
 public:
  ClockWatcher(RealtimeHost& host, Duration set_by) : host_(host), set_by_(set_by) {}

  std::vector<Subscription> subscriptions() const override { return {}; }
  void on_message(Utime, BusId, std::string_view, std::span<const std::uint8_t>, Outbox&) override {}
  Utime step(Utime now, Outbox&) override {
    times.push_back(now);
    if (times.size() == 10) wall_is_set_by = set_by_;
    if (times.size() == 30) host_.stop();
    return now + kPeriod;
  }
  bool on_clock_step(Utime now, Duration step) override {
    EXPECT_LE(std::chrono::abs(step - set_by_), 1ms);
    EXPECT_GE(now, times.back());
    asked_at.push_back(times.size());
    return asked_at.size() == 5;
  }

  std::vector<Utime> times;
  std::vector<std::size_t> asked_at;  // before which step

 private:
  RealtimeHost& host_;
  Duration set_by_;
};

TEST(RealtimeHostClock, GoesOnUntilTheNodeTakesTheStep) {
  for (const Duration set_by : {-5s, 10s}) {
    SCOPED_TRACE(set_by.count());
    wall_is_set_by = Duration();
    RealtimeHost host;
    ClockWatcher node(host, set_by);
    host.add("watcher", node, "", "", {.read = &read_set_clocks});
    host.run();
    EXPECT_EQ(node.asked_at, (std::vector<std::size_t>{10, 11, 12, 13, 14}));
    ASSERT_EQ(node.times.size(), 30u);
    for (std::size_t i = 1; i < node.times.size(); ++i) {
      const Duration passed = node.times[i] - node.times[i - 1] - (i == 14 ? set_by : Duration());
      EXPECT_GE(passed, kPeriod - 1ms) << i;
      EXPECT_LT(passed, 1s) << i;  // however busy the computer is
    }
  }
}

// Who takes his time from messages takes the wall clock as it is.
TEST(RealtimeHostClock, ReplaysAskNobody) {
  wall_is_set_by = Duration();
  RealtimeHost host;
  ClockWatcher node(host, 10s);
  host.add("watcher", node, "", "", {.source = TimeSource::kMessages, .read = &read_set_clocks});
  host.run();
  EXPECT_TRUE(node.asked_at.empty());
  EXPECT_GE(node.times[10] - node.times[9], 10s);
}

}  // namespace
}  // namespace swarm
