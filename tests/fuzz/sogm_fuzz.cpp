// Maps on the wire: parts in any order, of several maps, damaged or not. What comes whole is a map, and a map that was
// encoded comes back as it was.
#include <algorithm>

#include "lcmtypes/bus/header_source.h"
#include "map_daemon/sogm_codec.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {
namespace {

using sogm_swarm::sogm_t;

constexpr Utime kNow = to_utime(1'700'000'000'000'000);

void check(const Sogm& map) {
  const GridGeometry& grid = map.geometry;
  expect(map.num_frames >= 1 && map.frame_duration > 0us, "it has frames");
  const std::int64_t words = std::int64_t{map.num_frames} * grid.words_per_frame();
  expect(static_cast<std::int64_t>(map.words().size()) == words && 8 * words <= kMaxMapBytes,
         "its words are all there");
  if (grid.size.z() % 64 == 0) return;
  const std::uint64_t above = ~std::uint64_t{0} << grid.size.z() % 64;
  const auto top = static_cast<std::size_t>(grid.words_per_column());
  for (std::size_t i = top - 1; i < map.words().size(); i += top)
    expect((map.words()[i] & above) == 0, "no bits are above the window");
}

// Small, with runs along z here and there that move from frame to frame, or any words.
Sogm make_map(FuzzInput& input) {
  GridGeometry grid;
  grid.resolution_m = input.real(0.01, 1.0);
  for (int axis = 0; axis < 3; ++axis) {
    grid.size[axis] = input.integer(1, axis == 2 ? 130 : 24);
    grid.origin[axis] = input.flag() ? static_cast<int>(input.integer(-kMaxWorldIndex, kMaxWorldIndex)) : -5;
  }
  Sogm map;
  map.reset(grid, input.integer(1, 12), kNow + Duration(input.byte()), Duration(input.integer(1, 10'000'000)));
  const auto columns = static_cast<std::uint64_t>(grid.size.x()) * static_cast<std::uint64_t>(grid.size.y());
  for (int runs = input.byte() % 32; runs > 0; --runs) {
    const std::uint64_t word = input.flag() ? input.word(8) : input.flag() ? ~std::uint64_t{0} : 0xFF;
    const std::uint64_t at = input.word(2), step = input.byte() % 3;
    for (int frame = 0; frame < map.num_frames; ++frame) {
      const auto column = (at + step * static_cast<std::uint64_t>(frame)) % columns;
      std::uint64_t* words = map.column(frame, static_cast<int>(column / static_cast<std::uint64_t>(grid.size.y())),
                                        static_cast<int>(column % static_cast<std::uint64_t>(grid.size.y())));
      for (int w = 0; w < grid.words_per_column(); ++w) words[w] |= word;
      if (const int rest = grid.size.z() % 64; rest != 0)
        words[grid.words_per_column() - 1] &= ~(~std::uint64_t{0} << rest);
    }
  }
  return map;
}

struct Receiver {
  SogmAssembler assembler;
  SogmEncoder encoder;
  Sogm map;
  bool has_strangers = false;  // parts that may be newer than all that is sent
  bool add(const sogm_t& part) {
    const Sogm before = map;
    const Assembly assembly = assembler.add(part, &map);
    expect((assembly.status == AssemblyStatus::kRefused) == (assembly.refusal != Refusal::kNone),
           "a refusal has a reason");
    if (assembly.status != AssemblyStatus::kComplete) {
      expect(map.words() == before.words() && map.start_utime == before.start_utime,
             "a map is replaced by a whole one only");
      return false;
    }
    check(map);
    expect(map.start_utime == to_utime(part.header.utime), "it is of its time");
    return true;
  }
};

// Encoded, it comes back in any order, with duplicates; with one part damaged it is a map or none.
void send(FuzzInput& input, HeaderSource* headers, Receiver* receiver) {
  const Sogm sent = make_map(input);
  const auto parts = receiver->encoder.encode(sent, headers->next(sent.start_utime));
  if (parts.empty()) return;
  std::vector<sogm_t> order(parts.begin(), parts.end());
  if (input.flag()) std::ranges::reverse(order);
  if (input.flag()) order.insert(order.begin(), order.back());
  if (input.flag()) {
    sogm_t& damaged = order[input.byte() % order.size()];
    damaged.packed[input.word(2) % damaged.packed.size()] = input.byte();
    for (const sogm_t& part : order) receiver->add(part);
    return;
  }
  bool whole = false;
  for (const sogm_t& part : order) {
    Bytes bytes;
    encode(part, &bytes);
    sogm_t decoded;
    expect(decode(bytes, &decoded) == Refusal::kNone, "parts are valid messages");
    whole |= receiver->add(decoded);
  }
  if (receiver->has_strangers) return;
  expect(whole, "it comes whole");
  expect(receiver->map.words() == sent.words() && receiver->map.geometry.size == sent.geometry.size &&
             receiver->map.geometry.origin == sent.geometry.origin && receiver->map.num_frames == sent.num_frames &&
             receiver->map.frame_duration == sent.frame_duration,
         "it is what was sent");
}

// A part whose layout is small and whose content is anything.
void add_made_up(FuzzInput& input, HeaderSource* headers, Receiver* receiver) {
  sogm_t part{};
  part.header = headers->next(kNow);
  receiver->has_strangers |= input.flag();
  if (receiver->has_strangers) part.header.seq = input.byte() % 4;
  part.frame_duration_us = 100'000;
  part.num_frames = input.integer<std::int16_t>(1, 8);
  for (std::int16_t& size : part.size) size = input.integer<std::int16_t>(1, 130);
  part.resolution = 0.1;
  part.num_parts = input.integer<std::int16_t>(1, 4);
  part.part = input.integer<std::int16_t>(0, 3);
  const auto content = input.part();
  part.packed.assign(content.begin(), content.end());
  part.num_bytes = static_cast<std::int32_t>(part.packed.size());
  part.total_bytes = part.num_bytes + input.byte() * (part.num_parts - 1);
  Bytes bytes;
  encode(part, &bytes);
  sogm_t decoded;
  if (decode(bytes, &decoded) == Refusal::kNone) receiver->add(decoded);
}

}  // namespace

void try_input(FuzzInput input) {
  HeaderSource headers(1, 1);
  Receiver receiver;
  while (!input.empty()) {
    switch (input.byte() % 4) {
      case 0:
        send(input, &headers, &receiver);
        break;
      case 1: {
        const Bytes bytes = message_bytes(input, channel::kSogm);
        sogm_t part;
        if (decode(bytes, &part) != Refusal::kNone) break;
        receiver.has_strangers = true;
        receiver.add(part);
        break;
      }
      default:
        add_made_up(input, &headers, &receiver);
    }
  }
}

}  // namespace swarm::fuzz
