// An operator's day with real daemons, mavlink_bridge and a simulated flight controller: from the ground to the ground.
#include <signal.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/lcm_log.h"
#include "sogm_swarm/flight_status_t.hpp"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::flight_status_t;

constexpr double kPatience = kSanitized ? 5.0 : 1.0;

// Robots on the ground at z = 0.3, 2 m apart, and what an operator types.
class Day : public testing::Test {
 protected:
  void begin(int robots, const std::vector<std::string>& more = {}) {
    nlohmann::json world = {{"name", "day"},
                            {"space", {{"min", {-5, -5, 0.2}}, {"max", {5, 5, 3}}}},
                            {"limits", {{"speed", 2}, {"acceleration", 6}}},
                            {"obstacles", nlohmann::json::array()}};
    for (int id = 0; id < robots; ++id)
      world["robots"].push_back({{"id", id}, {"start", {2.0 * id - 3.0, -3, 0.3}}, {"radius", 0.2}});
    write_text(directory_ / "world.json", world.dump());
    write_text(directory_ / "slow.cfg", "lead = 0.4\nperiod = 0.3\nstale-map = 2\n");
    std::vector<std::string> words = {"swarm_sim",
                                      "run",
                                      directory_ / "world.json",
                                      "--mode",
                                      "processes",
                                      "--out",
                                      directory_ / "run",
                                      "--base-port",
                                      std::to_string(base_port()),
                                      "--mavlink",
                                      "position",
                                      "--on-ground",
                                      "true",
                                      "--time-limit",
                                      "3600"};
    if (kSanitized) words.insert(words.end(), {"--planner-config", directory_ / "slow.cfg", "--sensor-rate", "3"});
    words.insert(words.end(), more.begin(), more.end());
    flight_.emplace(words);
    ASSERT_TRUE(wait_for(20.0 * kPatience, [&] { return flight_->err().find("t =") != std::string::npos; }))
        << flight_->err();
  }
  Finished tell(std::vector<std::string> words, double seconds = 60.0) {
    const auto usually = [&](const std::string& option, const std::string& value) {
      if (std::ranges::find(words, option) == words.end()) words.insert(words.begin(), {option, value});
    };
    usually("--patience", std::to_string(15.0 * kPatience));
    usually("--arrive", "true");
    words.insert(words.begin(), {"swarm_goal", "--base-port", std::to_string(base_port())});
    return run_program(words, seconds * kPatience);
  }
  // What was said of robot `id` at last.
  nlohmann::json end() {
    flight_->signal(SIGTERM);
    EXPECT_EQ(flight_->wait(10.0 * kPatience), 0) << flight_->err();
    return nlohmann::json::parse(read_text(directory_ / "run/report.json"));
  }
  std::string log(int id, const std::string& daemon) const {
    return read_text(directory_ / ("run/robot" + std::to_string(id) + "-" + daemon + ".log"));
  }
  // Whether daemon `id` has said `words`, in the order of the log after `after`.
  bool has_said(int id, const std::string& daemon, const std::string& words, const std::string& after = "") const {
    const std::string text = log(id, daemon);
    const std::size_t begin = text.find(after);
    return begin != text.npos && text.find(words, begin) != text.npos;
  }
  std::optional<pid_t> pid_of(const std::string& daemon, int id) const {
    const std::string config = directory_ / ("run/robot" + std::to_string(id) + "-" + daemon + ".cfg");
    for (const pid_t pid : processes_with(config)) return pid;
    return std::nullopt;
  }

  TemporaryDirectory directory_;
  std::optional<Program> flight_;
};

TEST_F(Day, FourRobotsTakeOffFlyAMissionHoldComeHomeAndLand) {
  begin(4);
  const Finished early = tell({"--arrive", "false", "--patience", "1", "0", "0,0,1"});
  EXPECT_EQ(early.exit_code, 1);
  EXPECT_EQ(early.out, "robot 0: knows, but is on the ground: take-off comes first\n");
  const Finished up = tell({"--height", "0.9", "0,1,2,3", "take-off"});
  ASSERT_EQ(up.exit_code, 0) << up.out << up.err << log(0, "bridge") << log(0, "broadcast");
  EXPECT_NE(up.out.find("robot 3: is taking off\n"), std::string::npos) << up.out;
  EXPECT_NE(up.out.find("robot 3: is flying\n"), std::string::npos) << up.out;
  const Finished mission = tell({"--tolerance", "0.3", "0", "-3,0,1", "-3,3,1", "0,3,1.5", "0,0,1.5", "-1,-1,1", "1",
                                 "3,3,1", "2", "1,-1,2", "-1,1,2", "1,1,2", "3,1,2", "1,-1,2", "3", "-3,-1,1"},
                                120.0);
  EXPECT_EQ(mission.exit_code, 0) << mission.out << mission.err << log(0, "planner");
  EXPECT_NE(mission.out.find("robot 0: flies to [-1,-1,1] (5 of 5)\n"), std::string::npos) << mission.out;
  ASSERT_EQ(tell({"--arrive", "false", "1", "3,-1,1"}).exit_code, 0);
  const Finished hold = tell({"1", "hold"});
  EXPECT_EQ(hold.exit_code, 0) << hold.out << hold.err;
  EXPECT_EQ(hold.out, "robot 1: is holding its place\n");
  const Finished on = tell({"--tolerance", "0.3", "1", "3,-1,1"});
  EXPECT_EQ(on.exit_code, 0) << "who is sent somewhere goes there: " << on.out;
  const Finished home = tell({"0,1", "home"}), down = tell({"2,3", "land"});
  EXPECT_EQ(home.exit_code, 0) << home.out << home.err;
  EXPECT_EQ(down.exit_code, 0) << down.out << down.err;
  EXPECT_NE(down.out.find("robot 2: is landing\nrobot 3: is landing\n"), std::string::npos) << down.out;
  EXPECT_NE(home.out.find("robot 0: is on the ground\n"), std::string::npos) << home.out;
  const Finished again = tell({"--arrive", "false", "0", "hold"});
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_EQ(again.out, "robot 0: is on the ground, no hold now\n");
  const nlohmann::json report = end();
  EXPECT_EQ(report["outcome"], "success") << report.dump();
  EXPECT_EQ(report["commit_conflicts"], 0);
}

// Four robots fly to and fro. One loses the radio, the next its planner, the next its broadcast daemon, the last what
// tells it where it is: each does what is documented, and all come home.
TEST_F(Day, EachLostLinkIsOutlived) {
  const auto at = [](double t_s) { return std::to_string(kPatience * t_s); };
  begin(4, {"--link-outage", "0:" + at(22) + ":" + at(34), "--kill", "broadcast:2@" + at(29) + "-" + at(29.3),
            "--state-outage", "3:" + at(22) + ":" + at(27)});
  ASSERT_EQ(tell({"--height", "0.9", "0,1,2,3", "take-off"}).exit_code, 0);
  for (int id = 0; id < 4; ++id) {
    const std::string x = std::to_string(2.0 * id - 3.0), robot = std::to_string(id);
    const Finished sent = tell({"--arrive", "false", "--times", "100", robot, x + ",3,1", x + ",-3,1"});
    ASSERT_EQ(sent.exit_code, 0) << sent.out << sent.err;
  }
  const auto said = [&](double seconds, int id, const char* daemon, const char* words, const char* after = "") {
    EXPECT_TRUE(wait_for(kPatience * seconds, [&] { return has_said(id, daemon, words, after); })) << words << "\n"
                                                                                                   << log(id, daemon);
  };
  const char* const without = "goes on without robots 0";
  said(30, 1, "broadcast", without);
  const auto planner = pid_of("planner", 1);
  ASSERT_TRUE(planner);
  ASSERT_EQ(::kill(*planner, SIGSTOP), 0);
  said(30, 2, "broadcast", without);
  said(30, 3, "map", "waits for ROBOT_STATE");
  said(30, 3, "map", "makes maps", "waits for ROBOT_STATE");
  ASSERT_EQ(::kill(*planner, SIGCONT), 0);
  for (const int id : {1, 2}) said(30, id, "broadcast", "agree to\n", without);
  const Finished home = tell({"0,1,2,3", "home"});
  EXPECT_EQ(home.exit_code, 0) << home.out << home.err;
  const nlohmann::json report = end();
  EXPECT_EQ(report["outcome"], "success") << report.dump();
  EXPECT_EQ(report["commit_conflicts"], 0);
}

// Led by a planner that was given more space than its broadcast daemon, a robot leaves it, and is led home.
TEST_F(Day, WhoLeavesTheFlightSpaceIsLedHome) {
  write_text(directory_ / "fence.cfg", "space-min = -5,-5,0\nspace-max = 5,0,3\n");
  begin(1, {"--broadcast-config", directory_ / "fence.cfg"});
  ASSERT_EQ(tell({"--height", "0.9", "0", "take-off"}).exit_code, 0);
  ASSERT_EQ(tell({"--arrive", "false", "0", "-3,3,1"}).exit_code, 0);
  EXPECT_TRUE(wait_for(60.0 * kPatience, [&] {
    return has_said(0, "broadcast", "on the ground", "flying home: it left the flight space");
  })) << log(0, "broadcast");
  EXPECT_EQ(end()["outcome"], "success");
}

// A planner that hangs: its robot rests where its trajectory ends; a landing waits for it, an emergency does not.
TEST_F(Day, AnEmergencyNeedsNoPlanner) {
  begin(1);
  ASSERT_EQ(tell({"--height", "0.9", "0", "take-off"}).exit_code, 0);
  ASSERT_EQ(tell({"--arrive", "false", "0", "3,3,1"}).exit_code, 0);
  const auto planner = pid_of("planner", 0);
  ASSERT_TRUE(planner);
  ASSERT_EQ(::kill(*planner, SIGSTOP), 0);
  const Finished waits = tell({"--arrive", "false", "0", "home"});
  EXPECT_EQ(waits.out, "robot 0: is flying home\n");
  const Finished down = tell({"0", "emergency"});
  EXPECT_EQ(down.exit_code, 0) << down.out << down.err << log(0, "broadcast");
  EXPECT_NE(down.out.find("robot 0: is on the ground\n"), std::string::npos) << down.out;
  ASSERT_EQ(::kill(*planner, SIGCONT), 0);
  EXPECT_EQ(end()["outcome"], "success");
}

// The battery of 45 s: after 36 s in the air the robot goes home by itself.
TEST_F(Day, ALowBatteryLeadsHomeAndDown) {
  begin(1, {"--battery-s", "45"});
  ASSERT_EQ(tell({"--height", "0.9", "0", "take-off"}).exit_code, 0);
  ASSERT_EQ(tell({"--tolerance", "0.3", "0", "3,3,1"}).exit_code, 0);
  const auto is_down = [&] {
    const std::string text = log(0, "broadcast");
    const std::size_t turns = text.find("flying home: the battery is low");
    return turns != text.npos && text.find("on the ground", turns) != text.npos;
  };
  EXPECT_TRUE(wait_for(60.0 * kPatience, is_down)) << log(0, "broadcast");
  EXPECT_EQ(end()["outcome"], "success");
}

// The link between bridge and controller breaks: the controller holds its place by itself, and a pilot has it.
TEST_F(Day, ALostBridgeLeavesTheVehicleToItsPilot) {
  begin(1);
  ASSERT_EQ(tell({"--height", "0.9", "0", "take-off"}).exit_code, 0);
  const std::vector<pid_t> bridges = processes_with("udp:" + std::to_string(base_port() + 66));
  ASSERT_EQ(bridges.size(), 1u);
  ASSERT_EQ(::kill(bridges[0], SIGSTOP), 0);
  ASSERT_FALSE(flight_->wait(2.0));
  ASSERT_EQ(::kill(bridges[0], SIGCONT), 0);
  EXPECT_TRUE(wait_for(5.0, [&] { return log(0, "broadcast").find("holding its place") != std::string::npos; }))
      << log(0, "broadcast") << log(0, "bridge");
  const Finished land = tell({"--arrive", "false", "0", "land"});
  EXPECT_EQ(land.exit_code, 1);
  EXPECT_EQ(land.out, "robot 0: is holding its place, no land now\n");
  (void)end();
}

}  // namespace
}  // namespace swarm::test
