// A keeper_daemon and a broadcast_daemon that flies in its cells, as programs over a real bus.
#include <gtest/gtest.h>

#include <csignal>
#include <optional>
#include <string>

#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "lcmtypes/bus/temporary_directory.h"
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

}  // namespace
}  // namespace swarm::test
