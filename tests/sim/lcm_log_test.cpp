// LCM logs, whole and damaged: what is read is what was written, and log_info tells it.
#include "lcmtypes/bus/lcm_log.h"

#include <cstdio>
#include <lcm/lcm-cpp.hpp>
#include <random>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using namespace sogm_swarm;

struct Written {
  Utime utime;
  std::string channel;
  Bytes bytes;
};

// Some events that hold the sync word themselves.
std::vector<Written> write_log(const std::string& path, int events) {
  std::mt19937 random(3);
  lcm::LogFile log(path, "w");
  std::vector<Written> all;
  for (int i = 0; i < events; ++i) {
    Written written{Utime(1s + i * 1ms), "CHANNEL_" + std::to_string(i % 3), Bytes(random() % 200)};
    for (std::uint8_t& byte : written.bytes) byte = static_cast<std::uint8_t>(random());
    if (i % 7 == 0) written.bytes = {0xED, 0xA1, 0xDA, 0x01, 0xED, 0xA1};
    lcm::LogEvent event{};
    event.timestamp = to_us(written.utime);
    event.channel = written.channel;
    event.datalen = static_cast<std::int32_t>(written.bytes.size());
    event.data = written.bytes.data();
    EXPECT_EQ(log.writeEvent(&event), 0);
    all.push_back(written);
  }
  return all;
}

void expect_same(const LogEvent& event, const Written& written) {
  EXPECT_EQ(event.utime, written.utime);
  EXPECT_EQ(event.channel, written.channel);
  EXPECT_EQ(event.bytes, written.bytes);
}

TEST(LcmLog, GivesWhatLcmWrote) {
  const TemporaryDirectory directory;
  const auto all = write_log(directory / "log.lcm", 300);
  LcmLog log(directory / "log.lcm");
  LogEvent event;
  for (const Written& written : all) {
    ASSERT_TRUE(log.next(&event));
    expect_same(event, written);
  }
  EXPECT_FALSE(log.next(&event));
  EXPECT_EQ(log.skipped(), 0);
}

TEST(LcmLog, GoesToAnyEvent) {
  const TemporaryDirectory directory;
  const auto all = write_log(directory / "log.lcm", 100);
  LcmLog log(directory / "log.lcm");
  std::vector<std::int64_t> offsets;
  LogEvent event;
  while (log.next(&event)) offsets.push_back(event.offset);
  ASSERT_EQ(offsets.size(), all.size());
  for (const std::size_t i : {99, 0, 50, 51, 3}) {
    log.go_to(offsets[i]);
    ASSERT_TRUE(log.next(&event));
    expect_same(event, all[i]);
    EXPECT_EQ(event.offset, offsets[i]);
  }
  EXPECT_EQ(log.skipped(), 0);
}

// What is damaged costs the event it is in, what stands between events the one before.
TEST(LcmLog, GoesOnAfterDamage) {
  const TemporaryDirectory directory;
  const auto all = write_log(directory / "log.lcm", 300);
  const std::string whole = read_text(directory / "log.lcm");
  std::vector<std::size_t> offsets;
  std::size_t end = 0;
  for (const Written& written : all) {
    offsets.push_back(end);
    end += 28 + written.channel.size() + written.bytes.size();
  }
  ASSERT_EQ(end, whole.size());
  std::mt19937 random(4);
  for (int trial = 0; trial < 200; ++trial) {
    std::string damaged = whole;
    const std::size_t at = 1 + random() % 298;
    const auto begin = offsets[at], header = std::size_t{28};
    switch (trial % 3) {
      case 0:  // the lengths
        damaged[begin + 20 + random() % 8] = static_cast<char>(0xff);
        break;
      case 1:  // bytes in between
        damaged.insert(begin, "garbage");
        break;
      case 2:  // cut in the middle
        damaged.resize(begin + header / 2);
        break;
    }
    write_text(directory / "damaged.lcm", damaged);
    LcmLog log(directory / "damaged.lcm");
    LogEvent event;
    std::vector<LogEvent> read;
    while (log.next(&event)) read.push_back(event);
    const std::size_t lost = trial % 3 == 0 ? at : at - 1;
    const std::size_t expected = trial % 3 == 2 ? at : 299;
    ASSERT_EQ(read.size(), expected) << "trial " << trial << ", event " << at;
    EXPECT_GT(log.skipped(), 0);
    for (std::size_t i = 0; i < read.size(); ++i) expect_same(read[i], all[trial % 3 != 2 && i >= lost ? i + 1 : i]);
  }
}

TEST(LcmLog, UnreadableFilesAreNamed) {
  const TemporaryDirectory directory;
  for (const std::filesystem::path& path : {directory / "none.lcm", std::filesystem::path("/")})
    EXPECT_THROW(LcmLog log(path), std::runtime_error) << path;
}

TEST(LogInfo, TellsWhatALogHolds) {
  const TemporaryDirectory directory;
  const World world = make_world(Task::kCircle, Environment::kEmpty, 0, 3, {.robots = 2, .circle_m = 2.5});
  FlightOptions options;
  options.link.loss = 0.3;
  BusLog logs(directory.path(), {0, 1});
  const RunReport report = run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
  logs.close();
  const Finished finished = run_program({"log_info", directory / "robot0.lcm", directory / "swarm.lcm"});
  EXPECT_EQ(finished.exit_code, 0) << finished.err;
  const auto expect = [&](const std::string& text) {
    EXPECT_NE(finished.out.find(text), std::string::npos) << "'" << text << "' is missing in:\n" << finished.out;
  };
  expect("robot 0: " + std::to_string(report.robots[0].plans) + " plans");
  std::int64_t announcements = 0, heard = 0, sent = 0;
  LogEvent event;
  for (LcmLog log(directory / "robot0.lcm"); log.next(&event);) {
    announcements += event.channel == channel::kOwnTrajectory;
    heard += event.channel == channel::kPeerTrajectory;
  }
  for (LcmLog log(directory / "swarm.lcm"); log.next(&event);) {
    sogm_swarm::announcement_t message;
    sent += decode_packed(event.bytes, &message) == Refusal::kNone && message.header.robot_id == 0;
  }
  ASSERT_GT(announcements, 50);
  ASSERT_GT(sent, 50);
  expect("robot 0 on OWN_TRAJECTORY: " + std::to_string(announcements) +
         " announcements, 0 missing (0.0 %), 0 restarts");
  expect("robot 0 on ANNOUNCEMENT: " + std::to_string(sent) + " announcements, 0 missing");
  expect("robot 1 on PEER_TRAJECTORY: " + std::to_string(heard) + " announcements, ");
  // Sensed 3 ms before it arrives, a map after 6, announced 6 and 1 later, 3 for what may delay that; then an answer,
  // which may have to be said again.
  double p50_ms = 0.0;
  const std::size_t told = finished.out.find("obstacle to motion ms: p50");
  ASSERT_NE(told, std::string::npos) << finished.out;
  ASSERT_EQ(std::sscanf(finished.out.c_str() + told, "obstacle to motion ms: p50 %lf", &p50_ms), 1);
  EXPECT_GE(p50_ms, 19.0);
  EXPECT_LT(p50_ms, 80.0);
  EXPECT_EQ(finished.out.find("damaged"), std::string::npos);
}

TEST(Identify, FitsTheSimulatedVehicleFromALog) {
  const TemporaryDirectory directory;
  World world = make_world(Task::kCross, Environment::kPure, 20, 3);
  world.vehicle.kind = "quadrotor";
  world.vehicle.lead_ms = world.vehicle.lag_ms = world.vehicle.drag_per_s = 0.0;
  BusLog logs(directory.path(), {0, 1, 2, 3});
  (void)run_lockstep(world, nullptr, {}, {}, &logs, nullptr, nullptr);
  logs.close();
  const std::string csv = directory / "fit.csv";
  const Finished finished = run_program({"identify", "--csv", csv, directory / "robot0.lcm", directory / "robot1.lcm"});
  EXPECT_EQ(finished.exit_code, 0) << finished.err;
  for (const char* text : {"attitude lag     0.07", "mavlink_bridge.cfg", "lead = 0.01", "drag = 0."})
    EXPECT_NE(finished.out.find(text), std::string::npos) << text << " is missing in:\n" << finished.out;
  // What is left of 9.81 m/s^2 beside the 5 to 6 that it was told, over the lag.
  double jerk_mps3 = 0.0;
  const std::size_t found = finished.out.find("robot.env\n  J_MAX=");
  ASSERT_NE(found, std::string::npos) << finished.out;
  ASSERT_EQ(std::sscanf(finished.out.c_str() + found, "robot.env\n  J_MAX=%lf", &jerk_mps3), 1);
  EXPECT_GT(jerk_mps3, 3.8 / 0.08);
  EXPECT_LT(jerk_mps3, 4.9 / 0.06);
  EXPECT_TRUE(read_text(csv).starts_with("flight,time_s,told_x"));
  const Finished swarm = run_program({"identify", directory / "swarm.lcm"});  // no setpoints there
  EXPECT_EQ(swarm.exit_code, 2);
  EXPECT_NE(swarm.err.find(directory / "swarm.lcm"), std::string::npos) << swarm.err;
}

TEST(LogInfo, TellsWhatSensorsSaw) {
  const TemporaryDirectory directory;
  World world = make_world(Task::kCircle, Environment::kPure, 6, 3, {.robots = 2, .circle_m = 2.5});
  world.sensor.kind = "lidar";
  FlightOptions options;
  options.time_limit_s = 3.0;
  BusLog logs(directory.path(), {0, 1});
  (void)run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
  logs.close();
  perception_status_t newest{};
  LogEvent event;
  for (LcmLog log(directory / "robot0.lcm"); log.next(&event);) {
    if (event.channel != channel::kPerceptionStatus) continue;
    ASSERT_EQ(decode(event.bytes, &newest), Refusal::kNone);
  }
  ASSERT_GT(newest.scans, 5);
  const Finished finished = run_program({"log_info", directory / "robot0.lcm"});
  EXPECT_EQ(finished.exit_code, 0) << finished.err;
  for (const std::string& text : {std::to_string(newest.scans) + " scans, 0 saw nothing, 0 jumps of the pose; ",
                                  std::string(" % on robots; "), std::string("obstacle to motion ms: p50 ")})
    EXPECT_NE(finished.out.find(text), std::string::npos) << text << " is missing in:\n" << finished.out;
}

TEST(LogInfo, TellsDamageAndNamesWhatIsNoLog) {
  const TemporaryDirectory directory;
  (void)write_log(directory / "log.lcm", 10);
  write_text(directory / "damaged.lcm", "12345" + read_text(directory / "log.lcm"));
  const Finished damaged = run_program({"log_info", directory / "damaged.lcm"});
  EXPECT_EQ(damaged.exit_code, 0) << damaged.err;
  EXPECT_NE(damaged.out.find("damaged: 5 bytes are no events"), std::string::npos) << damaged.out;
  write_text(directory / "none.lcm", "this is no log");
  write_text(directory / "empty.lcm", "");
  for (const char* name : {"none.lcm", "empty.lcm", "missing.lcm"}) {
    const Finished finished = run_program(std::vector<std::string>{"log_info", directory / name});
    EXPECT_EQ(finished.exit_code, 2) << name;
    EXPECT_NE(finished.err.find(directory / name), std::string::npos) << finished.err;
  }
}

}  // namespace
}  // namespace swarm::test
