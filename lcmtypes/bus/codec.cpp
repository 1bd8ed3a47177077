#include "lcmtypes/bus/codec.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "lcmtypes/bus/big_endian.h"
#include "lcmtypes/bus/crc32.h"
#include "lcmtypes/bus/validate.h"

namespace swarm {
namespace {

using namespace sogm_swarm;

// On the wire: fingerprint, header.crc32, all other fields, big-endian; the one variable array is last.

constexpr std::size_t kCrcOffset = 8;
constexpr std::size_t kSealedOffset = kCrcOffset + 4;  // the CRC covers what starts here

template <class T>
constexpr auto& kArray = MessageTraits<T>::kArray;
template <class T>
constexpr bool kHasArray = !std::is_same_v<decltype(MessageTraits<T>::kArray), const NoArray>;

// Encoded bytes of a T without array elements.
template <class T>
std::size_t fixed_bytes() {
  static const auto bytes = static_cast<std::size_t>(T{}.getEncodedSize());
  return bytes;
}

// Everything that must hold before the generated decoder may see the bytes.
template <class T>
Refusal check_envelope(std::span<const std::uint8_t> bytes) {
  const std::size_t fixed = fixed_bytes<T>();
  if (bytes.size() < fixed) return Refusal::kSize;
  if (read_big_endian(bytes.first(8)) != static_cast<std::uint64_t>(T::getHash())) return Refusal::kFingerprint;
  const std::size_t extra = bytes.size() - fixed;
  if constexpr (kHasArray<T>) {
    constexpr auto& array = kArray<T>;
    constexpr std::size_t count_bytes = sizeof(T{}.*array.count);
    const std::uint64_t count = read_big_endian(bytes.subspan(fixed - count_bytes, count_bytes));
    if (extra > array.max_count * array.element_bytes) return Refusal::kSize;
    // Read as unsigned, a negative count promises more than there can be.
    if (count * array.element_bytes > extra) return Refusal::kLength;
    if (count * array.element_bytes < extra) return Refusal::kSize;
  } else if (extra > 0) {
    return Refusal::kSize;
  }
  if (read_big_endian(bytes.subspan(kCrcOffset, 4)) != crc32(bytes.subspan(kSealedOffset))) return Refusal::kCrc;
  const auto version = static_cast<std::int16_t>(read_big_endian(bytes.subspan(kSealedOffset, 2)));
  return version == header_t::kSchemaVersion ? Refusal::kNone : Refusal::kVersion;
}

}  // namespace

const char* to_string(Refusal refusal) {
  static constexpr const char* kNames[kNumRefusals] = {"none",         "size",    "fingerprint", "length",
                                                       "crc",          "version", "robot",       "value",
                                                       "inconsistent", "time",    "sequence",    "decode"};
  const auto index = static_cast<std::size_t>(refusal);
  return index < kNumRefusals ? kNames[index] : "unknown";
}

void RefusalCounts::count(Refusal refusal) {
  std::int32_t& counter = counts_[static_cast<std::size_t>(refusal)];
  counter += counter < std::numeric_limits<std::int32_t>::max() ? 1 : 0;
}

std::int32_t RefusalCounts::total() const {
  const auto sum = std::accumulate(counts_.begin() + 1, counts_.end(), std::int64_t{0});
  return static_cast<std::int32_t>(std::min<std::int64_t>(sum, std::numeric_limits<std::int32_t>::max()));
}

void RefusalCounts::copy_to(std::int32_t (&out)[kNumRefusals]) const {
  std::copy(counts_.begin(), counts_.end(), out);
}

template <class T>
void encode(const T& message, std::vector<std::uint8_t>* bytes) {
  if constexpr (kHasArray<T>) {  // the generated encoder would read past the elements
    if (static_cast<std::size_t>(message.*kArray<T>.count) != (message.*kArray<T>.elements).size()) {
      throw std::logic_error(std::string(T::getTypeName()) + ": the count field must equal the number of elements");
    }
  }
  const int size = message.getEncodedSize();
  bytes->resize(static_cast<std::size_t>(size));
  message.encode(bytes->data(), 0, size);
  const std::uint32_t crc = crc32(std::span(*bytes).subspan(kSealedOffset));
  for (std::size_t i = 0; i < 4; ++i) (*bytes)[kCrcOffset + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
}

template <class T>
Refusal decode(std::span<const std::uint8_t> bytes, T* message) {
  try {
    if (const Refusal refusal = check_envelope<T>(bytes); refusal != Refusal::kNone) return refusal;
    const int size = static_cast<int>(bytes.size());
    // Of a message that is used again, the generated decoder keeps the elements where there are none now.
    if constexpr (kHasArray<T>) (message->*kArray<T>.elements).clear();
    if (message->decode(bytes.data(), 0, size) != size) return Refusal::kDecode;
  } catch (const std::exception&) {
    return Refusal::kDecode;
  }
  if (const Refusal refusal = validate(message->header); refusal != Refusal::kNone) return refusal;
  return validate(*message);
}

#define SWARM_INSTANTIATE(type, ...)                             \
  template void encode(const type&, std::vector<std::uint8_t>*); \
  template Refusal decode(std::span<const std::uint8_t>, type*);
SWARM_MESSAGES(SWARM_INSTANTIATE)
#undef SWARM_INSTANTIATE

Refusal check_time(Utime utime, Utime now, Duration max_age, Duration max_ahead) {
  // Any `utime` may come in: the bounds are moved, not `utime`.
  return utime >= now - max_age && utime <= now + max_ahead ? Refusal::kNone : Refusal::kTime;
}

bool SequenceGate::is_newer(const header_t& header) const {
  return header.boot > boot_ || (header.boot == boot_ && header.seq > seq_);
}

Refusal SequenceGate::pass(const header_t& header) {
  if (!is_newer(header)) return Refusal::kSequence;
  boot_ = header.boot;
  seq_ = header.seq;
  return Refusal::kNone;
}

}  // namespace swarm
