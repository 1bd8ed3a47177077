// Packed announcements: what is accepted is valid, and packed again says the same, in no more bytes than there may be.
#include "lcmtypes/bus/packed_announcement.h"
#include "lcmtypes/bus/validate.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {

void try_input(FuzzInput input) {
  sogm_swarm::packed_announcement_t packed{};
  packed.header.utime = static_cast<std::int64_t>(input.word(7) % (std::uint64_t{1} << 53));
  packed.header.boot = static_cast<std::int32_t>(input.word(4) >> 1u);
  const auto rest = input.rest();
  packed.packed.assign(rest.begin(), rest.begin() + std::min<std::ptrdiff_t>(std::ssize(rest), kMaxPackedBytes));
  packed.num_bytes = static_cast<std::int16_t>(packed.packed.size());
  sogm_swarm::announcement_t message;
  if (unpack(packed, &message) != Refusal::kNone) return;
  expect(validate(message) == Refusal::kNone, "it is valid");
  sogm_swarm::announcement_t same = message;
  const auto again = pack(&same);
  expect(again.num_bytes <= kMaxPackedBytes, "it fits");
  Bytes before, after;
  encode(message, &before);
  encode(same, &after);
  expect(before == after, "packing changes nothing");
  expect(unpack(again, &same) == Refusal::kNone, "what is packed is accepted");
  encode(same, &after);
  expect(before == after, "and says the same");
}

}  // namespace swarm::fuzz
