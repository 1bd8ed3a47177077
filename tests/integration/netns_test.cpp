// Robots on computers of their own: each in a network namespace, on one bridge, over real interfaces that lose a fifth
// of all packets, and one of which is cut off for a while. Skipped where namespaces cannot be made.
#include <nlohmann/json.hpp>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_log.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

// Namespaces PREFIX0, PREFIX1, ... and a hub with the bridge; gone with this object.
class Network {
 public:
  Network(const std::string& prefix, int robots) : prefix_(prefix), robots_(robots) {}
  ~Network() {
    for (int k = 0; k < robots_; ++k) run("ip netns delete " + prefix_ + std::to_string(k));
    run("ip netns delete " + prefix_ + "hub");
  }
  Network(const Network&) = delete;
  Network& operator=(const Network&) = delete;

  // False, with the reason in why(), where this is not allowed.
  bool build(int port, int loss_percent) {
    const std::string hub = prefix_ + "hub", bridge = "ip -n " + hub + " link ";
    bool ok = run("ip netns add " + hub) && run(bridge + "add br0 type bridge mcast_snooping 0") &&
              run(bridge + "set br0 up");
    for (int k = 0; k < robots_ && ok; ++k) {
      const std::string name = prefix_ + std::to_string(k), end = "p" + std::to_string(k), in = "ip -n " + name + " ";
      const std::string filter = "ip netns exec " + name + " nft ";
      ok = run("ip netns add " + name) && run(in + "link add eth0 type veth peer name " + end + " netns " + hub) &&
           run(bridge + "set " + end + " master br0") && run(bridge + "set " + end + " up") &&
           run(in + "link set lo up") && run(in + "addr add 10.77.0." + std::to_string(k + 1) + "/24 dev eth0") &&
           run(in + "link set eth0 up") && run(in + "route add 224.0.0.0/4 dev eth0") &&
           run(filter + "add table inet radio") &&
           run(filter + "'add chain inet radio in { type filter hook input priority 0; }'") &&
           run(filter + "add rule inet radio in udp dport " + std::to_string(port) + " ip saddr != 10.77.0." +
               std::to_string(k + 1) + " numgen random mod 100 '<' " + std::to_string(loss_percent) +
               " counter drop");  // of the others; the robot's own are recorded
    }
    return ok;
  }
  // Packets that the filter of a robot has dropped.
  int dropped(int robot) const {
    const Finished listing = run_program(
        {"/bin/sh", "-c", "ip netns exec " + prefix_ + std::to_string(robot) + " nft list chain inet radio in"});
    const std::size_t packets = listing.out.find("packets ");
    return packets == std::string::npos ? -1 : std::stoi(listing.out.substr(packets + 8));
  }
  // Puts a robot's cable in or pulls it out.
  void plug(int robot, bool in) {
    EXPECT_TRUE(run("ip -n " + prefix_ + "hub link set p" + std::to_string(robot) + (in ? " up" : " down"))) << why_;
  }
  const std::string& why() const { return why_; }

 private:
  bool run(const std::string& command) {
    const Finished finished = run_program({"/bin/sh", "-c", command});
    if (finished.exit_code != 0) why_ = command + ": " + finished.err;
    return finished.exit_code == 0;
  }
  std::string prefix_, why_;
  int robots_;
};

// Between two announcements of peers in an onboard log.
double longest_silence_s(const std::string& path) {
  LcmLog log(path);
  std::optional<Utime> before;
  Duration longest{};
  for (LogEvent event; log.next(&event);) {
    if (event.channel != channel::kPeerTrajectory) continue;
    if (before) longest = std::max(longest, event.utime - *before);
    before = event.utime;
  }
  return to_seconds(longest);
}

TEST(Netns, RobotsOnComputersOfTheirOwnFlyOverLossyInterfaces) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root";
  constexpr int kRobots = 4;
  const int port = base_port();
  const std::string prefix = "swarm" + std::to_string(::getpid()) + "-";
  Network network(prefix, kRobots);
  if (!network.build(port, 20)) GTEST_SKIP() << network.why();

  const TemporaryDirectory directory;
  const World world = make_world(Task::kCircle, Environment::kPure, 3, 1, {.robots = kRobots, .circle_m = 3.0});
  write_text(directory / "world.json", to_json_text(world, directory.path()));
  std::vector<std::string> words = {"swarm_sim",
                                    "run",
                                    directory / "world.json",
                                    "--mode",
                                    "processes",
                                    "--netns",
                                    prefix,
                                    "--base-port",
                                    std::to_string(port),
                                    "--out",
                                    directory / "run",
                                    "--kill",
                                    "planner:0@1,broadcast:1@1.5,map:2@2"};
  if (kSanitized) {
    write_text(directory / "slow.cfg", "lead = 0.4\nperiod = 0.3\nstale-map = 2\n");
    words.insert(words.end(), {"--planner-config", directory / "slow.cfg", "--sensor-rate", "3"});
  }
  std::jthread outage([&network] {
    std::this_thread::sleep_for(3s);
    network.plug(2, false);
    std::this_thread::sleep_for(3s);
    network.plug(2, true);
  });
  const Finished finished = run_program(words, 120.0);
  outage.join();
  ASSERT_NE(finished.exit_code, 2) << finished.err;
  EXPECT_GT(longest_silence_s(directory / "run/robot2.lcm"), 2.8);
  for (int robot = 0; robot < kRobots; ++robot) EXPECT_GT(network.dropped(robot), 20);
  const auto report = nlohmann::json::parse(read_text(directory / "run/report.json"));
  EXPECT_TRUE(report["touches"].empty()) << finished.out;
  EXPECT_EQ(report["commit_conflicts"], 0);
  const Finished audit = run_program({"swarm_sim", "audit", (directory / "run/swarm.lcm").string()});
  EXPECT_EQ(audit.exit_code, 0) << audit.out << audit.err;
  if (kSanitized) return;
  EXPECT_EQ(finished.exit_code, 0) << finished.out << finished.err;
}

TEST(Netns, ANamespaceThatIsNotThereIsNamed) {
  const TemporaryDirectory directory;
  write_text(directory / "world.json",
             to_json_text(make_world(Task::kCircle, Environment::kEmpty, 0, 1, {.robots = 2}), directory.path()));
  const Finished finished = run_program({"swarm_sim", "run", directory / "world.json", "--mode", "processes", "--netns",
                                         "no-such-", "--base-port", std::to_string(base_port())});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_NE(finished.err.find("/run/netns/no-such-0"), std::string::npos) << finished.err;
}

}  // namespace
}  // namespace swarm::test
