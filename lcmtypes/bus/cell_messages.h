// What robots in cells and the keepers of cells say to each other (planner_daemon/coordination/cell_protocol.h). Each
// message is the whole state of who sends it, repeated for ever. Packed they travel as cell_announcement_t and
// cell_roster_t, see packed_cell_messages.h.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "sogm_swarm/ack_t.hpp"
#include "sogm_swarm/announcement_t.hpp"

namespace swarm {

// A square of the ground, as high as the space. Of cells with edges of `edge_m` that from x * edge_m to (x + 1) *
// edge_m, likewise y; W.
struct Cell {
  std::int32_t x = 0, y = 0;
  bool operator==(const Cell&) const = default;
  bool operator<(const Cell& other) const { return std::pair(x, y) < std::pair(other.x, other.y); }
};

// What a robot says in each cell that it mentions.
struct CellAnnouncement {
  struct Standing {
    std::int64_t wish = 0;    // number of its newest wish to be a member of the cell
    bool wishes = false;      // false: it has left, by all that it flies or may commit, and that number is over
    std::int64_t epoch = -1;  // of the cell's newest roster that it knows; -1: none
    bool operator==(const Standing&) const = default;
  };
  sogm_swarm::announcement_t robot;       // without acks
  std::map<int, sogm_swarm::ack_t> acks;  // what it says of its peers, by id
  std::map<Cell, Standing> cells;
};

enum class Membership : std::uint8_t { kMember, kExpelled, kLeft };

// What a keeper says in its cell.
struct CellRoster {
  struct Entry {
    Membership state = Membership::kLeft;
    std::int64_t wish = 0;          // its number
    std::int64_t since = 0;         // the first epoch with this entry
    std::int32_t recorded_seq = 0;  // of a member: the pending trajectory that the keeper has recorded; 0: none
    // Of who was expelled: what it may fly by all that was recorded; header, radius, committed, pending.
    std::optional<sogm_swarm::announcement_t> tombstone{};
  };
  Cell cell;
  std::int64_t seq = 0;    // of this roster: grows with each change
  std::int64_t epoch = 0;  // seq of the newest one that changed who is a member
  std::map<int, Entry> entries;
};

}  // namespace swarm
