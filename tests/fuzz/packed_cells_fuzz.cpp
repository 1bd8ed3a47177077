// Packed messages in cells: what is accepted, packed again, says the same, if it still fits a frame.
#include "lcmtypes/bus/packed_cell_messages.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {
namespace {

template <class Packed>
Packed read(FuzzInput& input) {
  Packed packed{};
  packed.header.utime = static_cast<std::int64_t>(input.word(7) % (std::uint64_t{1} << 53));
  packed.header.boot = static_cast<std::int32_t>(input.word(4) >> 1u);
  const auto rest = input.rest();
  packed.packed.assign(rest.begin(), rest.begin() + std::min<std::ptrdiff_t>(std::ssize(rest), Packed::kMaxBytes));
  packed.num_bytes = static_cast<std::int16_t>(packed.packed.size());
  return packed;
}

// Accepted again, and packed into the same bytes.
template <class Message, class Packed, class Pack>
void try_packed(const Packed& packed, const Pack& pack_again) {
  Message message, same;
  if (unpack(packed, &message) != Refusal::kNone) return;
  const auto again = pack_again(message);
  if (!again) return;
  expect(unpack(*again, &same) == Refusal::kNone, "what is packed is accepted");
  const auto third = pack_again(same);
  expect(third && third->packed == again->packed, "and says the same");
}

}  // namespace

void try_input(FuzzInput input) {
  if (input.byte() % 2 == 0) {
    const auto packed = read<sogm_swarm::cell_announcement_t>(input);
    try_packed<CellAnnouncement>(packed, [](CellAnnouncement& message) { return pack(&message); });
  } else {
    const auto packed = read<sogm_swarm::cell_roster_t>(input);
    try_packed<CellRoster>(packed, [&](CellRoster& roster) { return pack(packed.header, &roster); });
  }
}

}  // namespace swarm::fuzz
