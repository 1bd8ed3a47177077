// Messages in cells: what is packed comes back to the last bit; what else arrives is refused, and what would not fit a
// frame is not packed.
#include "lcmtypes/bus/packed_cell_messages.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/messages.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "tests/support/random_messages.h"

namespace swarm {
namespace {

using namespace random_messages;
using Bytes = std::vector<std::uint8_t>;

// As it is once packed, without acks.
announcement_t make_announcement(Random& random) {
  auto message = make<announcement_t>(random, 0);
  message.roster_crc = 0;
  (void)pack(&message);
  return message;
}

CellAnnouncement make_announcement(Random& random, int peers, int cells) {
  CellAnnouncement message{make_announcement(random), {}, {}};
  message.robot.header.crc32 = 0;
  while (std::ssize(message.acks) < peers) {
    ack_t ack{integer(random, 0, 1 << 30), 0, ack_t::kNone};
    if (integer(random, 0, 1) == 1) ack = {ack.peer_boot, integer(random, 1, 1 << 30), ack_t::kNack};
    message.acks[integer(random, 0, 999)] = ack;
  }
  while (std::ssize(message.cells) < cells) {
    const std::int64_t wish = (std::int64_t{message.robot.header.boot} << 32) + integer(random, 1, 1 << 20);
    message.cells[{integer(random, -99, 99), integer(random, -99, 99)}] = {wish, integer(random, 0, 1) == 1,
                                                                           integer(random, -1, 1 << 30)};
  }
  return message;
}

CellRoster make_roster(Random& random, int members, int expelled) {
  CellRoster roster{{integer(random, -99, 99), integer(random, -99, 99)}, 1 << 20, (1 << 20) - 7, {}};
  while (std::ssize(roster.entries) < members + expelled) {
    const int id = integer(random, 0, 32767);
    if (roster.entries.contains(id)) continue;
    const bool is_member = std::ssize(roster.entries) < members;
    CellRoster::Entry& entry = roster.entries[id];
    entry = {is_member ? Membership::kMember : Membership::kExpelled, std::int64_t{id} << 32 | 5,
             integer(random, 1, 1 << 20)};
    if (is_member) {
      entry.recorded_seq = integer(random, 0, 1 << 30);
      continue;
    }
    entry.tombstone = make_announcement(random);
    entry.tombstone->header.robot_id = static_cast<std::int16_t>(id);
    entry.tombstone->header.crc32 = 0;
  }
  return roster;
}

Bytes wire_of(const announcement_t& message) {
  Bytes bytes;
  encode(message, &bytes);
  return bytes;
}
bool same(const ack_t& a, const ack_t& b) {
  return a.peer_boot == b.peer_boot && a.judged_seq == b.judged_seq && a.verdict == b.verdict;
}
bool same(const CellAnnouncement& a, const CellAnnouncement& b) {
  const auto same_acks = [](const auto& x, const auto& y) { return x.first == y.first && same(x.second, y.second); };
  return wire_of(a.robot) == wire_of(b.robot) && a.cells == b.cells && std::ranges::equal(a.acks, b.acks, same_acks);
}
bool same(const CellRoster& a, const CellRoster& b) {
  const auto same_entries = [](const auto& x, const auto& y) {
    const CellRoster::Entry &e = x.second, &f = y.second;
    return x.first == y.first && e.state == f.state && e.wish == f.wish && e.since == f.since &&
           e.recorded_seq == f.recorded_seq && e.tombstone.has_value() == f.tombstone.has_value() &&
           (!e.tombstone || wire_of(*e.tombstone) == wire_of(*f.tombstone));
  };
  return a.cell == b.cell && a.seq == b.seq && a.epoch == b.epoch &&
         std::ranges::equal(a.entries, b.entries, same_entries);
}

TEST(PackedCellAnnouncement, ComesBack) {
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    CellAnnouncement message = make_announcement(random, integer(random, 0, 20), integer(random, 0, 9));
    const auto packed = pack(&message);
    ASSERT_TRUE(packed) << i;
    CellAnnouncement again;
    ASSERT_EQ(unpack(*packed, &again), Refusal::kNone) << i;
    EXPECT_TRUE(same(message, again)) << i;
  }
}

TEST(PackedCellRoster, ComesBack) {
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    CellRoster roster = make_roster(random, integer(random, 0, 20), integer(random, 0, 1));
    const header_t header = make_header(random);
    const auto packed = pack(header, &roster);
    ASSERT_TRUE(packed) << i;
    CellRoster again;
    ASSERT_EQ(unpack(*packed, &again), Refusal::kNone) << i;
    EXPECT_TRUE(same(roster, again)) << i;
  }
}

TEST(PackedCellMessages, AreNotPackedBeyondAFrame) {
  Random random(2);
  CellAnnouncement message = make_announcement(random, kMaxRosterRobots + 1, 1);
  EXPECT_FALSE(pack(&message));
  message = make_announcement(random, 1, cell_announcement_t::kMaxCells + 1);
  EXPECT_FALSE(pack(&message));
  message = make_announcement(random, kMaxRosterRobots, cell_announcement_t::kMaxCells);
  EXPECT_FALSE(pack(&message));
  CellRoster roster = make_roster(random, cell_roster_t::kMaxEntries + 1, 0);
  EXPECT_FALSE(pack(make_header(random), &roster));
  roster = make_roster(random, 0, 10);
  EXPECT_FALSE(pack(make_header(random), &roster));
}

// Whatever else is read is valid, and packed again comes back.
template <class Packed, class Message, class Again>
void spoil(const Packed& good, const Again& pack_again) {
  Random random(3);
  int accepted = 0;
  for (std::size_t length = 0; length < good.packed.size(); ++length) {
    Packed broken = good;
    broken.packed.resize(length);
    Message message;
    EXPECT_NE(unpack(broken, &message), Refusal::kNone) << length;
  }
  for (int i = 0; i < 20'000; ++i) {
    Packed spoilt = good;
    for (int flips = integer(random, 1, 3); flips > 0; --flips) {
      const int bit = integer(random, 0, 8 * static_cast<int>(spoilt.packed.size()) - 1);
      spoilt.packed[static_cast<std::size_t>(bit / 8)] ^= static_cast<std::uint8_t>(1 << bit % 8);
    }
    Message message, again;
    if (unpack(spoilt, &message) != Refusal::kNone) continue;
    ++accepted;
    const auto packed = pack_again(message);
    if (!packed) continue;  // numbers that need more bits
    ASSERT_EQ(unpack(*packed, &again), Refusal::kNone);
    EXPECT_TRUE(same(message, again));
  }
  EXPECT_GT(accepted, 0);
}

TEST(PackedCellMessages, AreRefusedOrSayWhatTheySay) {
  Random random(4);
  CellAnnouncement message = make_announcement(random, 3, 2);
  spoil<cell_announcement_t, CellAnnouncement>(*pack(&message), [](CellAnnouncement& m) { return pack(&m); });
  CellRoster roster = make_roster(random, 3, 1);
  const header_t header = make_header(random);
  spoil<cell_roster_t, CellRoster>(*pack(header, &roster), [&](CellRoster& m) { return pack(header, &m); });
}

TEST(PackedCellAnnouncement, AnswersNobodyTwiceNorItself) {
  Random random(5);
  CellAnnouncement message = make_announcement(random, 1, 1);
  message.acks = {{message.robot.header.robot_id, {5, 0, ack_t::kNone}}};
  const auto packed = pack(&message);
  ASSERT_TRUE(packed);
  CellAnnouncement again;
  EXPECT_EQ(unpack(*packed, &again), Refusal::kValue);
}

TEST(Channels, OfCellsAreOfAKind) {
  EXPECT_EQ(kind_of("CELL_ROSTER_at_m3_12"), "CELL_ROSTER");
  EXPECT_EQ(kind_of("GOAL"), "GOAL");
  EXPECT_TRUE(is_carried_by<cell_roster_t>("CELL_ROSTER_at_m3_12"));
  EXPECT_FALSE(is_carried_by<cell_roster_t>("CELL_ANNOUNCEMENT_at_m3_12"));
}

}  // namespace
}  // namespace swarm
