// The keepers' node: what it says of what it hears, when, and what it knows after a crash.
#include "planner_daemon/coordination/keeper_node.h"

#include <gtest/gtest.h>

#include "lcmtypes/bus/cell_channels.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

constexpr Cell kHere{1, 0}, kThere{-1, 0}, kAbroad{99, 0};
constexpr std::int64_t kWish = (std::int64_t{5} << 32) + 1;

class Keepers : public Bench<KeeperNode> {
 public:
  explicit Keepers(MemoryBookStore& books, std::int32_t boot = 1, double listen_s = 0.0)
      : Bench(make_config(listen_s), books, boot) {}
  static KeeperConfig make_config(double listen_s) {
    KeeperConfig config;
    config.listen_s = listen_s;
    return config;
  }

  // An empty roster of another one, `age` ago.
  void hear_keeper(int id, std::int32_t boot, Duration age = 0us, std::int64_t roster_seq = 0) {
    CellRoster roster{kHere, 7, 7, {}};
    const auto packed = pack(make_header(id, boot, roster_seq, now - age), &roster);
    ASSERT_TRUE(packed);
    Bytes bytes;
    encode(*packed, &bytes);
    deliver(BusId::kSwarm, channel_of(channel::kCellRoster, kHere), bytes);
  }

  void hear(int id, std::vector<Cell> cells, bool wishes = true, std::int64_t wish = kWish) {
    CellAnnouncement message{};
    message.robot.header = make_header(id, 5, ++seq, now);
    message.robot.radius = 0.2f;
    message.robot.committed = Trajectory::hover(1, kStart, {1, 2, 1}).to_wire();
    message.robot.least_delay_us = sogm_swarm::announcement_t::kUnknown;
    for (const Cell& cell : cells) message.cells[cell] = {wish, wishes};
    const auto packed = pack(&message);
    ASSERT_TRUE(packed);
    Bytes bytes;
    encode(*packed, &bytes);
    deliver(BusId::kSwarm, channel_of(channel::kCellAnnouncement, cells.front()), bytes);
  }
  std::vector<CellRoster> rosters(const Cell& cell) {
    std::vector<CellRoster> rosters;
    for (const Mailbox::Letter& letter : out.letters) {
      if (letter.channel != channel_of(channel::kCellRoster, cell)) continue;
      sogm_swarm::cell_roster_t packed;
      EXPECT_EQ(decode(letter.bytes, &packed), Refusal::kNone);
      EXPECT_EQ(unpack(packed, &rosters.emplace_back()), Refusal::kNone);
      EXPECT_EQ(rosters.back().cell, cell);
    }
    return rosters;
  }

  std::int64_t seq = 0;  // of the newest announcement
};

TEST(KeeperNode, SaysWhoIsAMemberAtOnceAndAsLongAsAnybodySpeaks) {
  MemoryBookStore books;
  Keepers keepers(books);
  keepers.run_for(1.0);
  EXPECT_TRUE(keepers.out.letters.empty());
  keepers.hear(3, {kHere, kThere});
  keepers.run_for(0.006);
  for (const Cell& cell : {kHere, kThere}) {  // by one copy of the announcement
    const auto rosters = keepers.rosters(cell);
    ASSERT_EQ(rosters.size(), 1u);
    ASSERT_TRUE(rosters[0].entries.contains(3));
    EXPECT_EQ(rosters[0].entries.at(3).state, Membership::kMember);
    EXPECT_EQ(rosters[0].entries.at(3).wish, kWish);
  }
  keepers.run_for(0.5);
  EXPECT_NEAR(static_cast<double>(keepers.rosters(kHere).size()), 11, 1);
  keepers.run_for(3.0);
  const auto all = keepers.rosters(kHere);
  EXPECT_EQ(all.back().entries.at(3).state, Membership::kExpelled);  // it fell silent
  ASSERT_TRUE(all.back().entries.at(3).tombstone);
  EXPECT_EQ(all.back().entries.at(3).tombstone->committed.knots[0][1], 2.0f);
  keepers.out.letters.clear();
  keepers.run_for(5.0);
  EXPECT_TRUE(keepers.out.letters.empty());
}

TEST(KeeperNode, KnowsAfterACrashWhatItHasSaid) {
  MemoryBookStore books;
  std::int64_t seq = 0;
  {
    Keepers keepers(books);
    keepers.hear(3, {kHere});
    keepers.hear(4, {kHere});
    keepers.run_for(0.1);
    seq = keepers.rosters(kHere).back().seq;
  }
  Keepers keepers(books, 2);
  keepers.seq = 2;
  keepers.hear(4, {kHere}, false);
  keepers.run_for(0.1);
  const CellRoster roster = keepers.rosters(kHere).back();
  EXPECT_EQ(roster.seq, seq + 1);
  EXPECT_EQ(roster.entries.at(3).state, Membership::kMember);
  EXPECT_EQ(roster.entries.at(4).state, Membership::kLeft);
}

TEST(KeeperNode, IsChangedByNothingElse) {
  MemoryBookStore books;
  Keepers keepers(books);
  keepers.hear(3, {kAbroad});
  keepers.deliver(BusId::kSwarm, channel_of(channel::kCellAnnouncement, kHere), Bytes{1, 2, 3});
  EXPECT_EQ(keepers.node.refused().total(), 1);
  keepers.now += 10s;
  Bench<KeeperNode>& bench = keepers;
  CellAnnouncement late{};  // recorded, and played again
  late.robot.header = make_header(3, 5, 100, keepers.now - 5s);
  late.robot.radius = 0.2f;
  late.robot.committed = Trajectory::hover(1, kStart, {1, 2, 1}).to_wire();
  late.cells[kHere] = {kWish, true};
  const auto packed = pack(&late);
  Bytes bytes;
  encode(*packed, &bytes);
  bench.deliver(BusId::kSwarm, channel_of(channel::kCellAnnouncement, kHere), bytes);
  EXPECT_EQ(keepers.node.refused()[Refusal::kTime], 1);
  keepers.run_for(1.0);
  EXPECT_TRUE(keepers.out.letters.empty());
  EXPECT_TRUE(books.load().empty());
}

// Of two that keep the same cell the later one leaves it to the other, and both say so.
TEST(KeeperNode, GivesWayToOneThatBeganEarlier) {
  struct Case {
    int id;
    std::int32_t boot;
    bool gives_way;
  };
  for (const Case& other : {Case{9, 4, true}, Case{9, 6, false}, Case{9, 5, false}, Case{0, 5, true}}) {
    SCOPED_TRACE(testing::Message() << other.id << ", " << other.boot);
    MemoryBookStore books;
    Keepers keepers(books, 5);
    keepers.hear(3, {kHere});
    keepers.run_for(0.1);
    EXPECT_FALSE(keepers.rosters(kHere).empty());
    keepers.hear_keeper(other.id, other.boot, 0us, 1000);
    keepers.out.letters.clear();
    const std::int64_t seq = books.load().front().seq;
    keepers.hear(4, {kHere, kThere});
    keepers.run_for(0.1);
    EXPECT_EQ(keepers.out.letters.empty(), other.gives_way);
    EXPECT_EQ(books.load().front().seq == seq && books.load().size() == 1, other.gives_way) << "nothing is recorded";
    EXPECT_TRUE(keepers.node.activity(keepers.now).waits);
    keepers.run_for(5.0);  // the other one is gone: what it recorded is not known
    keepers.out.letters.clear();
    keepers.hear(5, {kHere});
    keepers.run_for(0.1);
    EXPECT_EQ(keepers.out.letters.empty(), other.gives_way);
    EXPECT_EQ(keepers.node.activity(keepers.now).waits, other.gives_way);
  }
}

TEST(KeeperNode, IsNotTakenForAnotherOne) {
  MemoryBookStore books;
  Keepers keepers(books, 5);
  keepers.run_for(0.1);
  keepers.hear(3, {kHere});
  keepers.run_for(0.1);
  const std::vector<Mailbox::Letter> said = keepers.out.letters;
  for (const Mailbox::Letter& letter : said) keepers.deliver(letter.bus, letter.channel, letter.bytes);
  keepers.hear_keeper(0, 4, 300ms);  // what an earlier start has said
  EXPECT_FALSE(keepers.node.activity(keepers.now).waits);
  keepers.out.letters.clear();
  keepers.run_for(0.1);
  EXPECT_FALSE(keepers.out.letters.empty());
}

TEST(KeeperNode, ListensFirst) {
  MemoryBookStore books;
  Keepers keepers(books, 5, 0.5);
  keepers.hear(3, {kHere});
  keepers.run_for(0.4);
  keepers.hear(3, {kHere});
  keepers.run_for(0.05);
  EXPECT_TRUE(keepers.out.letters.empty());
  EXPECT_TRUE(books.load().empty());
  keepers.run_for(0.1);
  keepers.hear(3, {kHere});
  keepers.run_for(0.01);
  EXPECT_EQ(keepers.rosters(kHere).size(), 1u);
}

// Whoever would no longer fit its roster's frame waits.
TEST(KeeperNode, TakesNoMoreMembersThanItsRosterHolds) {
  MemoryBookStore books;
  Keepers keepers(books);
  for (int id = 0; id < 200; ++id) keepers.hear(100 * id, {kHere});
  keepers.run_for(0.01);
  const std::size_t members = keepers.rosters(kHere).back().entries.size();
  EXPECT_GE(members, 30u);
  EXPECT_LE(members, 60u);
  EXPECT_EQ(keepers.node.passed_over(), 200 - static_cast<std::int64_t>(members));
  keepers.hear(0, {kHere}, false);
  keepers.run_for(0.01);
  EXPECT_EQ(keepers.rosters(kHere).back().entries.at(0).state, Membership::kLeft);
}

TEST(KeeperNode, ListensInAllItsCellsAndRefusesBadGround) {
  MemoryBookStore books;
  KeeperConfig config;
  EXPECT_EQ(KeeperNode(config, books, 1).subscriptions().size(), 16u + 9u * 9u);  // -16 to 16 m: keepers and robots
  config.space_max.x() = config.space_min.x();
  EXPECT_THROW(KeeperNode(config, books, 1), OptionError);
  config.space_max.x() = 1e6;
  EXPECT_THROW(KeeperNode(config, books, 1), OptionError);
  config = KeeperConfig();
  config.cell_m = 0.0;
  EXPECT_THROW(KeeperNode(config, books, 1), OptionError);
}

}  // namespace
}  // namespace swarm::test
