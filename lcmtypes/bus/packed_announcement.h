// Announcements as they cross the air, a sixth as large: knots in whole steps (kStepsPerMetre, kStepsPerMps,
// kStepsPerMps2), each predicted from the one before, and the differences in as few bits as they need. Integers only,
// so that all machines read the same. All that an announcement says is in it, and nothing else is needed to read it.
#pragma once

#include <cstdint>
#include <span>

#include "lcmtypes/bus/codec.h"
#include "sogm_swarm/announcement_t.hpp"
#include "sogm_swarm/last_words_t.hpp"
#include "sogm_swarm/packed_announcement_t.hpp"

namespace swarm {

// Of a valid announcement, which becomes what unpack() makes of it: its header's CRC is 0, its radius is rounded up to
// millimetres, knots to whole steps, the last ones at rest, and a stamp without a pending trajectory is left out. What
// a broadcaster announces has its knots so already.
sogm_swarm::packed_announcement_t pack(sogm_swarm::announcement_t* message);

// Of one that passed decode(); `message` is valid. kLength: it breaks off; kSize: bytes are left over; kValue,
// kInconsistent: as of an announcement. On any refusal `message` is unspecified. Bounded: what is longer than a valid
// one ends it.
[[nodiscard]] Refusal unpack(const sogm_swarm::packed_announcement_t& packed, sogm_swarm::announcement_t* message);

// The same from and to bytes. In the header of what is refused by decode() itself nothing may be believed.
void encode_packed(sogm_swarm::announcement_t* message, std::vector<std::uint8_t>* bytes);
[[nodiscard]] Refusal decode_packed(std::span<const std::uint8_t> bytes, sogm_swarm::announcement_t* message);

// An announcement that is repeated, as it was, for a robot that says nothing any more; its header is set apart from
// that of who repeats it. The same refusals.
sogm_swarm::last_words_t last_words_of(sogm_swarm::announcement_t* message);
[[nodiscard]] Refusal unpack(const sogm_swarm::last_words_t& words, sogm_swarm::announcement_t* message);

}  // namespace swarm
