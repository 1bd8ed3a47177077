// Encoding and checked decoding. Whatever arrives is wrong until checked: size, fingerprint, length fields (before the
// generated decoder allocates anything), CRC, schema version, finite values, ranges and cross-field consistency.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "lcmtypes/bus/messages.h"
#include "lcmtypes/bus/time.h"

namespace swarm {

// Why a message was refused; the value is the index in the statuses' `refused` counters.
enum class Refusal : std::uint8_t {
  kNone = 0,      // accepted (never counted)
  kSize,          // shorter than the type's fixed part, longer than its cap, or bytes left over
  kFingerprint,   // not this type
  kLength,        // a length field is negative, above its cap or disagrees with the bytes that are there
  kCrc,           // damaged in transit
  kVersion,       // another schema version
  kRobot,         // from or about a robot that is not expected here
  kValue,         // not finite or out of range
  kInconsistent,  // fields contradict each other
  kTime,          // too old, or from the future by more than the clock limit
  kSequence,      // duplicate or older than what is known
  kDecode,        // the generated decoder failed
};
inline constexpr int kNumRefusals = 12;
const char* to_string(Refusal refusal);

// Counts refusals by reason, for the status messages.
class RefusalCounts {
 public:
  // Stays at the highest number once it is reached.
  void count(Refusal refusal);
  std::int32_t operator[](Refusal refusal) const { return counts_[static_cast<std::size_t>(refusal)]; }
  std::int32_t total() const;
  void copy_to(std::int32_t (&out)[kNumRefusals]) const;

 private:
  std::array<std::int32_t, kNumRefusals> counts_{};
};

// Encodes `message` into `bytes` (resized) and writes its CRC. Instantiated in codec.cpp for every message of
// message_list.h.
template <class T>
void encode(const T& message, std::vector<std::uint8_t>* bytes);

// Decodes and validates. On any refusal `message` is unspecified and must not be used. Never throws, reads outside
// `bytes` or allocates more than the type's cap.
template <class T>
[[nodiscard]] Refusal decode(std::span<const std::uint8_t> bytes, T* message);

// kTime when `utime` is more than `max_age` before or more than `max_ahead` after `now`.
[[nodiscard]] Refusal check_time(Utime utime, Utime now, Duration max_age, Duration max_ahead);

// Lets only newer messages of one sender and channel pass: ordered by (boot, seq).
class SequenceGate {
 public:
  // kSequence when not newer than the newest that passed; otherwise kNone, and the header becomes the newest.
  [[nodiscard]] Refusal pass(const sogm_swarm::header_t& header);
  // Whether pass() would let it.
  bool is_newer(const sogm_swarm::header_t& header) const;

 private:
  std::int32_t boot_ = -1;
  std::int64_t seq_ = -1;
};

}  // namespace swarm
