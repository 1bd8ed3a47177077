// A Sogm on the wire: frames XOR-ed with their predecessors (little changes between frames), the words that are
// not zero, one zstd frame, cut into parts that fit one datagram each. Layout: lcmtypes/sogm_t.lcm.
#pragma once

#include <bitset>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/limits.h"
#include "map_daemon/sogm.h"

struct ZSTD_CCtx_s;
struct ZSTD_DCtx_s;

namespace swarm {

// Decompressed size of a map [bytes].
std::int64_t map_bytes(const GridGeometry& geometry, int num_frames);

class SogmEncoder {
 public:
  SogmEncoder();
  ~SogmEncoder();

  // The parts of `sogm` in order, all under `header` (its utime is set to the map's start). The same grid gives the
  // same bytes. Empty when the compressed map exceeds kMaxParts parts. Valid until the next call.
  std::span<const sogm_swarm::sogm_t> encode(const Sogm& sogm, sogm_swarm::header_t header);

  int compressed_bytes() const { return static_cast<int>(packed_size_); }  // of the newest map, sent or not

 private:
  struct Free {
    void operator()(ZSTD_CCtx_s* context) const;
  };
  std::unique_ptr<ZSTD_CCtx_s, Free> context_;
  std::vector<std::uint64_t> content_, zeros_;
  std::vector<std::uint8_t> packed_;
  std::size_t packed_size_ = 0;
  std::vector<sogm_swarm::sogm_t> parts_;
};

enum class AssemblyStatus : std::uint8_t {
  kIncomplete,  // the part was taken; more are missing
  kComplete,    // the map is there
  kRefused,     // see the refusal
};
const char* to_string(AssemblyStatus status);

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
  // content is not one zstd frame with as many words as its bitmap says), kDecode (zstd fails), kValue (bits above the
  // window).
  [[nodiscard]] Assembly add(const sogm_swarm::sogm_t& part, Sogm* out);

 private:
  struct Free {
    void operator()(ZSTD_DCtx_s* context) const;
  };
  Refusal take(const sogm_swarm::sogm_t& part);
  bool complete() const { return have_.count() == static_cast<std::size_t>(layout_.num_parts); }
  Refusal unpack();  // the collected parts into map_

  std::unique_ptr<ZSTD_DCtx_s, Free> context_;
  sogm_swarm::sogm_t layout_{};  // first part taken of the current map, without its data
  bool started_ = false, done_ = false;
  std::bitset<kMaxParts> have_;
  std::vector<std::vector<std::uint8_t>> parts_;
  std::vector<std::uint8_t> packed_;
  std::vector<std::uint64_t> content_;
  Sogm map_;
};

}  // namespace swarm
