// The logs of a run as one MCAP file: every message is there, in its topic and its schema; damage and errors are told.
#include <lcm/lcm-cpp.hpp>
#include <nlohmann/json.hpp>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_log.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/json_schema.h"
#include "tests/support/mcap_reader.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Counts = std::map<std::string, std::int64_t>;

Finished convert(const std::vector<std::string>& words) {
  std::vector<std::string> line = {"lcm2mcap"};
  line.insert(line.end(), words.begin(), words.end());
  return run_program(line, 120.0);
}

// Two robots pass each other among obstacles for a second.
void fly(const fs::path& directory) {
  const World world = make_world(Task::kCircle, Environment::kMixed, 6, 3, {.robots = 2, .circle_m = 2.5});
  FlightOptions options;
  options.time_limit_s = 1.0;
  BusLog logs(directory, {0, 1});
  (void)run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
  logs.close();
}

std::vector<LogEvent> events_of(const fs::path& path) {
  std::vector<LogEvent> events;
  LogEvent event;
  for (LcmLog log(path); log.next(&event);) events.push_back(event);
  return events;
}

Counts topics_of(const McapFile& file, bool ours) {
  Counts counts = file.counts();
  std::erase_if(counts, [&](const auto& entry) {
    const std::string name = entry.first.substr(entry.first.rfind('/') + 1);
    return (std::isupper(static_cast<unsigned char>(name.front())) != 0) != ours;
  });
  return counts;
}

void write_event(lcm::LogFile* log, Utime utime, const std::string& channel, Bytes bytes) {
  lcm::LogEvent event{};
  event.timestamp = to_us(utime);
  event.channel = channel;
  event.datalen = static_cast<std::int32_t>(bytes.size());
  event.data = bytes.data();
  ASSERT_EQ(log->writeEvent(&event), 0);
}

TEST(Lcm2Mcap, HoldsEveryMessageOfARun) {
  const TemporaryDirectory directory;
  fly(directory.path());
  const Finished finished = convert({directory / "robot0.lcm", directory / "robot1.lcm", directory / "swarm.lcm",
                                     "--out", directory / "run.mcap", "--map-rate", "1000"});
  ASSERT_EQ(finished.exit_code, 0) << finished.err;
  EXPECT_EQ(finished.out.find("left out"), std::string::npos) << finished.out;
  Counts expected;
  std::int64_t states = 0;
  Utime first = kNever, last{};
  for (const char* bus : {"robot0", "robot1", "swarm"}) {
    for (const LogEvent& event : events_of(directory / (std::string(bus) + ".lcm"))) {
      ++expected[std::string("/") + bus + "/" + event.channel];
      states += event.channel == channel::kRobotState;
      first = std::min(first, event.utime);
      last = std::max(last, event.utime);
    }
  }
  const McapFile file = McapReader::read(directory / "run.mcap");
  EXPECT_EQ(topics_of(file, true), expected);
  EXPECT_GT(expected["/robot1/PEER_TRAJECTORY"], 10);
  const Counts drawn = topics_of(file, false);
  EXPECT_EQ(drawn.at("/tf"), states);
  for (const std::string robot : {"/robot0", "/robot1"}) {
    EXPECT_EQ(drawn.at(robot + "/corridors"), expected[robot + "/CORRIDORS"]);
    EXPECT_EQ(drawn.at(robot + "/obstacles"), expected[robot + "/OBSTACLES"]);
    EXPECT_GT(drawn.at(robot + "/scene"), 9);
    EXPECT_GT(drawn.at(robot + "/sogm"), 9);
  }
  std::map<std::uint16_t, Json> schemas;
  for (const auto& [id, schema] : file.schemas) {
    EXPECT_EQ(schema.encoding, "jsonschema");
    schemas[id] = Json::parse(schema.data);
  }
  for (const McapMessage& message : file.messages) {
    const McapFile::Channel& channel = file.channels.at(message.channel);
    EXPECT_EQ(channel.encoding, "json");
    ASSERT_EQ(misfit(schemas[channel.schema], Json::parse(message.data)), "") << channel.topic;
  }
  EXPECT_TRUE(std::is_sorted(file.messages.begin(), file.messages.end(),
                             [](const auto& a, const auto& b) { return a.time_ns < b.time_ns; }));
  EXPECT_EQ(file.messages.front().time_ns, static_cast<std::uint64_t>(to_us(first)) * 1000);
  EXPECT_EQ(file.messages.back().time_ns, static_cast<std::uint64_t>(to_us(last)) * 1000);
  EXPECT_EQ(file.schemas.at(file.channels.at(file.of("/robot1/GOAL").front().channel).schema).name,
            "sogm_swarm.goal_t");
}

TEST(Lcm2Mcap, PeersAreHeardByTheRobotOfTheLog) {
  const TemporaryDirectory directory;
  fly(directory.path());
  ASSERT_EQ(convert({directory / "robot1.lcm"}).exit_code, 0);
  const McapFile file = McapReader::read(directory / "robot1.mcap");
  const auto heard = file.of("/robot1/PEER_TRAJECTORY");
  ASSERT_FALSE(heard.empty());
  EXPECT_EQ(Json::parse(heard.front().data)["header"]["robot_id"], 0);
  EXPECT_FALSE(file.of("/robot0/scene").empty()) << "what is heard of peers is drawn";
}

TEST(Lcm2Mcap, DamageIsLeftOutAndTold) {
  const TemporaryDirectory directory;
  {
    lcm::LogFile log(directory / "log.lcm", "w");
    const Bytes good = encoded(state_at(0, {1, 2, 3}, 1, kStart));
    Bytes bad = good;
    bad.back() ^= 1;
    write_event(&log, kStart, channel::kRobotState, good);
    write_event(&log, kStart + 1us, channel::kRobotState, bad);
    write_event(&log, kStart + 2us, channel::kSetpoint, good);
    write_event(&log, kStart + 3us, "LCM_SELF_TEST", {1, 2, 3});
    write_event(&log, to_utime(-5), channel::kRobotState, good);
    write_event(&log, to_utime(std::int64_t{1} << 60), channel::kRobotState, good);
    write_event(&log, kStart + 4us, channel::kRobotState, good);
  }
  write_text(directory / "damaged.lcm", "12345" + read_text(directory / "log.lcm"));
  const Finished finished = convert({directory / "damaged.lcm"});
  ASSERT_EQ(finished.exit_code, 0) << finished.err;
  for (const char* line : {" 0.00 s, 5 events, 5 messages on 3 topics, ", "damaged: 267 bytes are no events",
                           "left out, not readable: 2 (ROBOT_STATE crc 1, SETPOINT size 1)",
                           "left out, on channels that are not ours: 1 (LCM_SELF_TEST 1)"})
    EXPECT_NE(finished.out.find(line), std::string::npos) << "'" << line << "' is missing in:\n" << finished.out;
  const McapFile file = McapReader::read(directory / "damaged.mcap");
  EXPECT_EQ(file.counts(), (Counts{{"/robot0/ROBOT_STATE", 2}, {"/robot0/scene", 1}, {"/tf", 2}}));
}

TEST(Lcm2Mcap, BadInputIsNamedAndLeavesNothing) {
  const TemporaryDirectory directory;
  {
    lcm::LogFile log(directory / "log.lcm", "w");
    write_event(&log, kStart, channel::kRobotState, encoded(state_at(0, {1, 2, 3}, 1, kStart)));
  }
  const std::string log = directory / "log.lcm", out = directory / "log.mcap";
  write_text(directory / "empty.lcm", "");
  write_text(directory / "none.lcm", "this is no log");
  write_text(out, "something else");
  const auto expect = [](const std::vector<std::string>& words, const std::string& text) {
    const Finished finished = convert(words);
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_NE(finished.err.find(text), std::string::npos) << "'" << text << "' is missing in:\n" << finished.err;
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
  };
  expect({}, "a log must be given");
  expect({"--fast", log}, "unknown option '--fast'");
  expect({log, "--out"}, "out");
  for (const char* rate : {"0", "-1", "x", "inf"}) expect({log, "--map-rate", rate}, "must be within [0.01, 1000] Hz");
  expect({directory / "missing.lcm"}, (directory / "missing.lcm").string());
  expect({directory / "empty.lcm"}, "empty.lcm: holds no LCM events (0 bytes)");
  expect({log, directory / "none.lcm"}, "none.lcm: holds no LCM events (14 bytes)");
  expect({log}, "log.mcap: exists already");
  expect({log, "--out", directory / "no/where.mcap"}, "there is no directory");
  expect({log, "--out", directory.path()}, "is no file");
  expect({log, "--out", log, "--force", "true"}, "is one of the logs");
  EXPECT_EQ(read_text(out), "something else");
  EXPECT_EQ(std::distance(fs::directory_iterator(directory.path()), fs::directory_iterator()), 4);
  EXPECT_EQ(convert({log, "--force", "true"}).exit_code, 0);
  EXPECT_EQ(McapReader::read(out).messages.size(), 3u);
  EXPECT_EQ(convert({"--help"}).exit_code, 0);
}

}  // namespace
}  // namespace swarm::test
