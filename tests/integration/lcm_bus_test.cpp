// The real thing: LCM over multicast that never leaves this computer (ttl=0), between objects and between processes.
#include "lcmtypes/bus/lcm_bus.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/post.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/lcm_bus_fixture.h"

namespace swarm::test {
namespace {

std::string url_error(const std::string& url) {
  try {
    UdpmUrl::parse(url);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(UdpmUrl, ReadsAndWritesParameters) {
  const UdpmUrl url = UdpmUrl::parse("udpm://239.255.76.67:7702?recv_buf_size=65536&ttl=1");
  EXPECT_EQ(url.group, "239.255.76.67");
  EXPECT_EQ(url.port, 7702);
  EXPECT_EQ(url.ttl, 1);
  EXPECT_EQ(url.recv_buf_size, 65536);
  EXPECT_EQ(url.to_string(), "udpm://239.255.76.67:7702?ttl=1&recv_buf_size=65536");
  EXPECT_EQ(UdpmUrl::parse("udpm://239.1.2.3:1").to_string(), "udpm://239.1.2.3:1?ttl=0&recv_buf_size=2097152");
}

TEST(UdpmUrl, RefusesWhateverElse) {
  for (const char* url : {"",
                          "udpm",
                          "udpm://",
                          "udp://239.255.76.67:7700",
                          "memq://",
                          "239.255.76.67:7700",
                          "udpm://:7700",
                          "udpm://239.255.76.67",
                          "udpm://239.255.76.67:",
                          "udpm://239.255.76.67:0",
                          "udpm://239.255.76.67:65536",
                          "udpm://239.255.76.67:77x",
                          "udpm://239.255.76.67:-1",
                          "udpm://127.0.0.1:7700",
                          "udpm://223.255.255.255:7700",
                          "udpm://240.0.0.0:7700",
                          "udpm://239.255.76:7700",
                          "udpm://localhost:7700",
                          "udpm://239.255.76.67:7700?ttl=",
                          "udpm://239.255.76.67:7700?ttl=-1",
                          "udpm://239.255.76.67:7700?ttl=256",
                          "udpm://239.255.76.67:7700?ttl=0&ttl=0",
                          "udpm://239.255.76.67:7700?tll=0",
                          "udpm://239.255.76.67:7700?ttl=0&&recv_buf_size=65536",
                          "udpm://239.255.76.67:7700?recv_buf_size=1",
                          "udpm://239.255.76.67:7700 ?ttl=0"}) {
    const std::string error = url_error(url);
    EXPECT_NE(error.find("'" + std::string(url) + "'"), std::string::npos) << url << " -> " << error;
    EXPECT_EQ(error.find('\n'), std::string::npos);
  }
  EXPECT_EQ(url_error("udpm://239.255.76.67:7700?tll=0"),
            "bus 'udpm://239.255.76.67:7700?tll=0': unknown parameter 'tll' (there are ttl and recv_buf_size)");
}

// tools/bus_url.sh and the daemons must mean the same buses.
TEST(UdpmUrl, ScriptsNameTheSameBuses) {
  const auto script_url = [](const std::string& option) {
    const std::string command =
        "bash -c 'source " SWARM_SOURCE_DIR "/tools/bus_url.sh; read_bus_option " + option + "; echo -n \"$bus_url\"'";
    FILE* const pipe = ::popen(command.c_str(), "r");
    std::array<char, 256> text{};
    const std::size_t size = std::fread(text.data(), 1, text.size(), pipe);
    ::pclose(pipe);
    return std::string(text.data(), size);
  };
  EXPECT_EQ(script_url("--onboard 0"), UdpmUrl::parse(kDefaultOnboardUrl).to_string());
  EXPECT_EQ(script_url("--swarm"), UdpmUrl::parse(kDefaultSwarmUrl).to_string());
  EXPECT_EQ(UdpmUrl::parse(script_url("--onboard 12")).port, UdpmUrl::parse(kDefaultOnboardUrl).port + 12);
  EXPECT_EQ(script_url("--url udpm://239.1.1.1:9000"), "udpm://239.1.1.1:9000?recv_buf_size=2097152");
}

TEST_F(LcmBusTest, CarriesBytesOnExactChannels) {
  LcmBus sender(test_url(1)), receiver(test_url(1)), elsewhere(test_url(2));
  std::vector<std::pair<std::string, Bytes>> heard;
  int strays = 0;
  const auto keep = [&](std::string_view channel, std::span<const std::uint8_t> bytes) {
    heard.emplace_back(channel, Bytes(bytes.begin(), bytes.end()));
  };
  receiver.subscribe("GOAL", keep);
  receiver.subscribe("SOGM", keep);
  elsewhere.subscribe("GOAL", [&](auto, auto) { ++strays; });
  std::vector<std::pair<std::string, Bytes>> sent;
  for (const std::size_t size : {0u, 1u, 879u, 60'100u, 300'000u}) {
    Bytes bytes(size);
    for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(i * i + size);
    for (const char* channel : {"GOAL", "GOAL_2", "A_GOAL", "SOGM"}) {
      ASSERT_TRUE(sender.publish(channel, bytes));
      if (channel == std::string("GOAL") || channel == std::string("SOGM")) sent.emplace_back(channel, bytes);
    }
    ASSERT_TRUE(wait_until(receiver, [&] { return heard.size() == sent.size(); })) << size << ": " << heard.size();
  }
  EXPECT_TRUE(heard == sent);
  elsewhere.drain();
  EXPECT_EQ(strays, 0);
  EXPECT_EQ(receiver.drain(), 0);
}

// The kernel tells channels apart by their names, of whatever length, and whatever of a name others begin with.
TEST_F(LcmBusTest, OthersChannelsWakeNobody) {
  LcmBus sender(test_url(1)), receiver(test_url(1));
  const auto is_woken = [&] {
    pollfd pending{receiver.fd(), POLLIN, 0};
    return ::poll(&pending, 1, 0) > 0;
  };
  receiver.drain();
  std::vector<std::string> names;
  for (std::size_t size = 1; size <= 63; ++size) names.push_back(std::string(size - 1, 'A') + 'B');
  std::vector<std::string> heard;
  for (std::size_t i = 0; i < names.size(); i += 3)
    receiver.subscribe(names[i], [&](std::string_view channel, auto) { heard.emplace_back(channel); });
  for (std::size_t i = 0; i < names.size(); ++i) {
    for (const std::string& other : {names[i] + 'B', names[i].substr(1), std::string(names[i].size(), 'A')}) {
      if (other.empty() || other.size() > 63 || std::ranges::find(names, other) != names.end()) continue;
      ASSERT_TRUE(sender.publish(other, Bytes()));
      EXPECT_FALSE(is_woken()) << other;
    }
    for (const std::size_t size : {0u, 1u, 100u}) {
      ASSERT_TRUE(sender.publish(names[i], Bytes(size)));
      const bool is_subscribed = i % 3 == 0;
      EXPECT_EQ(is_woken(), is_subscribed) << names[i];
      receiver.drain();
      EXPECT_EQ(heard, std::vector<std::string>(is_subscribed ? 1 : 0, names[i]));
      heard.clear();
    }
  }
}

// More than a filter of the kernel holds: then all are heard, and told apart here.
TEST_F(LcmBusTest, HearsAnyNumberOfChannels) {
  LcmBus sender(test_url(1)), receiver(test_url(1));
  const auto name = [](int i) { return std::string(50, 'A') + "_" + std::to_string(i); };
  int good = 0;
  for (int i = 0; i < 200; ++i) receiver.subscribe(name(i), [&](auto, auto) { ++good; });
  for (const int i : {0, 199, 200}) ASSERT_TRUE(sender.publish(name(i), Bytes{1}));
  EXPECT_TRUE(wait_until(receiver, [&] { return good == 2; }));
  EXPECT_EQ(receiver.drain(), 0);
}

TEST_F(LcmBusTest, RefusesChannelsThatAreExpressions) {
  LcmBus bus(test_url(1));
  for (const std::string& channel :
       {std::string(), std::string(".*"), std::string("GOAL|SOGM"), std::string(64, 'A')}) {
    EXPECT_THROW(bus.subscribe(channel, [](auto, auto) {}), std::invalid_argument) << channel;
  }
}

TEST_F(LcmBusTest, SurvivesHandlersThatThrow) {
  LcmBus bus(test_url(1));
  int good = 0;
  bus.subscribe("BAD", [](auto, auto) { throw std::runtime_error("thrown by the handler"); });
  bus.subscribe("GOOD", [&](auto, auto) { ++good; });
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(bus.publish("BAD", Bytes{1}));
    ASSERT_TRUE(bus.publish("GOOD", Bytes{1}));
    int thrown = 0;
    for (const auto end = Clock::now() + 5s; (thrown == 0 || good == round) && Clock::now() < end;) {
      try {
        bus.drain();
      } catch (const std::runtime_error& error) {
        EXPECT_STREQ(error.what(), "thrown by the handler");
        ++thrown;
      }
    }
    EXPECT_EQ(thrown, 1);
    EXPECT_EQ(good, round + 1);
  }
}

TEST_F(LcmBusTest, TellsOfASmallReceiveBuffer) {
  LcmBus greedy(test_url(1, "&recv_buf_size=1073741824"));
  ASSERT_EQ(greedy.warnings().size(), 1u);
  EXPECT_NE(greedy.warnings()[0].find("sysctl -w net.core.rmem_max=1073741824"), std::string::npos);
  EXPECT_TRUE(LcmBus(test_url(1, "&recv_buf_size=65536")).warnings().empty());
}

// Runs `child` in a process of its own; its exit code.
template <class Child>
int exit_code_of(Child child) {
  const pid_t pid = ::fork();
  if (pid == 0) ::_exit(child());
  int status = 0;
  ::waitpid(pid, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

// In a network of its own, without any route; 77: there is none.
template <class Child>
int exit_code_without_routes(Child child) {
  return exit_code_of([&] {
    const uid_t uid = ::getuid();
    if (::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) return 77;
    std::ofstream("/proc/self/uid_map") << "0 " << uid << " 1";  // root of the new network
    return child();
  });
}

std::string bus_error(const std::string& url) {
  try {
    LcmBus bus(url);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

bool hears_itself(LcmBus& bus) {
  bool heard = false;
  bus.subscribe("GOAL", [&](auto, auto) { heard = true; });
  return bus.publish("GOAL", Bytes{1}) && wait_until(bus, [&] { return heard; });
}

TEST(LcmBusRoute, NamesTheCommandThatMendsAMissingRoute) {
  const int code = exit_code_without_routes([] {
    const std::string network = "udpm://239.255.76.68:7667?ttl=1", mend = "ip route add 224.0.0.0/4 dev ";
    if (bus_error(network).find(mend) == std::string::npos) return 1;
    if (std::system("ip link set lo up && ip route add 224.0.0.0/4 dev lo") != 0) return 77;
    LcmBus bus(network);
    return hears_itself(bus) ? 0 : 2;
  });
  if (code == 77) GTEST_SKIP() << "no network namespaces here";
  EXPECT_EQ(code, 0);
}

TEST(LcmBusRoute, LocalBusNeedsNone) {
  const int code = exit_code_without_routes([] {
    if (bus_error(test_url(3)).find("ip link set lo up") == std::string::npos) return 1;
    if (std::system("ip link set lo up") != 0) return 77;
    LcmBus bus(test_url(3));
    const bool is_said = bus.warnings().size() == 1 && bus.warnings()[0].find("ip route add") != std::string::npos;
    if (!is_said || !hears_itself(bus)) return 2;
    return std::system("ip route add 224.0.0.0/4 dev lo") == 0 && LcmBus(test_url(3)).warnings().empty() ? 0 : 3;
  });
  if (code == 77) GTEST_SKIP() << "no network namespaces here";
  EXPECT_EQ(code, 0);
}

// With a key: who has it is heard, who has another or none is not, and programs without look past the seal.
TEST_F(LcmBusTest, HearsOnlySealedMessagesWithAKey) {
  const SwarmKeys ours(SwarmKeys::fresh()), theirs(SwarmKeys::fresh());
  LcmBus one(test_url(7), ours), two(test_url(7), ours), stranger(test_url(7), theirs), open(test_url(7));
  const auto keep = [](std::vector<Bytes>* to) {
    return [to](auto, auto bytes) { to->emplace_back(bytes.begin(), bytes.end()); };
  };
  std::vector<Bytes> at_two, at_open;
  two.subscribe("GO", keep(&at_two));
  open.subscribe("GO", keep(&at_open));
  ASSERT_TRUE(open.publish("GO", Bytes{1}));
  ASSERT_TRUE(stranger.publish("GO", Bytes{2}));
  ASSERT_TRUE(one.publish("GONE", Bytes{3}));
  ASSERT_TRUE(one.publish("GO", Bytes{4}));
  EXPECT_TRUE(wait_until(two, [&] { return !at_two.empty(); }));
  EXPECT_TRUE(wait_until(open, [&] { return at_open.size() == 3; }));
  EXPECT_EQ(at_two, std::vector<Bytes>{Bytes{4}});
  EXPECT_EQ(two.forged(), 2);
  EXPECT_EQ(at_open, (std::vector<Bytes>{{1}, {2}, {4}}));
}

// LCM's own programs take part: liblcm's objects hear what a bus sends, and the reverse.
TEST_F(LcmBusTest, SpeaksWithLiblcm) {
  LcmBus bus(test_url(6));
  lcm::LCM plain(UdpmUrl::parse(test_url(6)).to_string());
  ASSERT_TRUE(plain.good());
  std::vector<Bytes> at_bus, at_plain;
  bus.subscribe("TO_BUS", [&](auto, auto bytes) { at_bus.emplace_back(bytes.begin(), bytes.end()); });
  struct Keep {
    std::vector<Bytes>* to;
    void take(const lcm::ReceiveBuffer* buffer, const std::string&) {
      const auto* const bytes = static_cast<const std::uint8_t*>(buffer->data);
      to->emplace_back(bytes, bytes + buffer->data_size);
    }
  } keep{&at_plain};
  plain.subscribe("TO_PLAIN", &Keep::take, &keep);
  std::vector<Bytes> sent;
  for (const std::size_t size : {0u, 1u, 900u, 60'000u, 65'490u, 65'491u, 65'492u, 65'500u, 200'000u}) {
    Bytes& bytes = sent.emplace_back(size);
    for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(i * i + size);
    ASSERT_TRUE(bus.publish("TO_PLAIN", bytes));
    ASSERT_EQ(plain.publish("TO_BUS", bytes.data(), static_cast<unsigned>(size)), 0);
    EXPECT_GT(plain.handleTimeout(2000), 0) << size;
    EXPECT_TRUE(wait_until(bus, [&] { return at_bus.size() == sent.size(); })) << size;
  }
  EXPECT_TRUE(at_bus == sent);
  EXPECT_TRUE(at_plain == sent);
}

}  // namespace
}  // namespace swarm::test
