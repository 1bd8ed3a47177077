// CRC-32 of IEEE 802.3 (reflected polynomial 0xEDB88320), as in Ethernet, zip and zlib.
#pragma once

#include <cstdint>
#include <span>

namespace swarm {

// Of "123456789" it is 0xCBF43926. `before`: that of the bytes in front of these, when they come in parts.
std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t before = 0);

}  // namespace swarm
