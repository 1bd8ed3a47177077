// Somebody else's computer on the same network: two network namespaces and a cable between them. What a bus takes from
// it, and what it does when the cable is pulled.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/ip.h>
#include <netinet/udp.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/lcm_wire.h"
#include "lcmtypes/bus/time.h"
#include "tests/support/lcm_bus_fixture.h"

namespace swarm {
namespace {

using test::Bytes, test::wait_until;
using Clock = std::chrono::steady_clock;

constexpr char kLocal[] = "udpm://239.255.76.67:7700?ttl=0";
constexpr char kNetwork[] = "udpm://239.255.76.68:7667?ttl=1";
constexpr char kRobot[] = "10.9.0.1", kStranger[] = "10.9.0.2";

bool run(const std::string& command) {
  return std::system((command + " 2>/dev/null").c_str()) == 0;
}

// What the stranger sends: datagrams of one message to a bus, from any address.
void send_forged(const std::string& url, const std::string& from, const Bytes& datagram) {
  const UdpmUrl to = UdpmUrl::parse(url);
  const int fd = ::socket(AF_INET, SOCK_RAW, IPPROTO_RAW);
  Bytes packet(sizeof(iphdr) + sizeof(udphdr));
  iphdr ip{};
  ip.version = 4;
  ip.ihl = 5;
  ip.ttl = 64;
  ip.protocol = IPPROTO_UDP;
  ip.saddr = ::inet_addr(from.c_str());
  ip.daddr = ::inet_addr(to.group.c_str());
  ip.tot_len = htons(static_cast<std::uint16_t>(packet.size() + datagram.size()));
  udphdr udp{};
  udp.source = htons(5555);
  udp.dest = htons(static_cast<std::uint16_t>(to.port));
  udp.len = htons(static_cast<std::uint16_t>(sizeof(udphdr) + datagram.size()));
  std::memcpy(packet.data(), &ip, sizeof(ip));
  std::memcpy(packet.data() + sizeof(ip), &udp, sizeof(udp));
  packet.insert(packet.end(), datagram.begin(), datagram.end());
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = ip.daddr;
  (void)::sendto(fd, packet.data(), packet.size(), 0, reinterpret_cast<sockaddr*>(&address), sizeof(address));
  ::close(fd);
}

Bytes whole(const std::string& channel, std::uint8_t content) {
  Bytes datagram;
  (void)write_lcm(1, {channel, std::span(&content, 1)}, [&](const auto& head, const auto& payload) {
    datagram.assign(head.begin(), head.end());
    datagram.insert(datagram.end(), payload.begin(), payload.end());
    return true;
  });
  return datagram;
}

Bytes forged_fragment() {
  Bytes fragment(60, 'A');
  const Bytes header{'L', 'C', '0', '3', 0, 0, 0, 1, 0, 0, 1, 0, 0xff, 0xff, 0xff, 0xf0, 0, 0, 0, 2, 'G', 'O', 0};
  std::copy(header.begin(), header.end(), fragment.begin());
  return fragment;
}

// All that the stranger tries; afterwards one whole message on either bus under its own address.
void attack() {
  for (const char* url : {kLocal, kNetwork}) {
    for (const char* from : {kRobot, "127.0.0.1", kStranger}) {
      send_forged(url, from, forged_fragment());
      if (from != kStranger) send_forged(url, from, whole("GO", 66));
    }
    send_forged(url, kStranger, whole("GO", 77));
  }
}

// In namespaces of their own: `robot` runs beside a stranger, who attacks when it calls what it is given. Returns what
// it returns, kSkipped without namespaces.
constexpr int kSkipped = 99;
int beside_a_stranger(const std::function<int(const std::function<void()>& let_attack)>& robot) {
  const pid_t pid = ::fork();
  if (pid == 0) {
    const uid_t uid = ::getuid();
    if (::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) ::_exit(kSkipped);
    std::ofstream("/proc/self/uid_map") << "0 " << uid << " 1";
    int order[2], answer[2];
    if (::pipe(order) != 0 || ::pipe(answer) != 0) ::_exit(kSkipped);
    const pid_t stranger = ::fork();
    char byte = 0;
    if (stranger == 0) {
      if (::unshare(CLONE_NEWNET) != 0) ::_exit(kSkipped);
      ::close(order[1]);
      bool is_ready = false;
      while (::write(answer[1], "+", 1) == 1 && ::read(order[0], &byte, 1) == 1) {
        if (!is_ready)
          is_ready = run("ip addr add 10.9.0.2/24 dev far && ip link set far up && ip route add 224.0.0.0/4 dev far");
        else
          attack();
      }
      ::_exit(0);
    }
    const auto wait = [&] { return ::read(answer[0], &byte, 1) == 1; };
    const auto tell = [&] { return ::write(order[1], "!", 1) == 1 && wait(); };
    const bool is_ready =
        wait() && run("ip link set lo up") &&
        run("ip link add eth0 type veth peer name far netns " + std::to_string(stranger)) &&
        run("ip addr add 10.9.0.1/24 dev eth0 && ip link set eth0 up && ip route add default dev eth0") && tell();
    const int result = is_ready ? robot([&] { tell(); }) : kSkipped;
    ::kill(stranger, SIGKILL);
    ::_exit(result);
  }
  int status = 0;
  ::waitpid(pid, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(Stranger, IsHeardOnlyWhereOthersMaySpeak) {
  const int result = beside_a_stranger([](const std::function<void()>& let_attack) {
    LcmBus local(kLocal), network(kNetwork);
    Bytes at_local, at_network;
    local.subscribe("GO", [&](auto, auto bytes) { at_local.push_back(bytes[0]); });
    network.subscribe("GO", [&](auto, auto bytes) { at_network.push_back(bytes[0]); });
    // So that the test can fail: the kernel hands the stranger's datagrams to who does not choose.
    const UdpmUrl url = UdpmUrl::parse(kLocal);
    const int naive = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    const int yes = 1;
    ::setsockopt(naive, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(url.port));
    if (::bind(naive, reinterpret_cast<sockaddr*>(&address), sizeof(address)) != 0) return 1;
    const ip_mreqn membership{{::inet_addr(url.group.c_str())}, {}, 0};
    ::setsockopt(naive, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof(membership));

    let_attack();
    if (!wait_until(network, [&] { return !at_network.empty(); })) return 2;
    if (at_network != Bytes{77}) return 3;  // nobody who claims to be this computer, no fragment
    int open = 0;
    for (char bytes[2048]; ::recv(naive, bytes, sizeof(bytes), 0) > 0;) ++open;
    if (open < 2) return 4;
    if (!local.publish("GO", Bytes{1}) || !wait_until(local, [&] { return !at_local.empty(); })) return 5;
    return at_local == Bytes{1} ? 0 : 6;
  });
  if (result == kSkipped) GTEST_SKIP() << "no network namespaces here";
  EXPECT_EQ(result, 0);
}

TEST(Stranger, CannotFillTheLocalBussBuffer) {
  const int result = beside_a_stranger([](const std::function<void()>& let_attack) {
    LcmBus local("udpm://239.255.76.67:7700?ttl=0&recv_buf_size=4096");
    int heard = 0;
    local.subscribe("GO", [&](auto, auto) { ++heard; });
    for (int i = 0; i < 200; ++i) let_attack();  // 800 datagrams, of which none is drained
    return local.publish("GO", Bytes{1}) && wait_until(local, [&] { return heard == 1; }) ? 0 : 1;
  });
  if (result == kSkipped) GTEST_SKIP() << "no network namespaces here";
  EXPECT_EQ(result, 0);
}

// The radio's interface goes down, is gone, and another comes: no message of a local bus is lost.
TEST(Stranger, MayPullTheCable) {
  const int result = beside_a_stranger([](const std::function<void()>&) {
    LcmBus sender(kLocal), receiver(kLocal);
    int heard = 0, sent = 0;
    receiver.subscribe("GO", [&](auto, auto) { ++heard; });
    const auto is_passed = [&] {
      return sender.publish("GO", Bytes{1}) && wait_until(receiver, [&, all = ++sent] { return heard == all; });
    };
    if (!is_passed()) return 1;
    if (!run("ip link set eth0 down") || !is_passed()) return 2;
    if (!run("ip link delete eth0") || !is_passed()) return 3;
    if (!run("ip link add eth1 type veth peer name eth2 && ip link set eth1 up && ip addr add 10.8.0.1/24 dev eth1")) {
      return kSkipped;
    }
    for (const auto end = Clock::now() + 1100ms; Clock::now() < end;) {
      if (!is_passed()) return 4;
    }
    if (!run("ip route add default dev eth1") || !is_passed()) return 5;
    LcmBus late(kLocal);
    late.subscribe("GO", [&](auto, auto) { heard += 1000; });
    return is_passed() && wait_until(late, [&] { return heard > 1000; }) ? 0 : 6;
  });
  if (result == kSkipped) GTEST_SKIP() << "no network namespaces here";
  EXPECT_EQ(result, 0);
}

}  // namespace
}  // namespace swarm
