// The real-time host with a toy node: on real buses, until the signal, and what its main function says.
#include "lcmtypes/bus/realtime_host.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <boost/asio/post.hpp>
#include <chrono>
#include <csignal>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/lcm_bus_fixture.h"

namespace swarm::test {
namespace {

// Answers PING on the bus it came from, and ticks every 20 ms.
class ToyNode : public Node {
 public:
  std::vector<Subscription> subscriptions() const override {
    return {{BusId::kOnboard, "PING"}, {BusId::kSwarm, "PING"}};
  }
  void on_message(Utime, BusId bus, std::string_view, std::span<const std::uint8_t> bytes, Outbox& outbox) override {
    outbox.publish_bytes(bus, "PONG", bytes);
  }
  Utime step(Utime now, Outbox& outbox) override {
    if (now >= next_) {
      outbox.publish_bytes(BusId::kOnboard, "TICK", Bytes{1});
      next_ = now + 20ms;
    }
    return next_;
  }

 private:
  Utime next_{};
};

int toy_main(const std::vector<std::string>& words, bool node_fails = false) {
  std::vector<const char*> argv{"toy"};
  for (const std::string& word : words) argv.push_back(word.c_str());
  int speed = 1;
  return daemon_main(
      "toy", "A toy.", static_cast<int>(argv.size()), argv.data(), DaemonBuses::kOnboardAndSwarm,
      [&](OptionSet& options) { options.add("speed", &speed, 0, 9, "", "of nothing"); },
      [&]() -> std::unique_ptr<Node> {
        if (node_fails) throw std::invalid_argument("speed must not be that");
        return std::make_unique<ToyNode>();
      });
}

class HostTest : public LcmBusTest, public testing::WithParamInterface<int> {};

TEST_P(HostTest, RunsANodeUntilTheSignal) {
  const std::string onboard_url = test_url(4), swarm_url = test_url(5);
  const pid_t pid = ::fork();
  if (pid == 0) ::_exit(toy_main({"--onboard-url", onboard_url, "--swarm-url", swarm_url, "--insecure", "true"}));
  LcmBus onboard(onboard_url), swarm(swarm_url);
  int ticks = 0;
  std::vector<Bytes> onboard_pongs, swarm_pongs;
  const auto keep_in = [](std::vector<Bytes>& pongs) {
    return [&pongs](std::string_view, std::span<const std::uint8_t> bytes) {
      pongs.emplace_back(bytes.begin(), bytes.end());
    };
  };
  onboard.subscribe("TICK", [&](auto, auto) { ++ticks; });
  onboard.subscribe("PONG", keep_in(onboard_pongs));
  swarm.subscribe("PONG", keep_in(swarm_pongs));

  ASSERT_TRUE(wait_until(
      onboard, [&] { return ticks > 0; }, 20s));  // it is up
  ticks = 0;
  const auto began = Clock::now();
  EXPECT_TRUE(wait_until(onboard, [&] { return ticks >= 25; }));
  // 20 ms at least between ticks; the first may have been under way.
  EXPECT_GT(Clock::now() - began, 23 * 20ms);

  for (std::uint8_t i = 0; i < 20; ++i) {
    ASSERT_TRUE(onboard.publish("PING", Bytes{i, 1}));
    ASSERT_TRUE(swarm.publish("PING", Bytes{i, 2}));
  }
  EXPECT_TRUE(wait_until(onboard, [&] { return onboard_pongs.size() == 20; })) << onboard_pongs.size();
  EXPECT_TRUE(wait_until(swarm, [&] { return swarm_pongs.size() == 20; })) << swarm_pongs.size();
  for (std::uint8_t i = 0; i < 20; ++i) {
    EXPECT_EQ(onboard_pongs.at(i), (Bytes{i, 1}));
    EXPECT_EQ(swarm_pongs.at(i), (Bytes{i, 2}));
  }

  const auto killed = Clock::now();
  ASSERT_EQ(::kill(pid, GetParam()), 0);
  int status = 0;
  ::waitpid(pid, &status, 0);
  EXPECT_LT(Clock::now() - killed, 1s);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}
INSTANTIATE_TEST_SUITE_P(Signals, HostTest, testing::Values(SIGTERM, SIGINT));

// Runs the host until a message was so often on a bus; how often it was.
int run_until_heard(RealtimeHost& host, const std::string& url, const char* channel, int times) {
  int heard = 0;
  LcmBus bus(url);
  bus.subscribe(channel, [&](auto, auto) { ++heard; });
  std::thread stopper([&] {
    wait_until(bus, [&] { return heard >= times; });
    host.stop();
  });
  host.run();
  stopper.join();
  return heard;
}

TEST_F(LcmBusTest, HostRunsSeveralNodesUntilStopped) {
  ToyNode first, second;
  RealtimeHost host;
  host.add("first", first, test_url(4), test_url(6));
  host.add("second", second, test_url(5), test_url(6));
  EXPECT_GE(run_until_heard(host, test_url(5), "TICK", 3), 3);
}

// Until it has seen enough.
TEST_F(LcmBusTest, HostLooksAgainAndAgainUntilItIsEnough) {
  ToyNode node;
  RealtimeHost host;
  host.add("toy", node, test_url(4), test_url(6));
  int looks = 0;
  host.watch(20ms, [&looks] { return ++looks < 10; });
  EXPECT_EQ(looks, 0);
  const auto began = Clock::now();
  host.run();
  EXPECT_EQ(looks, 10);
  EXPECT_GE(Clock::now() - began, 9 * 20ms);
}

// What does not come over a bus: the node speaks through the host all the same, and steps after it.
TEST_F(LcmBusTest, HostDeliversToItsNodes) {
  ToyNode node, stranger;
  RealtimeHost host;
  host.add("toy", node, test_url(4), test_url(6));
  EXPECT_THROW(host.deliver(stranger, [](Utime, Outbox&) {}), std::invalid_argument);
  Utime delivered{};
  boost::asio::post(host.io(), [&] {
    host.deliver(node, [&](Utime now, Outbox& outbox) {
      delivered = now;
      outbox.publish_bytes(BusId::kOnboard, "PONG", Bytes{7});
    });
  });
  EXPECT_EQ(run_until_heard(host, test_url(4), "PONG", 1), 1);
  EXPECT_LE(std::chrono::abs(wall_utime() - delivered), 10s);
}

// Steps every 50 ms, ten times, and says five words each time, which it hears itself.
class PatientNode : public Node {
 public:
  explicit PatientNode(RealtimeHost& host) : host_(host) {}
  std::vector<Subscription> subscriptions() const override { return {{BusId::kOnboard, "WORD", Wakes::kNobody}}; }
  void on_message(Utime, BusId, std::string_view, std::span<const std::uint8_t> bytes, Outbox&) override {
    heard.push_back(bytes.front());
  }
  Utime step(Utime now, Outbox& outbox) override {
    heard_until.push_back(heard.size());
    for (int i = 0; i < 5; ++i) outbox.publish_bytes(BusId::kOnboard, "WORD", Bytes{++said_});
    if (heard_until.size() == 10) host_.stop();
    return now + 50ms;
  }

  std::vector<std::uint8_t> heard;
  std::vector<std::size_t> heard_until;  // each step

 private:
  RealtimeHost& host_;
  std::uint8_t said_ = 0;
};

// They wake nobody, but are there before the next step, in order.
TEST_F(LcmBusTest, HostHandsOverWhatCanWaitBeforeTheNextStep) {
  RealtimeHost host;
  PatientNode node(host);
  host.add("patient", node, test_url(4), test_url(5), {}, SwarmKeys(SwarmKeys::fresh()));  // which are not of this bus
  const auto began = Clock::now();
  host.run();
  EXPECT_GE(Clock::now() - began, 9 * 50ms - 10ms);
  ASSERT_EQ(node.heard_until.size(), 10u);
  for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(node.heard_until[i], 5 * i);
  for (std::size_t i = 0; i < node.heard.size(); ++i) EXPECT_EQ(node.heard[i], i + 1);
}

TEST_F(LcmBusTest, HostRefusesANodeWithoutItsBus) {
  ToyNode node;
  RealtimeHost host;
  EXPECT_THROW(host.add("toy", node, test_url(4), ""), std::invalid_argument);
}

// Exit code and stderr of the toy daemon.
std::pair<int, std::string> failing_main(const std::vector<std::string>& words, bool node_fails = false) {
  testing::internal::CaptureStderr();
  const int code = toy_main(words, node_fails);
  return {code, testing::internal::GetCapturedStderr()};
}

TEST(DaemonMain, SaysInOneLineWhatIsWrong) {
  EXPECT_EQ(failing_main({"--speed", "10"}),
            std::pair(2, std::string("toy: --speed 10: must be a whole number within [0, 9]\n")));
  EXPECT_EQ(failing_main({"--onboard-url", "foo"}),
            std::pair(2, std::string("toy: --onboard-url foo: bus 'foo': must be udpm://ADDRESS:PORT?ttl=N\n")));
  EXPECT_EQ(failing_main({"--insecure", "true"}, true), std::pair(2, std::string("toy: speed must not be that\n")));
}

TEST(DaemonMain, PrintsItsConfig) {
  testing::internal::CaptureStdout();
  EXPECT_EQ(toy_main({"--print-config", "--speed", "3"}), 0);
  const std::string out = testing::internal::GetCapturedStdout();
  for (const std::string& line : {std::string("speed = 3\n"), "onboard-url = " + std::string(kDefaultOnboardUrl) + "\n",
                                  "swarm-url = " + std::string(kDefaultSwarmUrl) + "\n"}) {
    EXPECT_NE(out.find(line), std::string::npos) << out;
  }
}

// Speaks all the time; listens to what it says from its fifth step on until it has heard three.
class Roamer : public Node {
 public:
  explicit Roamer(RealtimeHost& host) : host_(host) {}
  std::vector<Subscription> subscriptions() const override { return {}; }
  void on_message(Utime, BusId, std::string_view channel, std::span<const std::uint8_t>, Outbox&) override {
    EXPECT_EQ(channel, "NEWS");
    ++(listens_ ? heard : heard_else);
  }
  Utime step(Utime now, Outbox& outbox) override {
    if (now < next_) return next_;
    ++steps_;
    const bool listens = steps_ >= 5 && heard < 3;
    if (listens != listens_) outbox.listen(BusId::kSwarm, "NEWS", listens_ = listens);
    outbox.publish_bytes(BusId::kSwarm, "NEWS", Bytes{1});
    outbox.publish_bytes(BusId::kSwarm, "OTHERS", Bytes{1});
    if (steps_ == 200 || (heard >= 3 && ++after_ == 20)) host_.stop();
    return next_ = now + 5ms;
  }

  int heard = 0, heard_else = 0;

 private:
  RealtimeHost& host_;
  Utime next_{};
  bool listens_ = false;
  int steps_ = 0, after_ = 0;
};

TEST_F(LcmBusTest, NodesListenAndListenNoMore) {
  RealtimeHost host;
  Roamer node(host);
  host.add("roamer", node, "", test_url(4));
  host.run();
  EXPECT_GE(node.heard, 3);
  EXPECT_EQ(node.heard_else, 0);
}

}  // namespace
}  // namespace swarm::test
