// A Sogm on the wire: what changes from frame to frame, word by word; most of those words are what was guessed from
// their neighbours. Cut into parts that fit one datagram each. Layout: lcmtypes/sogm_t.lcm. As small as zstd's, faster,
// and the same bytes on every machine: no library has a say.
#pragma once

#include <bitset>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/limits.h"
#include "map_daemon/sogm.h"

namespace swarm {

class ChangeMemory;

// Decompressed size of a map [bytes].
std::int64_t map_bytes(const GridGeometry& geometry, int num_frames);

class SogmEncoder {
 public:
  SogmEncoder();
  ~SogmEncoder();

  // The parts of `sogm` in order, all under `header` (its utime is set to the map's start). The same grid gives the
  // same bytes. Empty when the compressed map exceeds kMaxParts parts. Valid until the next call.
  std::span<const sogm_swarm::sogm_t> encode(const Sogm& sogm, sogm_swarm::header_t header);

  // Of the newest map; of one that was not sent: as far as it was compressed.
  int compressed_bytes() const { return static_cast<int>(packed_size_); }

 private:
  bool pack(const Sogm& sogm);

  std::unique_ptr<ChangeMemory> memory_;
  std::vector<std::uint64_t> zeros_;
  std::vector<std::uint8_t> packed_;
  std::size_t packed_size_ = 0;
  std::vector<sogm_swarm::sogm_t> parts_;
};

enum class AssemblyStatus : std::uint8_t {
  kIncomplete,  // the part was taken; more are missing
  kComplete,    // the map is there
  kRefused,     // see the refusal
};

struct Assembly {
  AssemblyStatus status;
  Refusal refusal = Refusal::kNone;
};

// Puts one sender's parts together again: in any order, duplicates welcome, the newest (boot, seq) only.
class SogmAssembler {
 public:
  SogmAssembler();
  ~SogmAssembler();

  // `part` must have passed decode(). A part of a newer map gives up an incomplete older one. On kComplete `*out`
  // becomes the map (its memory is swapped for reuse); otherwise it is untouched. Refused are: kSequence (older, or
  // completed already), kLength (map above kMaxMapBytes), kInconsistent (the parts contradict each other, or the
  // content is not as many changes as it says, all within the map), kValue (bits above the window).
  [[nodiscard]] Assembly add(const sogm_swarm::sogm_t& part, Sogm* out);

 private:
  Refusal take(const sogm_swarm::sogm_t& part);
  bool complete() const { return have_.count() == static_cast<std::size_t>(layout_.num_parts); }
  Refusal unpack();  // the collected parts into map_

  std::unique_ptr<ChangeMemory> memory_;
  sogm_swarm::sogm_t layout_{};  // first part taken of the current map, without its data
  bool started_ = false, done_ = false;
  std::bitset<kMaxParts> have_;
  std::vector<std::vector<std::uint8_t>> parts_;
  std::vector<std::uint8_t> packed_;
  Sogm map_;
};

}  // namespace swarm
