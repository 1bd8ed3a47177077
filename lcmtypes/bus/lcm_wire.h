// LCM's bytes on UDP multicast, as liblcm 1.3 to 1.5 writes and reads them. A message is one datagram,
//   "LC02", sequence number, channel, NUL, payload,
// or, above 65,499 bytes with its channel, fragments of up to 65,487 bytes each,
//   "LC03", sequence number, payload bytes of the message, offset of these, number of this fragment, how many there
//   are, in the first one channel and NUL, payload.
// Numbers are big-endian, of 4 bytes; the last two of 2 bytes. Whatever arrives is wrong until checked.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace swarm {

inline constexpr std::uint32_t kLcmShortMagic = 0x4c433032, kLcmFragmentMagic = 0x4c433033;
inline constexpr std::size_t kLcmShortHead = 8;                   // bytes before the channel
inline constexpr std::size_t kMaxLcmChannel = 63;                 // characters
inline constexpr std::size_t kMaxLcmMessage = 1 << 20;            // payload bytes that are put together from fragments
inline constexpr std::size_t kMaxDatagram = 65'507;               // bytes that UDP carries
inline constexpr std::size_t kMaxHead = 20 + kMaxLcmChannel + 1;  // bytes before a datagram's payload

struct LcmMessage {
  std::string_view channel;
  std::span<const std::uint8_t> bytes;
};

// Cuts a message into datagrams and hands each to `send` in two parts, head and payload, until it returns false.
// Returns whether all were taken; false as well for a channel of no or too many characters, and for more than
// kMaxLcmMessage bytes.
bool write_lcm(std::uint32_t sequence, const LcmMessage& message,
               const std::function<bool(std::span<const std::uint8_t>, std::span<const std::uint8_t>)>& send);

// From datagrams to messages. Fragments are taken in their order only (they are never sent in another one inside a
// computer), of kMaxSenders at a time, so memory stays below kMaxSenders * kMaxLcmMessage whatever arrives.
class LcmReader {
 public:
  static constexpr std::size_t kMaxSenders = 8;

  // The message that `datagram` is or completes, good until the next call or until `datagram` is changed. `sender`
  // tells apart who sends fragments.
  std::optional<LcmMessage> read(std::uint64_t sender, std::span<const std::uint8_t> datagram);

 private:
  // A message of which fragments are still to come.
  struct Partial {
    std::uint64_t sender = 0;
    std::uint32_t sequence = 0, size = 0;
    std::uint16_t next = 0, fragments = 0;  // of 0 fragments: nobody's
    std::uint64_t age = 0;                  // the lowest is given up for a new one
    std::string channel;
    std::vector<std::uint8_t> bytes;
  };

  std::optional<LcmMessage> read_fragment(std::uint64_t sender, std::span<const std::uint8_t> datagram);
  Partial& place_for(std::uint64_t sender);

  std::array<Partial, kMaxSenders> partials_;
  std::uint64_t begun_ = 0;  // messages of fragments
};

}  // namespace swarm
