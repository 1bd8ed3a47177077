// tools/check_machine on machines that are not as they should be: each fault is named, with what mends it.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include <atomic>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/realtime_host.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

class CheckMachine : public testing::Test {
 protected:
  CheckMachine() {
    const std::string port = std::to_string(base_port()), onboard = std::to_string(base_port() + 33);
    std::string text = read_text(std::filesystem::path(SWARM_SOURCE_DIR) / "tools/deploy/robot.env");
    text = replaced(replaced(text, ":7700", ":" + onboard), ":7667", ":" + port);
    shipped_ = text;
    configure(replaced(replaced(text, "ROBOT_ID=\n", "ROBOT_ID=0\n"), "ROSTER=\n", "ROSTER=0\n"));
    std::filesystem::copy(std::filesystem::path(SWARM_SOURCE_DIR) / "tools/deploy/fragments.nft", directory_.path());
    set_key(std::string(64, 'a') + "\n");
  }
  void configure(const std::string& text) { write_text(directory_ / "robot.env", text), text_ = text; }

  void set_key(const std::string& text, unsigned mode = 0600) {
    write_text(directory_ / "swarm.key", text);
    ::chmod((directory_ / "swarm.key").c_str(), mode);
  }

  Finished check(std::vector<std::string> prefix = {}, std::vector<std::string> more = {}) {
    if (prefix.empty()) prefix = {"/usr/bin/env"};
    // Of this build, not of another in the tree.
    for (const char* word :
         {"/bin/bash", SWARM_SOURCE_DIR "/tools/check_machine", "--programs", SWARM_BIN_DIR, "--config"})
      prefix.push_back(word);
    prefix.push_back(directory_.path());
    prefix.insert(prefix.end(), {"--seconds", "0.5"});
    prefix.insert(prefix.end(), more.begin(), more.end());
    return run_program(prefix, 60.0);
  }
  static bool says(const Finished& finished, const std::string& text) {
    return finished.out.find(text) != std::string::npos;
  }

  TemporaryDirectory directory_;
  std::string text_, shipped_;  // of robot.env
};

// Two robots with one number would collide.
TEST_F(CheckMachine, RefusesARobotWithoutANumber) {
  configure(shipped_);
  const Finished finished = check();
  EXPECT_EQ(finished.exit_code, 1);
  EXPECT_TRUE(says(finished, "FAIL  ROBOT_ID in ")) << finished.out;
  EXPECT_TRUE(says(finished, "FAIL  ROSTER in ")) << finished.out;
  EXPECT_TRUE(says(finished, "FAIL  configuration: map_daemon: --robot-id : must be a whole number")) << finished.out;
}

TEST_F(CheckMachine, AcceptsTheConfigurationThatIsShipped) {
  const Finished finished = check();
  for (const char* daemon : {"map", "planner", "broadcast"})
    EXPECT_TRUE(says(finished, std::string("ok    configuration of ") + daemon + "_daemon\n")) << finished.out;
  EXPECT_TRUE(says(finished, "ok    the swarm bus leaves this computer (ttl=1)\n")) << finished.out;
  EXPECT_TRUE(says(finished, "ok    key in ")) << finished.out;
  EXPECT_TRUE(says(finished, "warn  nobody is heard on the swarm bus")) << finished.out;
  EXPECT_TRUE(says(finished, "check_machine: "));
  EXPECT_EQ(finished.err, "");
  configure(replaced(replaced(text_, "J_MAX=0\n", ""), "EXPLORES=true\n", ""));  // written before there were such
  EXPECT_TRUE(says(check(), "ok    configuration of planner_daemon\n"));
}

TEST_F(CheckMachine, NamesWhatIsConfiguredWrongly) {
  configure(replaced(replaced(replaced(text_, "RADIUS=0.2", "RADIUS=-1"), "ttl=1", "ttl=0"), "ROSTER=0", "ROSTER=1,2"));
  const Finished finished = check();
  EXPECT_EQ(finished.exit_code, 1);
  EXPECT_TRUE(says(finished, "FAIL  configuration: planner_daemon: --radius -1: must be within [0.01, 10] m"))
      << finished.out;
  EXPECT_TRUE(says(finished, "has ttl=0: announcements never leave this computer")) << finished.out;
  EXPECT_TRUE(says(finished, "warn  configuration: robot 0 is not in its own roster 1,2")) << finished.out;
  std::string text = replaced(text_, "RADIUS=-1", "RADIUS=0.2");
  text = replaced(text, "CLOCK_ERROR=0.01", "CLOCK_ERROR=soon");
  configure(replaced(text, "STATIC_MAP=", "STATIC_MAP=/no/map.bt"));
  const Finished others = check();
  EXPECT_TRUE(says(others, "FAIL  configuration: broadcast_daemon: --clock-error soon: must be within")) << others.out;
  EXPECT_TRUE(says(others, "FAIL  configuration: STATIC_MAP /no/map.bt cannot be read")) << others.out;
  text = replaced(text, "CLOCK_ERROR=soon", "CLOCK_ERROR=0.01");
  configure(replaced(text, "EXPLORES=true", "EXPLORES=maybe"));
  EXPECT_TRUE(says(check(), "FAIL  configuration: map_daemon: --explores maybe: must be"));
  configure(replaced(text, "J_MAX=0", "J_MAX=-1"));
  EXPECT_TRUE(says(check(), "FAIL  configuration: planner_daemon: --j-max -1: must be within [0, 1e+05] m/s^3"));
  EXPECT_EQ(check({}, {"--seconds", "x"}).exit_code, 2);
  EXPECT_EQ(check({}, {"--nonsense"}).exit_code, 2);
  EXPECT_EQ(check({}, {"--config", "/no/such"}).err, "check_machine: /no/such/robot.env: there is no such file\n");
}

TEST_F(CheckMachine, NamesWhatIsWrongWithTheKey) {
  const std::string key(64, 'a');
  set_key("");
  EXPECT_TRUE(says(check(), "FAIL  no key in "));
  set_key(key + "\n" + key.substr(1) + "\n");
  EXPECT_TRUE(says(check(), "must hold one key or two"));
  set_key(key + "\n" + key + "\n" + key + "\n");
  EXPECT_TRUE(says(check(), "must hold one key or two"));
  set_key("# ours\n" + key + "\n", 0644);
  EXPECT_TRUE(says(check(), "can be read by others; mend: chmod o-rwx "));
  configure(replaced(text_, "INSECURE=false", "INSECURE=true"));
  EXPECT_TRUE(says(check(), "warn  INSECURE=true"));
}

// Its key is one that daemons take.
TEST_F(CheckMachine, TakesANewKey) {
  std::filesystem::remove(directory_ / "swarm.key");
  const std::vector<std::string> new_key = {"/bin/bash", SWARM_SOURCE_DIR "/tools/new_key", directory_ / "swarm.key"};
  EXPECT_EQ(run_program(new_key).exit_code, 0);
  EXPECT_TRUE(says(check(), "ok    key in "));
  EXPECT_FALSE(SwarmKeys::read(std::string(directory_ / "swarm.key")).empty());
  const std::string first = read_text(directory_ / "swarm.key");
  EXPECT_EQ(run_program(new_key).exit_code, 1);  // is there already
  EXPECT_EQ(read_text(directory_ / "swarm.key"), first);
}

TEST_F(CheckMachine, NamesWhoHasThePort) {
  const int taken = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(base_port()));
  ASSERT_EQ(::bind(taken, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  std::string own_name = read_text("/proc/self/comm");
  own_name.pop_back();
  const Finished finished = check();
  EXPECT_TRUE(says(finished, "FAIL  port " + std::to_string(base_port()) +
                                 " of the swarm bus is used by another program (" + own_name + ", process " +
                                 std::to_string(::getpid()) + ")"))
      << finished.out;
  EXPECT_TRUE(says(finished, "FAIL  the swarm bus cannot be opened")) << finished.out;
  ::close(taken);
  EXPECT_FALSE(says(check(), "used by another program"));
}

TEST_F(CheckMachine, TellsOtherVersionsAndClocksByTheirRobot) {
  LcmBus bus("udpm://239.255.76.68:" + std::to_string(base_port()) + "?ttl=0");
  std::atomic<bool> done = false;
  std::thread swarm([&] {
    for (std::int64_t seq = 1; !done; ++seq) {
      for (int robot = 1; robot <= 3; ++robot) {
        sogm_swarm::announcement_t message{};
        const Duration ahead = robot == 3 ? 80ms : 0ms;
        message.header = make_header(robot, 1, seq, wall_utime() + ahead);
        message.radius = 0.2f;
        message.committed = Trajectory::hover(1, wall_utime(), {0, 0, 1}).to_wire();
        message.least_delay_us = sogm_swarm::announcement_t::kUnknown;
        Bytes bytes = packed(message);
        if (robot == 2) bytes[3] ^= 1;  // another fingerprint
        EXPECT_TRUE(bus.publish(channel::kAnnouncement, bytes));
      }
      std::this_thread::sleep_for(20ms);
    }
  });
  const Finished finished = check();
  done = true;
  swarm.join();
  EXPECT_EQ(finished.exit_code, 1);
  EXPECT_TRUE(says(finished, "ok    robot 1 is heard and understood")) << finished.out;
  EXPECT_TRUE(says(finished, "FAIL  robot 2: ")) << finished.out;
  EXPECT_TRUE(says(finished, "messages cannot be read (fingerprint): it runs another version of these programs"));
  EXPECT_TRUE(says(finished, "FAIL  robot 3: its messages come from the future, -")) << finished.out;
}

TEST_F(CheckMachine, FindsAndMendsAMissingRoute) {
  if (::geteuid() != 0) GTEST_SKIP() << "network namespaces need root";
  const std::string name = "swarm_check" + std::to_string(::getpid());
  if (run_program({"/bin/ip", "netns", "add", name}).exit_code != 0) GTEST_SKIP() << "no network namespaces here";
  const std::vector<std::string> there = {"/bin/ip", "netns", "exec", name};
  const auto ip = [&](std::vector<std::string> words) {
    words.insert(words.begin(), "/bin/ip");
    words.insert(words.begin(), there.begin(), there.end());
    EXPECT_EQ(run_program(words).exit_code, 0);
  };
  ip({"link", "set", "lo", "up"});
  ip({"link", "add", "radio", "type", "veth", "peer", "name", "air"});
  ip({"addr", "add", "10.9.0.1/24", "dev", "radio"});
  ip({"link", "set", "radio", "up"});
  ip({"link", "set", "air", "up"});
  const std::string route = "ip route replace 224.0.0.0/4 dev radio";
  const Finished before = check(there);
  EXPECT_EQ(before.exit_code, 1);
  EXPECT_TRUE(says(before, "FAIL  no multicast route for the swarm bus (239.255.76.68); mend: " + route)) << before.out;
  const Finished mended = check(there, {"--fix"});
  EXPECT_TRUE(says(mended, "fix   " + route)) << mended.out << mended.err;
  const std::string after = mended.out.substr(std::min(mended.out.find("looking again"), mended.out.size()));
  EXPECT_NE(after.find("ok    multicast route of the swarm bus: 239.255.76.68 by radio"), std::string::npos)
      << mended.out;
  EXPECT_EQ(after.find("no multicast route"), std::string::npos) << mended.out;
  EXPECT_EQ(run_program({"/bin/ip", "netns", "del", name}).exit_code, 0);
}

}  // namespace
}  // namespace swarm::test
