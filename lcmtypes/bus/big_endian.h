// Numbers as LCM writes them, on the wire and in logs.
#pragma once

#include <cstdint>
#include <span>

namespace swarm {

// Of at most 8 bytes, the highest first.
inline std::uint64_t read_big_endian(std::span<const std::uint8_t> bytes) {
  std::uint64_t value = 0;
  for (const std::uint8_t byte : bytes) value = value << 8 | byte;
  return value;
}

}  // namespace swarm
