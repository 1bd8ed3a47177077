// Messages in cells as they cross the air. Announcements in them, a robot's own and those that a keeper has recorded,
// are packed as in packed_announcement.h. All that a message says is in it, and nothing else is needed to read it.
#pragma once

#include <optional>

#include "lcmtypes/bus/cell_messages.h"
#include "lcmtypes/bus/codec.h"
#include "sogm_swarm/cell_announcement_t.hpp"
#include "sogm_swarm/cell_roster_t.hpp"

namespace swarm {

// Of valid messages, whose announcements become what unpack() makes of them, as by pack() of packed_announcement.h:
// they say no roster_crc. None: it would not fit, by bytes, acks (kMaxRosterRobots), cells or entries.
std::optional<sogm_swarm::cell_announcement_t> pack(CellAnnouncement* message);
std::optional<sogm_swarm::cell_roster_t> pack(const sogm_swarm::header_t& header, CellRoster* roster);

// Of one that passed decode(). kLength: it breaks off; kSize: bytes are left over; kValue, kInconsistent: it says what
// cannot be, as of an announcement. On any refusal `message` is unspecified. Bounded: what is longer than a valid one
// ends it.
[[nodiscard]] Refusal unpack(const sogm_swarm::cell_announcement_t& packed, CellAnnouncement* message);
[[nodiscard]] Refusal unpack(const sogm_swarm::cell_roster_t& packed, CellRoster* roster);

}  // namespace swarm
