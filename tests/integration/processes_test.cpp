// Real daemons over real multicast (TTL 0): a flight, and what remains when somebody is interrupted or killed.
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/lcm_log.h"
#include "planner_daemon/trajectory/trajectory.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"
#include "tests/support/harness.h"
#include "tests/support/sensor_phases.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

// Two robots that swap places among three columns.
class Processes : public testing::Test {
 protected:
  Processes() {
    const World world = make_world(Task::kCircle, Environment::kPure, 3, 1, {.robots = 2, .circle_m = 2.5});
    write_text(directory_ / "world.json", to_json_text(world, directory_.path()));
    // Real time cannot be kept under sanitizers: plans less often, from further ahead.
    write_text(directory_ / "slow.cfg", "lead = 0.4\nperiod = 0.3\nstale-map = 2\n");
  }

  std::vector<std::string> command(const std::string& out) const {
    std::vector<std::string> words = {"swarm_sim",      "run",         directory_ / "world.json",
                                      "--mode",         "processes",   "--out",
                                      directory_ / out, "--base-port", std::to_string(base_port())};
    if (kSanitized) words.insert(words.end(), {"--planner-config", directory_ / "slow.cfg", "--sensor-rate", "3"});
    return words;
  }

  // The daemons of the runs of this test.
  std::vector<pid_t> daemons(const std::string& which = "") const {
    std::vector<pid_t> found;
    for (const pid_t pid : processes_with(which.empty() ? directory_.path().string() : which)) {
      std::ifstream in("/proc/" + std::to_string(pid) + "/cmdline", std::ios::binary);
      const std::string line{std::istreambuf_iterator<char>(in), {}};
      const bool ours = line.find(directory_.path()) != line.npos;
      if (ours && line.find("_daemon") != line.npos) found.push_back(pid);
    }
    return found;
  }
  bool no_daemon_within(double seconds) const {
    return wait_for(seconds, [&] { return daemons().empty(); });
  }

  static void wait_until_it_flies(Program& program) {
    const bool flies = wait_for(20.0, [&] { return program.err().find("t =") != std::string::npos; });
    ASSERT_TRUE(flies) << program.err();
    ASSERT_FALSE(program.wait(0.7)) << program.err();  // mid-flight now
  }
  // Of the files that make up a result; the daemons' own configs and logs may stay.
  std::set<std::string> results(const std::string& out) const {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(directory_ / out)) {
      const std::string name = entry.path().filename();
      if (!name.ends_with(".cfg") && !name.ends_with(".log")) names.insert(name);
    }
    return names;
  }

  TemporaryDirectory directory_;
};

// Somebody on the swarm bus without the key speaks as robot 1, from a later start and as far as numbers go: it is far
// away, it is huge, it is from the future. Believed once, any of these grounds robot 0 or leads it into robot 1.
TEST_F(Processes, ForgedAnnouncementsChangeNothing) {
  Program program(command("run"));
  wait_until_it_flies(program);
  LcmBus bus(swarm_bus_url(base_port()));
  int forged = 0;
  bus.subscribe(channel::kAnnouncement, [&](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::announcement_t message;
    if (decode_packed(bytes, &message) != Refusal::kNone || message.header.robot_id != 1) return;
    if (message.header.seq >= std::int64_t{1} << 61) return;  // the own ones
    message.header.seq |= std::int64_t{1} << 62;
    if (forged % 3 != 2) message.header.boot = std::numeric_limits<std::int32_t>::max();
    if (forged % 3 == 0) message.radius = 10.0F;
    if (forged % 3 == 1) message.header.utime += 500'000;
    if (forged % 3 == 2) {
      const Trajectory away = Trajectory::hover(message.committed.seq + 1, to_utime(message.header.utime), {50, 50, 2});
      message.committed = away.to_wire();
      message.pending = {};
      message.pending_state = sogm_swarm::announcement_t::kNone;
    }
    forged += bus.publish(channel::kAnnouncement, packed(message)) ? 1 : 0;
  });
  const auto end = std::chrono::steady_clock::now() + 90s;
  while (!program.wait(0.002) && std::chrono::steady_clock::now() < end) bus.drain();
  EXPECT_EQ(program.wait(0.1), 0) << program.err();
  EXPECT_GT(forged, 20);
  const auto report = nlohmann::json::parse(read_text(directory_ / "run/report.json"));
  EXPECT_EQ(report["outcome"], "success");
  EXPECT_EQ(report["touches"].size(), 0u);
  EXPECT_NE(read_text(directory_ / "run/robot0-broadcast.log").find("were not sealed with this swarm's key"),
            std::string::npos);
}

TEST_F(Processes, FlyToTheEnd) {
  Program program(command("run"));
  wait_until_it_flies(program);
  EXPECT_EQ(daemons().size(), 6u);
  const std::optional<int> exit_code = program.wait(90.0);
  ASSERT_TRUE(exit_code) << program.err();
  EXPECT_TRUE(no_daemon_within(0.0));
  EXPECT_EQ(results("run"),
            (std::set<std::string>{"report.json", "robot0.lcm", "robot1.lcm", "swarm.lcm", "trace.csv", "world.json"}));
  const auto report = nlohmann::json::parse(read_text(directory_ / "run/report.json"));
  EXPECT_EQ(report["mode"], "processes");
  for (const auto& robot : report["robots"]) {
    EXPECT_GT(robot["plans"], 0);
    EXPECT_EQ(robot["processor"].size(), 3u);
    for (const double share : robot["processor"]) EXPECT_TRUE(share > 0.0005 && share < 1.0) << robot["processor"];
  }
  const std::pair<std::string, std::string> about[] = {
      {"map", "makes maps"}, {"planner", "plans to ["}, {"broadcast", "ready: "}};
  for (const std::string robot : {"robot0", "robot1"}) {
    for (const auto& [daemon, activity] : about) {
      const fs::path stem = directory_ / ("run/" + robot + "-" + daemon);
      EXPECT_GT(fs::file_size(stem.string() + ".cfg"), 0u) << stem;
      const std::string log = read_text(stem.string() + ".log");
      EXPECT_NE(log.find("info " + daemon + "_daemon: " + activity), log.npos) << log;
      EXPECT_NE(log.find("stopped by SIGTERM"), log.npos) << log;  // and no sanitizer had the last word
    }
  }
  if (kSanitized) return;
  EXPECT_EQ(*exit_code, 0) << program.err() << program.out();
  EXPECT_EQ(report["outcome"], "success");
  EXPECT_NE(program.out().find("success"), std::string::npos) << program.out();
  for (const auto& robot : report["robots"]) EXPECT_GE(robot["plan_rate_hz"], 3.5) << program.out();
  for (const auto& robot : report["robots"]) EXPECT_GT(robot["clearance"]["robots"]["distance"], 0.0);
  for (const int robot : {0, 1})
    expect_sensor_phases(directory_ / "run" / ("robot" + std::to_string(robot) + ".lcm"), robot, 0.5);
}

// Setpoints go out as MAVLink, a quadrotor in the wind follows them, and where it is comes back the same way.
class ProcessesThroughMavlink : public Processes, public testing::WithParamInterface<const char*> {};
INSTANTIATE_TEST_SUITE_P(Targets, ProcessesThroughMavlink, testing::Values("position", "attitude"),
                         [](const auto& p) { return std::string(p.param); });

TEST_P(ProcessesThroughMavlink, FlyInTheWind) {
  std::vector<std::string> words = command("run");
  words.insert(words.end(), {"--mavlink", GetParam(), "--vehicle", "quadrotor", "--wind-mps", "3"});
  Program program(words);
  wait_until_it_flies(program);
  EXPECT_EQ(program.wait(90.0), 0) << program.err();
  EXPECT_TRUE(no_daemon_within(0.0));
  const auto report = nlohmann::json::parse(read_text(directory_ / "run/report.json"));
  EXPECT_EQ(report["outcome"], "success");
  for (const char* robot : {"robot0", "robot1"}) {
    const std::string log = read_text(directory_ / "run" / (std::string(robot) + "-bridge.log"));
    EXPECT_NE(log.find("following setpoints"), std::string::npos) << log;
  }
  LcmLog recorded(directory_ / "run" / "robot0.lcm");
  int states = 0;
  for (LogEvent event; recorded.next(&event);) states += event.channel == channel::kRobotState;
  EXPECT_GT(states, 100);
}

// Each daemon crashes once, one robot is out of reach for three seconds, and the radio is bad.
TEST_F(Processes, FlyOverABadRadioThroughCrashes) {
  std::vector<std::string> words = command("run");
  words.insert(words.end(), {"--link-delay-ms", "100", "--link-jitter-ms", "50", "--link-loss", "0.2", "--link-outage",
                             "1:1:4", "--kill", "planner:0@0.5,map:1@1,broadcast:0@1.5,broadcast:1@2-3"});
  const Finished finished = run_program(words, 120.0);
  const Finished audit = run_program({"swarm_sim", "audit", (directory_ / "run/swarm.lcm").string()});
  EXPECT_EQ(audit.exit_code, 0) << audit.out << audit.err;
  const auto report = nlohmann::json::parse(read_text(directory_ / "run/report.json"));
  EXPECT_TRUE(report["touches"].empty()) << finished.out;
  EXPECT_EQ(report["commit_conflicts"], 0);
  for (const char* daemon : {"robot0-planner", "robot1-map", "robot0-broadcast", "robot1-broadcast"}) {
    const std::string log = read_text(directory_ / "run" / (std::string(daemon) + ".log"));
    const std::size_t started = log.find("onboard bus");
    EXPECT_NE(log.find("onboard bus", started + 1), log.npos) << log;  // twice
  }
  if (kSanitized) return;
  EXPECT_EQ(finished.exit_code, 0) << finished.out << finished.err;
}

// Robots without goals of their own are told where to go, until somebody ends the flight.
TEST_F(Processes, AnEndlessFlightIsToldWhereToGoAndEndsWhenItIsEnded) {
  const std::string text = R"({"name": "endless", "space": {"min": [-4,-4,0], "max": [4,4,3]},
    "limits": {"speed": 2, "acceleration": 6}, "obstacles": [],
    "robots": [{"id": 0, "start": [-2,0,1], "radius": 0.2}, {"id": 1, "start": [2,0,1], "radius": 0.2}]})";
  write_text(directory_ / "world.json", text);
  std::vector<std::string> words = command("run");
  words.insert(words.end(), {"--time-limit", "3600"});
  Program program(words);
  wait_until_it_flies(program);
  const std::string onboard = local_url(base_port() + 33);
  const std::string patience = std::to_string(10 * kPatience);
  const Finished there = run_program(
      {"swarm_goal", "--onboard-url", onboard, "--patience", patience, "--arrive", "true", "0", "1", "1", "1"}, 120.0);
  EXPECT_EQ(there.exit_code, 0) << there.out << there.err;
  program.signal(SIGTERM);
  EXPECT_EQ(program.wait(5.0 * kPatience), 0) << program.err();
  EXPECT_TRUE(no_daemon_within(0.0));
  const auto report = nlohmann::json::parse(read_text(directory_ / "run/report.json"));
  EXPECT_EQ(report["outcome"], "success");
  EXPECT_TRUE(report["robots"][0]["flight_time"].is_null());
  EXPECT_GT(report["robots"][0]["path_length"], 3.0);
  EXPECT_LT(report["robots"][1]["path_length"], 0.5);
}

TEST_F(Processes, InterruptEndsAllAndKeepsWhatWasFlown) {
  Program program(command("run"));
  wait_until_it_flies(program);
  program.signal(SIGINT);
  EXPECT_EQ(program.wait(3.0 * kPatience), 130) << program.err();
  EXPECT_TRUE(no_daemon_within(0.0));
  EXPECT_EQ(results("run"),
            (std::set<std::string>{"robot0.lcm", "robot1.lcm", "swarm.lcm", "trace.csv", "world.json"}));
  EXPECT_NE(program.err().find("interrupted; what was flown is in "), std::string::npos) << program.err();
  // One that cannot begin changes nothing.
  const Finished refused = run_program({"swarm_sim", "run", directory_ / "world.json", "--mode", "processes", "--out",
                                        directory_ / "run", "--clock-step", "0:1:1"});
  EXPECT_EQ(refused.exit_code, 2) << refused.err;
  EXPECT_TRUE(fs::exists(directory_ / "run/robot0.lcm"));
  // The next flight, in another mode, leaves nothing of this one.
  EXPECT_TRUE(fs::exists(directory_ / "run/robot0-map.log"));
  EXPECT_EQ(run_program({"swarm_sim", "run", directory_ / "world.json", "--out", directory_ / "run"}, 60.0).exit_code,
            0);
  EXPECT_FALSE(fs::exists(directory_ / "run/robot0-map.log"));
}

TEST_F(Processes, DaemonsDoNotOutliveAKilledSimulator) {
  Program program(command("run"));
  wait_until_it_flies(program);
  EXPECT_EQ(daemons().size(), 6u);
  program.signal(SIGKILL);
  EXPECT_EQ(program.wait(2.0), -SIGKILL);
  EXPECT_TRUE(no_daemon_within(2.0 * kPatience)) << daemons().size() << " are left";
  for (const std::string& name : results("run")) EXPECT_NE(name.find(".part"), name.npos) << name;
}

TEST_F(Processes, AKilledDaemonEndsTheRunByName) {
  Program program(command("run"));
  wait_until_it_flies(program);
  const std::vector<pid_t> planner = daemons("robot1-planner.cfg");
  ASSERT_EQ(planner.size(), 1u);
  ASSERT_EQ(::kill(planner[0], SIGKILL), 0);
  EXPECT_EQ(program.wait(3.0 * kPatience), 2) << program.err();
  EXPECT_TRUE(no_daemon_within(0.0));
  EXPECT_EQ(results("run"), std::set<std::string>{});
  EXPECT_NE(program.err().find("robot 1's planner_daemon: killed by signal 9"), std::string::npos) << program.err();
}

TEST_F(Processes, ASecondSwarmOnTheSameBusIsRefused) {
  Program first(command("first"));
  wait_until_it_flies(first);
  const Finished second = run_program(command("second"));
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_NE(second.err.find("another swarm is on this bus"), std::string::npos) << second.err;
  EXPECT_NE(second.err.find("--base-port"), std::string::npos) << second.err;
  EXPECT_EQ(results("second"), std::set<std::string>{});
  EXPECT_TRUE(first.running()) << first.err();
  EXPECT_EQ(daemons().size(), 6u);
}

}  // namespace
}  // namespace swarm::test
