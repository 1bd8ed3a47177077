// A keeper_daemon and robots that fly in its cells, as programs over a real bus.
#include <gtest/gtest.h>

#include <csignal>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"
#include "tests/support/harness.h"
#include "tests/support/lcm_bus_fixture.h"

namespace swarm::test {
namespace {

class Keeper : public LcmBusTest {};

TEST_F(Keeper, GoesOnWithItsBooksAfterACrash) {
  const TemporaryDirectory directory;
  const std::string swarm_url = test_url(6), onboard_url = test_url(7), books = (directory / "books").string();
  const auto words = [&](const std::string& begins) {
    return std::vector<std::string>{"keeper_daemon", "--state-dir", books,   "--swarm-url", swarm_url,
                                    "--insecure",    "true",        "--new", begins};
  };
  const Finished without = run_program(words("false"));
  EXPECT_EQ(without.exit_code, 2);
  EXPECT_NE(without.err.find("keeper_daemon: " + books), std::string::npos) << without.err;

  LcmBus swarm(swarm_url), onboard(onboard_url);
  std::optional<CellRoster> roster;
  std::int32_t boot = 0;
  swarm.subscribe("CELL_ROSTER_at_0_0", [&](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::cell_roster_t packed;
    ASSERT_EQ(decode(bytes, &packed), Refusal::kNone);
    ASSERT_EQ(unpack(packed, &roster.emplace()), Refusal::kNone);
    boot = packed.header.boot;
  });
  Program robot({"broadcast_daemon", "--robot-id", "4", "--cells", "8", "--swarm-url", swarm_url, "--onboard-url",
                 onboard_url, "--insecure", "true"});
  std::int64_t seq = 0;
  const auto is_member = [&] {  // the robot is told where it is meanwhile
    const auto state = encoded(state_at(4, {4, 4, 1}, seq++, wall_utime()));
    EXPECT_TRUE(onboard.publish(channel::kRobotState, state));
    onboard.drain();
    std::this_thread::sleep_for(10ms);
    return roster && roster->entries.contains(4) && roster->entries.at(4).state == Membership::kMember;
  };
  std::optional<Program> keeper(words("true"));
  ASSERT_TRUE(wait_until(swarm, is_member, 20s)) << keeper->err() << robot.err();
  const CellRoster before = *roster;
  const std::int32_t boot_before = boot;

  keeper->signal(SIGKILL);
  ASSERT_EQ(keeper->wait(5.0), -SIGKILL);
  keeper.emplace(words("false"));
  roster.reset();
  ASSERT_TRUE(wait_until(
      swarm, [&] { return is_member() && boot > boot_before; }, 20s))
      << keeper->err();
  EXPECT_GE(roster->seq, before.seq);
  EXPECT_EQ(roster->entries.at(4).wish, before.entries.at(4).wish) << "it was never out";
  EXPECT_EQ(roster->entries.at(4).since, before.entries.at(4).since);
  const auto says_so = [&] {
    return is_member() && keeper->err().find("keeps 16 cells: 1 members") != std::string::npos;
  };
  EXPECT_TRUE(wait_until(swarm, says_so, 20s)) << keeper->err();
}

// A second one of the same cells, with books of its own, keeps nothing while the first one speaks.
TEST_F(Keeper, LeavesItsCellsToOneThatBeganEarlier) {
  const TemporaryDirectory directory;
  const std::string swarm_url = test_url(6), onboard_url = test_url(7);
  const auto words = [&](const std::string& id) {
    return std::vector<std::string>{
        "keeper_daemon", "--keeper-id", id,      "--state-dir", (directory / id).string(), "--swarm-url", swarm_url,
        "--insecure",    "true",        "--new", "true"};
  };
  Program first(words("1"));
  LcmBus swarm(swarm_url), onboard(onboard_url);
  std::set<int> keepers;
  swarm.subscribe("CELL_ROSTER_at_0_0", [&](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::cell_roster_t packed;
    ASSERT_EQ(decode(bytes, &packed), Refusal::kNone);
    keepers.insert(packed.header.robot_id);
  });
  Program robot({"broadcast_daemon", "--robot-id", "4", "--cells", "8", "--swarm-url", swarm_url, "--onboard-url",
                 onboard_url, "--insecure", "true"});
  std::int64_t seq = 0;
  const auto tell = [&] {  // the robot where it is
    EXPECT_TRUE(onboard.publish(channel::kRobotState, encoded(state_at(4, {4, 4, 1}, seq++, wall_utime()))));
    onboard.drain();
    std::this_thread::sleep_for(10ms);
  };
  const auto is_kept = [&] { return tell(), keepers.contains(1); };
  ASSERT_TRUE(wait_until(swarm, is_kept, 20s)) << first.err();
  Program second(words("2"));
  const auto gives_way = [&] {
    tell();
    return second.err().find("keeps nothing: another keeper began earlier") != std::string::npos;
  };
  EXPECT_TRUE(wait_until(swarm, gives_way, 20s)) << second.err();
  EXPECT_EQ(keepers, std::set<int>{1});
}

// Six robots, of whom each shares cells with some; their keeper crashes and comes back with its books.
TEST_F(Keeper, KeepsTheCellsOfAFlight) {
  const TemporaryDirectory directory;
  const World world = make_world(Task::kRandom, Environment::kEmpty, 0, 3,
                                 {.robots = 6, .space_m = {16, 8, 4}, .goals = 2, .hop_m = 6});
  write_text(directory / "world.json", to_json_text(world, directory.path()));
  std::vector<std::string> words = {"swarm_sim",
                                    "run",
                                    directory / "world.json",
                                    "--mode",
                                    "processes",
                                    "--cells",
                                    "8",
                                    "--kill",
                                    "keeper@1-1.5",
                                    "--out",
                                    directory / "run",
                                    "--base-port",
                                    std::to_string(base_port())};
  if (kSanitized) {  // real time cannot be kept
    write_text(directory / "slow.cfg", "lead = 0.4\nperiod = 0.3\nstale-map = 2\n");
    words.insert(words.end(), {"--planner-config", directory / "slow.cfg", "--sensor-rate", "3"});
  }
  const Finished flown = run_program(words, 120.0);
  const std::string log = read_text(directory / "run/keeper.log");
  const std::size_t started = log.find("swarm bus");
  EXPECT_NE(log.find("swarm bus", started + 1), std::string::npos) << "twice: " << log;
  const auto report = nlohmann::json::parse(read_text(directory / "run/report.json"));
  EXPECT_EQ(report["touches"].size(), 0u);
  EXPECT_EQ(report["commit_conflicts"], 0);
  EXPECT_GT(report["channels"]["CELL_ROSTER"]["messages"], 20);
  if (kSanitized) return;
  EXPECT_EQ(flown.exit_code, 0) << flown.out << flown.err;
}

}  // namespace
}  // namespace swarm::test
