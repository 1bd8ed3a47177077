#include "lcmtypes/bus/packed_cell_messages.h"

#include <iterator>
#include <utility>
#include <vector>

#include "lcmtypes/bus/bit_coding.h"
#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/packed_announcement.h"

namespace swarm {

using namespace sogm_swarm;
using namespace bit_coding;

namespace {

constexpr std::int64_t kMostCounted = std::int64_t{1} << 53;  // numbers of rosters and epochs
constexpr std::int32_t kFarthestCell = 1 << 20;               // either way, per axis

// The keys of a map, ascending, each handed to `key` with the one before (null: it is the first), and what belongs to
// it to `value`. Both take or set it.
template <class Bits, class Map, class Key, class Value>
void entries(Bits& bits, int most, Map& map, const Key& key, const Value& value) {
  std::uint64_t count = map.size();
  bits.bits(6, count);
  if (count > static_cast<std::uint64_t>(most)) return bits.refuse();
  if constexpr (Bits::kReads) {
    map.clear();
    for (std::uint64_t i = 0; i < count; ++i) {
      typename Map::key_type next{};
      key(map.empty() ? nullptr : &map.rbegin()->first, next);
      if (!map.empty() && !(map.rbegin()->first < next)) return bits.refuse();
      value(next, map.try_emplace(map.end(), next)->second);
    }
  } else {
    const typename Map::key_type* before = nullptr;
    for (auto& [of, what] : map) {
      typename Map::key_type same = of;
      key(before, same);
      value(of, what);
      before = &of;
    }
  }
}

template <class Bits>
void code_id(Bits& bits, const int* before, int& id) {
  const int expected = before == nullptr ? 0 : *before + 1;
  std::int16_t beyond = static_cast<std::int16_t>(id - expected);
  whole(bits, beyond);
  id = expected + beyond;
  if (id > 32767) bits.refuse(), id = 32767;
}

template <class Bits>
void code_cell(Bits& bits, const Cell* before, Cell& cell) {
  relative(bits, before == nullptr ? 0 : before->x, cell.x);
  relative(bits, before == nullptr ? 0 : before->y, cell.y);
  if (std::max(std::abs(std::int64_t{cell.x}), std::abs(std::int64_t{cell.y})) > kFarthestCell)
    bits.refuse(), cell = {};
}

// Wishes count from the boot of who wishes, 2^32 a boot.
template <class Bits>
void code_wish(Bits& bits, std::int32_t boot, std::int64_t& wish) {
  auto of_boot = static_cast<std::int32_t>(wish >> 32), counted = std::int32_t{};
  counted = static_cast<std::int32_t>(wish & 0x7FFFFFFF);
  relative(bits, boot, of_boot);
  whole(bits, counted);
  if (of_boot < 0) bits.refuse(), of_boot = 0;
  wish = std::int64_t{of_boot} << 32 | counted;
}

template <class Bits>
void code_count(Bits& bits, std::int64_t& count) {
  whole(bits, count);
  if (count > kMostCounted) bits.refuse(), count = 0;
}

// An announcement without acks and roster, apart from its header.
template <class Bits>
void code_announcement(Bits& bits, announcement_t& m) {
  std::vector<std::uint8_t> packed;
  if constexpr (!Bits::kReads) {
    m.roster_crc = 0;
    packed = pack(&m).packed;
  }
  octets(bits, packed);
  if constexpr (Bits::kReads) {
    const packed_announcement_t message{m.header, static_cast<std::int16_t>(packed.size()), std::move(packed)};
    if (unpack(message, &m) != Refusal::kNone || m.roster_crc != 0) bits.refuse();
  }
}

// The announcement's acks are in the order of the ids.
template <class Bits>
void code(Bits& bits, CellAnnouncement& m) {
  const std::int32_t boot = m.robot.header.boot;
  entries(
      bits, cell_announcement_t::kMaxCells, m.cells,
      [&](const Cell* before, Cell& cell) { code_cell(bits, before, cell); },
      [&](const Cell&, CellAnnouncement::Standing& standing) {
        code_wish(bits, boot, standing.wish);
        flag(bits, standing.wishes);
        ++standing.epoch;
        code_count(bits, standing.epoch);
        --standing.epoch;
      });
  m.robot.acks.clear();
  entries(
      bits, kMaxRosterRobots, m.acks, [&](const int* before, int& id) { code_id(bits, before, id); },
      [&](int id, ack_t& ack) {
        if (id == m.robot.header.robot_id) bits.refuse();
        if constexpr (!Bits::kReads) m.robot.acks.push_back(ack);
      });
  m.robot.num_acks = static_cast<std::int16_t>(m.robot.acks.size());
  code_announcement(bits, m.robot);
  if constexpr (Bits::kReads) {
    if (m.robot.acks.size() != m.acks.size()) return bits.refuse();
    for (auto ack = m.robot.acks.begin(); auto& [id, known] : m.acks) known = *ack++;
  }
  m.robot.acks.clear();
  m.robot.num_acks = 0;
}

template <class Bits>
void code_entry(Bits& bits, const header_t& header, std::int64_t seq, int id, CellRoster::Entry& entry) {
  auto state = static_cast<std::uint64_t>(entry.state);
  bits.bits(2, state);
  if (state > static_cast<std::uint64_t>(Membership::kLeft)) bits.refuse(), state = 0;
  entry.state = static_cast<Membership>(state);
  code_wish(bits, header.boot, entry.wish);
  std::int64_t ago = seq - entry.since;
  whole(bits, ago);
  entry.since = seq - ago;
  if (entry.since < 0) bits.refuse(), entry.since = 0;
  if (entry.state == Membership::kMember) whole(bits, entry.recorded_seq);
  if (entry.state != Membership::kExpelled) return;
  if constexpr (Bits::kReads) entry.tombstone.emplace();
  announcement_t& tombstone = *entry.tombstone;
  tombstone.header.schema_version = header.schema_version;
  tombstone.header.robot_id = static_cast<std::int16_t>(id);
  whole(bits, tombstone.header.boot);
  code_count(bits, tombstone.header.seq);
  code_count(bits, tombstone.header.utime);
  code_announcement(bits, tombstone);
  if (!tombstone.acks.empty()) bits.refuse();
}

template <class Bits>
void code(Bits& bits, const header_t& header, CellRoster& m) {
  code_cell(bits, nullptr, m.cell);
  code_count(bits, m.seq);
  code_count(bits, m.epoch);
  if (m.epoch > m.seq) bits.refuse();
  entries(
      bits, cell_roster_t::kMaxEntries, m.entries, [&](const int* before, int& id) { code_id(bits, before, id); },
      [&](int id, CellRoster::Entry& entry) { code_entry(bits, header, m.seq, id, entry); });
}

// None: it is too long.
template <class Packed>
std::optional<Packed> packed_of(const header_t& header, std::vector<std::uint8_t> bytes) {
  if (std::ssize(bytes) > Packed::kMaxBytes) return std::nullopt;
  Packed packed;
  packed.header = header;
  packed.header.crc32 = 0;
  packed.num_bytes = static_cast<std::int16_t>(bytes.size());
  packed.packed = std::move(bytes);
  return packed;
}

}  // namespace

std::optional<cell_announcement_t> pack(CellAnnouncement* message) {
  if (std::ssize(message->cells) > cell_announcement_t::kMaxCells || std::ssize(message->acks) > kMaxRosterRobots)
    return std::nullopt;
  std::vector<std::uint8_t> bytes;
  BitWriter bits(&bytes);
  code(bits, *message);
  bits.finish();
  return packed_of<cell_announcement_t>(message->robot.header, std::move(bytes));
}

std::optional<cell_roster_t> pack(const header_t& header, CellRoster* roster) {
  if (std::ssize(roster->entries) > cell_roster_t::kMaxEntries) return std::nullopt;
  std::vector<std::uint8_t> bytes;
  BitWriter bits(&bytes);
  code(bits, header, *roster);
  bits.finish();
  return packed_of<cell_roster_t>(header, std::move(bytes));
}

Refusal unpack(const cell_announcement_t& packed, CellAnnouncement* message) {
  *message = {};
  message->robot.header = packed.header;
  message->robot.header.crc32 = 0;
  BitReader bits(packed.packed);
  code(bits, *message);
  return bits.finish();
}

Refusal unpack(const cell_roster_t& packed, CellRoster* roster) {
  *roster = {};
  BitReader bits(packed.packed);
  code(bits, packed.header, *roster);
  return bits.finish();
}

}  // namespace swarm
