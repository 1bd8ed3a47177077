// Datagrams from anybody: whole messages, fragments in any order and what is neither. What is put together is within
// its bounds, and a message that is sent as a whole arrives as it was, whatever came before.
#include <algorithm>

#include "lcmtypes/bus/lcm_wire.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {
namespace {

void check(const std::optional<LcmMessage>& message) {
  if (!message) return;
  expect(!message->channel.empty() && message->channel.size() <= kMaxLcmChannel, "the channel has a length");
  expect(message->channel.find('\0') == std::string_view::npos, "the channel ends at its NUL");
  expect(message->bytes.size() <= kMaxLcmMessage, "the message is not too long");
  unsigned sum = 0;  // all of it can be read
  for (const std::uint8_t byte : message->bytes) sum += byte;
  [[maybe_unused]] volatile unsigned kept = sum;
}

Bytes fragment(FuzzInput& input) {
  Bytes bytes(20);
  const std::span head(bytes);
  write_big_endian(kLcmFragmentMagic, head.first(4));
  write_big_endian(input.byte() % 4, head.subspan(4, 4));                                  // sequence number
  write_big_endian(input.flag() ? input.word(4) : input.byte(), head.subspan(8, 4));       // size
  write_big_endian(input.flag() ? input.word(4) : input.byte(), head.subspan(12, 4));      // offset
  write_big_endian(input.flag() ? input.word(2) : input.byte() % 4, head.subspan(16, 2));  // number
  write_big_endian(input.flag() ? input.word(2) : input.byte() % 4, head.subspan(18, 2));  // how many
  const auto payload = input.part();
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  return bytes;
}

void send_whole(FuzzInput& input, std::uint64_t sender, LcmReader* reader) {
  const std::string channel = input.text().substr(0, kMaxLcmChannel + 2);
  const auto size = input.integer<std::size_t>(0, input.byte() % 16 == 0 ? 1 << 18 : 100);
  Bytes payload(size);
  const auto pattern = input.part();
  for (std::size_t i = 0; i < size; i += std::max<std::size_t>(pattern.size(), 1))
    std::ranges::copy(pattern.first(std::min(pattern.size(), size - i)),
                      payload.begin() + static_cast<std::ptrdiff_t>(i));
  const bool fits = !channel.empty() && channel.size() <= kMaxLcmChannel;
  bool arrived = false;
  const bool sent = write_lcm(static_cast<std::uint32_t>(input.word(4)), {channel, payload}, [&](auto head, auto part) {
    expect(!arrived && head.size() <= kMaxHead && head.size() + part.size() <= kMaxDatagram, "datagrams fit UDP");
    Bytes datagram(head.begin(), head.end());
    datagram.insert(datagram.end(), part.begin(), part.end());
    const auto message = reader->read(sender, datagram);
    check(message);
    if (!message) return true;
    arrived = true;
    if (channel.find('\0') == std::string::npos)
      expect(message->channel == channel && std::ranges::equal(message->bytes, payload), "it arrives as it was");
    return true;
  });
  expect(sent == fits, "what fits is sent");
  if (sent && channel.find('\0') == std::string::npos) expect(arrived, "what is sent arrives");
}

}  // namespace

void try_input(FuzzInput input) {
  LcmReader reader;
  while (!input.empty()) {
    const std::uint8_t what = input.byte();
    const std::uint64_t sender = input.byte() % (LcmReader::kMaxSenders + 2);
    if (what % 4 == 0) {
      send_whole(input, sender, &reader);
    } else if (what % 4 == 1) {
      const auto part = input.part();
      check(reader.read(sender, Bytes(part.begin(), part.end())));
    } else {
      const Bytes bytes = fragment(input);
      check(reader.read(sender, bytes));
    }
  }
}

}  // namespace swarm::fuzz
