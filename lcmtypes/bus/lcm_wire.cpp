#include "lcmtypes/bus/lcm_wire.h"

#include <algorithm>

#include "lcmtypes/bus/big_endian.h"

namespace swarm {
namespace {

constexpr std::size_t kFragmentHeader = 20;
constexpr std::size_t kMaxShort = 65'499;     // channel, NUL and payload of a message that is not cut: liblcm's bound
constexpr std::size_t kMaxFragment = 65'487;  // the same of a fragment

using Bytes = std::span<const std::uint8_t>;

// The head of a datagram as it grows.
class Head {
 public:
  void put(std::uint32_t value, int bytes) {
    for (int i = bytes - 1; i >= 0; --i) head_[size_++] = static_cast<std::uint8_t>(value >> (8 * i));
  }
  void put(std::string_view channel) {
    for (const char letter : channel) head_[size_++] = static_cast<std::uint8_t>(letter);
    head_[size_++] = 0;
  }
  Bytes bytes() const { return Bytes(head_).first(size_); }

 private:
  std::array<std::uint8_t, kMaxHead> head_{};
  std::size_t size_ = 0;
};

std::uint32_t read(Bytes bytes, std::size_t at, std::size_t count) {
  return static_cast<std::uint32_t>(read_big_endian(bytes.subspan(at, count)));
}

// Cuts the channel and its NUL off `*bytes`. Empty when there is none of allowed length.
std::string_view cut_channel(Bytes* bytes) {
  const auto within = bytes->first(std::min(bytes->size(), kMaxLcmChannel + 1));
  const auto end = std::find(within.begin(), within.end(), std::uint8_t{0});
  if (end == within.end()) return {};
  const auto length = static_cast<std::size_t>(end - within.begin());
  const std::string_view channel(reinterpret_cast<const char*>(bytes->data()), length);
  *bytes = bytes->subspan(length + 1);
  return channel;
}

}  // namespace

bool write_lcm(std::uint32_t sequence, const LcmMessage& message, const std::function<bool(Bytes, Bytes)>& send) {
  const auto [channel, bytes] = message;
  if (channel.empty() || channel.size() > kMaxLcmChannel || bytes.size() > kMaxLcmMessage) return false;
  const std::size_t total = channel.size() + 1 + bytes.size();
  if (total <= kMaxShort) {
    Head head;
    head.put(kLcmShortMagic, 4);
    head.put(sequence, 4);
    head.put(channel);
    return send(head.bytes(), bytes);
  }
  const std::size_t fragments = (total + kMaxFragment - 1) / kMaxFragment;
  for (std::size_t number = 0, offset = 0; number < fragments; ++number) {
    const std::size_t room = kMaxFragment - (number == 0 ? channel.size() + 1 : 0);
    const Bytes part = bytes.subspan(offset, std::min(room, bytes.size() - offset));
    Head head;
    head.put(kLcmFragmentMagic, 4);
    head.put(sequence, 4);
    head.put(static_cast<std::uint32_t>(bytes.size()), 4);
    head.put(static_cast<std::uint32_t>(offset), 4);
    head.put(static_cast<std::uint32_t>(number), 2);
    head.put(static_cast<std::uint32_t>(fragments), 2);
    if (number == 0) head.put(channel);
    if (!send(head.bytes(), part)) return false;
    offset += part.size();
  }
  return true;
}

std::optional<LcmMessage> LcmReader::read(std::uint64_t sender, Bytes datagram) {
  if (datagram.size() < kLcmShortHead) return std::nullopt;
  const std::uint32_t magic = swarm::read(datagram, 0, 4);
  if (magic == kLcmFragmentMagic) return read_fragment(sender, datagram);
  if (magic != kLcmShortMagic) return std::nullopt;
  LcmMessage message{{}, datagram.subspan(kLcmShortHead)};
  message.channel = cut_channel(&message.bytes);
  return message.channel.empty() ? std::nullopt : std::optional(message);
}

std::optional<LcmMessage> LcmReader::read_fragment(std::uint64_t sender, Bytes datagram) {
  if (datagram.size() < kFragmentHeader) return std::nullopt;
  const std::uint32_t sequence = swarm::read(datagram, 4, 4), size = swarm::read(datagram, 8, 4);
  const std::uint32_t offset = swarm::read(datagram, 12, 4);
  const auto number = static_cast<std::uint16_t>(swarm::read(datagram, 16, 2));
  const auto fragments = static_cast<std::uint16_t>(swarm::read(datagram, 18, 2));
  Bytes part = datagram.subspan(kFragmentHeader);
  Partial& partial = place_for(sender);
  if (number == 0) {
    const std::string_view channel = cut_channel(&part);
    if (channel.empty() || size > kMaxLcmMessage || fragments == 0 || fragments > size + 1) return std::nullopt;
    partial.sender = sender;
    partial.sequence = sequence;
    partial.size = size;
    partial.next = 0;
    partial.fragments = fragments;
    partial.age = ++begun_;
    partial.channel = channel;
    partial.bytes.clear();
  } else if (partial.fragments == 0 || partial.sender != sender || partial.sequence != sequence ||
             number < partial.next) {
    return std::nullopt;  // of a message whose beginning was not heard, or heard already
  }
  const bool fits = number == partial.next && fragments == partial.fragments && size == partial.size &&
                    offset == partial.bytes.size() && part.size() <= size - partial.bytes.size();
  if (!fits) {
    partial.fragments = 0;
    return std::nullopt;
  }
  partial.bytes.insert(partial.bytes.end(), part.begin(), part.end());
  if (++partial.next < partial.fragments) return std::nullopt;
  partial.fragments = 0;
  if (partial.bytes.size() != partial.size) return std::nullopt;
  return LcmMessage{partial.channel, partial.bytes};
}

// The sender's own place, else a free one, else the oldest.
LcmReader::Partial& LcmReader::place_for(std::uint64_t sender) {
  const auto own = std::ranges::find_if(
      partials_, [&](const Partial& partial) { return partial.fragments > 0 && partial.sender == sender; });
  if (own != partials_.end()) return *own;
  return *std::ranges::min_element(partials_, {},
                                   [](const Partial& partial) { return partial.fragments > 0 ? partial.age : 0; });
}

}  // namespace swarm
