#include "planner_daemon/coordination/cell_keeper.h"

#include <gtest/gtest.h>

#include <random>

#include "planner_daemon/coordination/cell.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::announcement_t;

constexpr Cell kCell{3, -1};
const auto kKeeps = [](const CellKeeper::Book&) { return true; };
const auto kFails = [](const CellKeeper::Book&) { return false; };

CellAnnouncement announcement(int id, std::int64_t seq, std::int64_t wish, bool wishes, std::int32_t pending_seq = 0) {
  CellAnnouncement message{};
  message.robot.header = make_header(id, 1, seq, kStart);
  message.robot.committed = Trajectory::hover(1, kStart, {1, 2, 3}).to_wire();
  if (pending_seq > 0) {
    message.robot.pending = Trajectory::hover(pending_seq, kStart + 1s, {1, 2, 3}).to_wire();
    message.robot.pending_state = announcement_t::kAnnounced;
  }
  message.cells[kCell] = {wish, wishes};
  return message;
}

TEST(Cell, MotionsTouchAllCellsThatTheyComeCloseTo) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-20, 20), offset(-0.3, 0.3);
  for (int trial = 0; trial < 200; ++trial) {
    const auto somewhere = [&] { return Eigen::Vector3d(place(random), place(random), 1); };
    MotionState from;
    from.position = somewhere();
    Motion motion{quintic_to(from, kStart, somewhere(), 4.0, 5), {}};
    const Utime turns = kStart + 2s;
    if (trial % 2 == 1) motion.next = quintic_to(motion.at(turns), turns, somewhere(), 4.0, 3);
    const std::set<Cell> cells = cells_touched(motion, kStart + 1s, 0.5, 8);
    for (Utime t = kStart + 1s; t < kStart + 8s; t += 20ms) {
      const Eigen::Vector3d near = motion.at(t).position + Eigen::Vector3d(offset(random), offset(random), 0);
      const Cell cell{static_cast<int>(std::floor(near.x() / 8)), static_cast<int>(std::floor(near.y() / 8))};
      ASSERT_TRUE(cells.contains(cell)) << "trial " << trial << " at " << near.transpose();
    }
  }
  // What is over does not count, and a robot that rests is in few.
  const Motion rests{Trajectory::hover(1, kStart, {4, 4, 1}), {}};
  EXPECT_EQ(cells_touched(rests, kStart + 1s, 0.5, 8), std::set<Cell>({{0, 0}}));
  EXPECT_EQ(cells_touched({Trajectory::hover(1, kStart, {-0.2, 8.3, 1}), {}}, kStart, 0.5, 8),
            std::set<Cell>({{-1, 0}, {-1, 1}, {0, 0}, {0, 1}}));
}

TEST(CellKeeper, RecordsWhoIsThereAndWhatIsPending) {
  CellKeeper keeper(CellKeeper::Book{kCell});
  keeper.receive(announcement(4, 1, 10, true), kKeeps);
  const CellRoster roster = keeper.roster();
  EXPECT_EQ(roster.entries.at(4).state, Membership::kMember);
  EXPECT_EQ(roster.entries.at(4).wish, 10);
  EXPECT_EQ(roster.entries.at(4).since, roster.epoch);
  EXPECT_EQ(roster.entries.at(4).recorded_seq, 0);
  keeper.receive(announcement(4, 2, 10, true, 2), kKeeps);
  EXPECT_EQ(keeper.roster().entries.at(4).recorded_seq, 2);
  EXPECT_EQ(keeper.roster().epoch, roster.epoch);
  EXPECT_GT(keeper.roster().seq, roster.seq);
  keeper.receive(announcement(4, 1, 10, true), kKeeps);  // arrives late
  EXPECT_EQ(keeper.roster().entries.at(4).recorded_seq, 2);
}

TEST(CellKeeper, ANumberCountsOnce) {
  CellKeeper keeper(CellKeeper::Book{kCell});
  keeper.receive(announcement(4, 1, 10, true), kKeeps);
  keeper.receive(announcement(4, 2, 10, false), kKeeps);
  EXPECT_EQ(keeper.roster().entries.at(4).state, Membership::kLeft);
  keeper.receive(announcement(4, 3, 10, true), kKeeps);
  EXPECT_EQ(keeper.roster().entries.at(4).state, Membership::kLeft);
  keeper.receive(announcement(4, 4, 11, true), kKeeps);
  keeper.receive(announcement(4, 5, 10, false), kKeeps);
  EXPECT_EQ(keeper.roster().entries.at(4).state, Membership::kMember);
}

TEST(CellKeeper, WhoIsExpelledLeavesWhatWasRecorded) {
  CellKeeper keeper(CellKeeper::Book{kCell});
  EXPECT_FALSE(keeper.expel(4, kKeeps));
  keeper.receive(announcement(4, 1, 10, true, 2), kKeeps);
  EXPECT_TRUE(keeper.expel(4, kKeeps));
  EXPECT_FALSE(keeper.expel(4, kKeeps));
  keeper.receive(announcement(4, 2, 10, true, 3), kKeeps);  // that wish is dead
  const CellRoster::Entry entry = keeper.roster().entries.at(4);
  EXPECT_EQ(entry.state, Membership::kExpelled);
  ASSERT_TRUE(entry.tombstone);
  EXPECT_EQ(entry.tombstone->pending.seq, 2);
  keeper.receive(announcement(4, 3, 11, true, 3), kKeeps);
  EXPECT_FALSE(keeper.roster().entries.at(4).tombstone);
  EXPECT_EQ(keeper.roster().entries.at(4).recorded_seq, 3);
}

TEST(CellKeeper, WhatIsNotKeptHasNotHappened) {
  CellKeeper keeper(CellKeeper::Book{kCell});
  keeper.receive(announcement(4, 1, 10, true), kFails);
  EXPECT_TRUE(keeper.roster().entries.empty());
  keeper.receive(announcement(4, 1, 10, true), kKeeps);
  const std::int64_t seq = keeper.roster().seq;
  EXPECT_FALSE(keeper.expel(4, kFails));
  keeper.receive(announcement(4, 2, 10, false), kFails);
  EXPECT_EQ(keeper.roster().entries.at(4).state, Membership::kMember);
  EXPECT_EQ(keeper.roster().seq, seq);
  EXPECT_EQ(CellKeeper(keeper.book()).roster().entries.size(), 1u);
}

// A thousand robots pass through a cell: its roster stays short, and whoever has not heard yet that it has left is
// told.
TEST(CellKeeper, TellsOfThoseThatLeftLast) {
  CellKeeper keeper(CellKeeper::Book{kCell});
  for (int id = 0; id < 1000; ++id) {
    keeper.receive(announcement(id, 1, 10, true), kKeeps);
    keeper.receive(announcement(id, 2, 10, false), kKeeps);
  }
  EXPECT_EQ(keeper.roster().entries.size(), 16u);
  EXPECT_FALSE(keeper.roster().entries.contains(0));
  keeper.receive(announcement(0, 3, 10, false), kKeeps);
  EXPECT_EQ(keeper.roster().entries.at(0).state, Membership::kLeft);
}

}  // namespace
}  // namespace swarm::test
