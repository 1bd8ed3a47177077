// Seals: who does not have the swarm's key cannot speak on its bus. A sealed message is the message, "SEAL", and a
// keyed BLAKE2b of 16 bytes over channel, NUL and message. LCM's own programs read such messages as ever, for they
// decode what comes first. A seal says that a robot of the swarm wrote this, not which one, and not when: replays are
// told by a message's own (boot, seq, utime).
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace swarm {

inline constexpr std::size_t kSealBytes = 20;

// The message without its seal, if it has one; whether that is a good one is not looked at.
std::span<const std::uint8_t> without_seal(std::span<const std::uint8_t> bytes);

// One key, or two while they are changed: the first seals, either opens. Without any, messages are neither sealed nor
// are seals asked for.
class SwarmKeys {
 public:
  static constexpr std::size_t kKeyBytes = 32, kMaxKeys = 2;

  SwarmKeys() = default;
  // Of a file's text: a key is a line of 64 hexadecimal digits; lines that are empty or begin with # say nothing.
  // Throws std::invalid_argument with the rule, but never what stands there.
  explicit SwarmKeys(std::string_view text);
  // Throws std::runtime_error with path and rule: a regular file of at most 4 kB that others must not read.
  static SwarmKeys read(const std::filesystem::path& file);
  // A new key as a file's text, from the kernel's random numbers.
  static std::string fresh();

  bool empty() const { return keys_.empty(); }
  // Appends the seal.
  void seal(std::string_view channel, std::vector<std::uint8_t>* bytes) const;
  // Whether the message has a seal by one of the keys.
  [[nodiscard]] bool opens(std::string_view channel, std::span<const std::uint8_t> bytes) const;

 private:
  std::vector<std::array<std::uint8_t, kKeyBytes>> keys_;
};

}  // namespace swarm
