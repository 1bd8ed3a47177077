#include "swarm_sim/results/recorder.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <iterator>
#include <random>

#include "swarm_sim/results/report.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

namespace fs = std::filesystem;

class RunFiles : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / ("swarm_recorder_" + std::to_string(::getpid()));
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }
  std::string get(const std::string& name) const {
    std::ifstream in(directory_ / name, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  fs::path directory_;
};

TEST_F(RunFiles, TraceHasFixedColumnsAndDigits) {
  TraceWriter trace(directory_ / "trace.csv");
  MotionState state;
  state.position = {1.0 / 3.0, -8, 1e5};
  state.velocity = {0.5, 0, -2};
  state.acceleration = {6, 1e-7, -1};
  trace.write(0.01, 7, state);
  EXPECT_FALSE(fs::exists(directory_ / "trace.csv")) << "not before it is whole";
  trace.close();
  EXPECT_EQ(get("trace.csv"),
            "t,robot,x,y,z,vx,vy,vz,ax,ay,az\n"
            "0.010000,7,0.333333,-8.000000,100000.000000,0.500000,0.000000,-2.000000,6.000000,0.000000,-1.000000\n");
  EXPECT_EQ(std::distance(fs::directory_iterator(directory_), {}), 1);
}

TEST_F(RunFiles, WhatIsNotClosedLeavesNothing) {
  {
    TraceWriter trace(directory_ / "trace.csv");
    BusLog log(directory_, {0, 3});
    log.write(BusId::kSwarm, 0, Utime(1us), "A", {});
    EXPECT_FALSE(fs::is_empty(directory_));
  }
  EXPECT_TRUE(fs::is_empty(directory_));
  EXPECT_THROW(TraceWriter(directory_ / "none" / "trace.csv"), std::runtime_error);
  EXPECT_THROW(BusLog(directory_ / "none", {0}), std::runtime_error);
  EXPECT_THROW(write_file(directory_ / "none" / "report.json", "x"), std::runtime_error);
  EXPECT_THROW(write_file(directory_, "x"), std::runtime_error);
}

TEST_F(RunFiles, LogsHoldEveryEventWithItsTimeOnItsBus) {
  struct Event {
    BusId bus;
    int robot;
    Utime utime;
    std::string channel;
    std::vector<std::uint8_t> bytes;
  };
  std::mt19937 random(8);
  std::vector<Event> events;
  for (int i = 0; i < 500; ++i) {
    std::vector<std::uint8_t> bytes(1 + random() % 300);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    events.push_back({random() % 2 != 0 ? BusId::kSwarm : BusId::kOnboard, random() % 2 != 0 ? 3 : 12, kStart + i * 1ms,
                      i % 3 != 0 ? "TRAJECTORY" : "SOGM", bytes});
  }
  const auto record = [&] {
    BusLog log(directory_, {3, 12});
    for (const Event& e : events) log.write(e.bus, e.robot, e.utime, e.channel, e.bytes);
    log.close();
    return std::vector{get("swarm.lcm"), get("robot3.lcm"), get("robot12.lcm")};
  };
  const auto first = record();
  EXPECT_EQ(first, record()) << "the same events must give the same bytes";
  EXPECT_EQ(std::distance(fs::directory_iterator(directory_), {}), 3);
  lcm::LogFile swarm_log((directory_ / "swarm.lcm").string(), "r"), log3((directory_ / "robot3.lcm").string(), "r"),
      log12((directory_ / "robot12.lcm").string(), "r");
  for (const Event& e : events) {
    lcm::LogFile& log = e.bus == BusId::kSwarm ? swarm_log : e.robot == 3 ? log3 : log12;
    const lcm::LogEvent* read = log.readNextEvent();
    ASSERT_NE(read, nullptr);
    EXPECT_EQ(to_utime(read->timestamp), e.utime);
    EXPECT_EQ(read->channel, e.channel);
    const auto* data = static_cast<const std::uint8_t*>(read->data);
    EXPECT_EQ(std::vector<std::uint8_t>(data, data + read->datalen), e.bytes);
  }
  for (lcm::LogFile* log : {&swarm_log, &log3, &log12}) EXPECT_EQ(log->readNextEvent(), nullptr);
}

TEST(Timing, PercentilesAreOfTheNearestRank) {
  std::vector<double> samples(1000);
  for (int i = 0; i < 1000; ++i) samples[static_cast<std::size_t>(i)] = (i * 7 + 3) % 1000 + 1;  // 1..1000 shuffled
  const TimingStats stats = timing_stats(samples);
  EXPECT_EQ(stats.count, 1000);
  EXPECT_DOUBLE_EQ(stats.mean_ms, 500.5);
  EXPECT_EQ(stats.p50_ms, 500);
  EXPECT_EQ(stats.p95_ms, 950);
  EXPECT_EQ(stats.p99_ms, 990);
  EXPECT_EQ(stats.max_ms, 1000);
  EXPECT_EQ(timing_stats({4.0}).p50_ms, 4.0);
  EXPECT_EQ(timing_stats({4.0}).p99_ms, 4.0);
  EXPECT_EQ(timing_stats({}).count, 0);
  EXPECT_EQ(timing_stats({}).max_ms, 0.0);
}

RunReport example() {
  RunReport report;
  report.world = "cross-mixed-20-7";
  report.mode = "lock-step";
  report.options = {{"latency", "0.05"}, {"loss", "0.1"}};
  report.outcome = Outcome::kCollision;
  report.duration_s = 11.5;
  report.touches = {{3.25, 1, Counterpart::kObstacle, 4, -0.01}};
  report.robots.resize(2);
  report.robots[0].verdict.id = 1;
  report.robots[0].verdict.flight_time_s = 9.12;
  report.robots[0].verdict.to_obstacles = {-0.01, 3.25, 4};
  report.robots[0].plans = 91;
  report.robots[0].plan_rate_hz = 9.97;
  report.robots[0].refused[static_cast<std::size_t>(Refusal::kCrc)] = 3;
  report.robots[0].processor = {{"map", 0.0125}, {"planner", 0.01}};
  report.robots[0].sent_hz = 45.04;
  report.robots[0].received_hz = 135.0;
  report.robots[0].datagram_bytes = 171.6;
  report.robots[1].verdict.id = 22;
  report.planning[5] = timing_stats({1.0, 2.0, 3.0});
  report.commit = timing_stats({4.0});
  report.air = {1518, 182.5, {{{0.0826, 0.1316}, {0.0378, 0.0586}}}, RadioCounts{1500, 30, 3}};
  report.channels["TRAJECTORY"] = {100, 50000, 7};
  return report;
}

TEST_F(RunFiles, ReportTellsEverythingAndWhatIsUnknownIsNull) {
  write_report(example(), directory_ / "report.json");
  const auto json = nlohmann::json::parse(get("report.json"));
  EXPECT_EQ(json["world"], "cross-mixed-20-7");
  EXPECT_EQ(json["outcome"], "collision");
  EXPECT_EQ(json["options"]["loss"], "0.1");
  EXPECT_EQ(json["touches"], nlohmann::json::parse(R"([{"t": 3.25, "robot": 1, "counterpart": "obstacle", "other": 4,
                                                        "distance": -0.01, "at_rest": false}])"));
  EXPECT_EQ(json["robots"][0]["flight_time"], 9.12);
  EXPECT_TRUE(json["robots"][1]["flight_time"].is_null());
  EXPECT_EQ(json["robots"][0]["clearance"]["obstacles"]["other"], 4);
  EXPECT_TRUE(json["robots"][0]["clearance"]["robots"].is_null());
  EXPECT_EQ(json["robots"][0]["refused"], (nlohmann::json{{to_string(Refusal::kCrc), 3}}));
  EXPECT_EQ(json["robots"][0]["processor"], (nlohmann::json{{"map", 0.0125}, {"planner", 0.01}}));
  EXPECT_TRUE(json["robots"][1]["processor"].is_null());
  EXPECT_EQ(json["robots"][1]["max_speed"], (nlohmann::json{0.0, 0.0, 0.0}));
  EXPECT_EQ(json["planning_ms"]["total"]["p50"], 2.0);
  EXPECT_EQ(json["planning_ms"]["search"]["count"], 0);
  EXPECT_EQ(json["robots"][0]["sent_hz"], 45.04);
  EXPECT_EQ(json["robots"][0]["received_hz"], 135.0);
  EXPECT_EQ(json["robots"][0]["datagram_bytes"], 171.6);
  EXPECT_TRUE(json["robots"][1]["received_hz"].is_null());
  EXPECT_EQ(json["commit_ms"]["p99"], 4.0);
  EXPECT_EQ(json["air"], nlohmann::json::parse(R"({"datagrams": 1518, "datagram_bytes": 182.5, "airtime": [
                           {"rate_mbps": 6.0, "share": 0.0826, "busiest_second": 0.1316},
                           {"rate_mbps": 24.0, "share": 0.0378, "busiest_second": 0.0586}],
                           "radio": {"sent": 1500, "collided": 30, "dropped": 3}})"));
  EXPECT_TRUE(to_json(RunReport())["air"]["radio"].is_null());
  EXPECT_EQ(json["channels"]["TRAJECTORY"], (nlohmann::json{{"messages", 100}, {"bytes", 50000}, {"lost", 7}}));
  EXPECT_EQ(std::distance(fs::directory_iterator(directory_), {}), 1);
}

TEST(Summary, TableIsAlignedAndTellsTheTouches) {
  const std::string table = summary_table(example());
  EXPECT_EQ(table,
            "cross-mixed-20-7: collision after 11.50 s (lock-step, 0.00 s of wall time)\n"
            "  robot 1 touched obstacle 4 at 3.25 s\n"
            "  robot  flight s  to obstacles m  to static m  to robots m  path m  plans  plans/s  missed  sent/s  "
            "heard/s  bytes\n"
            "      1      9.12          -0.010            -            -    0.00     91     10.0       0    45.0  "
            "  135.0    172\n"
            "     22         -               -            -            -    0.00      0      0.0       0     0.0  "
            "      -      0\n"
            "  planning ms   mean    p50    p95    p99    max\n"
            "      compose  0.000  0.000  0.000  0.000  0.000\n"
            "       search  0.000  0.000  0.000  0.000  0.000\n"
            "     corridor  0.000  0.000  0.000  0.000  0.000\n"
            "     optimize  0.000  0.000  0.000  0.000  0.000\n"
            "        check  0.000  0.000  0.000  0.000  0.000\n"
            "        total  2.000  2.000  3.000  3.000  3.000\n"
            "      prepare  0.000  0.000  0.000  0.000  0.000\n"
            "       commit  4.000  4.000  4.000  4.000  4.000\n"
            "     airtime %  mean  busiest second\n"
            "   at 6 Mbit/s   8.3            13.2\n"
            "  at 24 Mbit/s   3.8             5.9\n"
            "  lost in collisions 2.0 %, in queues 0.2 %\n"
            "  % of a core   map  planner   all\n"
            "      robot 1  1.25     1.00  2.25\n")
      << table;
}

}  // namespace
}  // namespace swarm
