// Seals and key files: what opens is what the key's owner would have sealed, to the last bit, and nothing else.
#include <algorithm>
#include <cctype>
#include <stdexcept>

#include "lcmtypes/bus/seal.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {
namespace {

const std::string kKey = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n";
const std::string kOtherKey = "f00102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n";

void check_message(FuzzInput& input) {
  const SwarmKeys keys(kKey), other(kOtherKey), both(kOtherKey + kKey);
  const std::string channel = input.text();
  const auto change = input.part();
  const auto rest = input.rest();
  Bytes bytes(rest.begin(), rest.end());
  const auto is_sealed = [&] {
    const auto message = without_seal(bytes);
    Bytes sealed(message.begin(), message.end());
    keys.seal(channel, &sealed);
    return message.size() < bytes.size() && sealed == bytes;
  };
  expect(keys.opens(channel, bytes) == is_sealed(), "what opens was sealed");
  const Bytes plain = bytes;
  keys.seal(channel, &bytes);
  expect(keys.opens(channel, bytes) && both.opens(channel, bytes), "what was sealed opens");
  expect(!other.opens(channel, bytes) && !SwarmKeys().opens(channel, bytes), "without the key it does not");
  expect(!keys.opens(channel + "X", bytes), "nor on another channel");
  const auto message = without_seal(bytes);
  expect(Bytes(message.begin(), message.end()) == plain, "the message is before its seal");
  // Anything else of the same message does not open: bytes changed, added, cut off.
  const Bytes sealed = bytes;
  for (std::size_t i = 0; i + 2 < change.size(); i += 3) {
    const std::size_t at = (change[i] << 8u | change[i + 1]) % bytes.size();
    bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ change[i + 2]);
  }
  expect(keys.opens(channel, bytes) == (bytes == sealed), "changed it does not open");
  bytes = sealed;
  bytes.pop_back();
  expect(!keys.opens(channel, bytes), "cut short it does not open");
}

void check_key_file(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  bool good = true;
  SwarmKeys keys;
  try {
    keys = SwarmKeys::read(file.path());
  } catch (const std::runtime_error&) {
    good = false;
  }
  expect(good != keys.empty(), "a file that is read has a key");
  if (!good) return;
  const auto digits = std::ranges::count_if(text_of(bytes), [](char c) { return std::isxdigit(c) != 0; });
  expect(digits >= 64, "a key has 64 digits");
  Bytes message{1, 2, 3};
  keys.seal("CHANNEL", &message);
  expect(keys.opens("CHANNEL", message), "its keys seal and open");
}

}  // namespace

void try_input(FuzzInput input) {
  if (input.flag()) {
    swarm::fuzz::check_message(input);
  } else {
    swarm::fuzz::check_key_file(input.rest());
  }
}

}  // namespace swarm::fuzz
