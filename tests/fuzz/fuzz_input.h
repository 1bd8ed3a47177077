// What fuzz targets share: reading values out of an input, saying what does not hold, messages that get past the checks
// of their envelope, and files that live in memory.
#pragma once

#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "lcmtypes/bus/big_endian.h"
#include "lcmtypes/bus/crc32.h"
#include "lcmtypes/bus/messages.h"

namespace swarm::fuzz {

using Bytes = std::vector<std::uint8_t>;

// Ends the program where something does not hold: that is a finding.
inline void expect(bool holds, std::string_view what) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: does not hold: %.*s\n", static_cast<int>(what.size()), what.data());
  std::abort();
}

// Takes values off the front of an input. After its end everything is zero, the lowest or empty.
class FuzzInput {
 public:
  FuzzInput(const std::uint8_t* data, std::size_t size) : left_(data, size) {}

  bool empty() const { return left_.empty(); }

  std::span<const std::uint8_t> take(std::size_t count) {
    const auto taken = left_.first(std::min(count, left_.size()));
    left_ = left_.subspan(taken.size());
    return taken;
  }
  std::span<const std::uint8_t> rest() { return take(left_.size()); }
  // With its length before it.
  std::span<const std::uint8_t> part() { return take(word(2)); }
  std::string text() {
    const auto bytes = part();
    return {bytes.begin(), bytes.end()};
  }

  std::uint64_t word(std::size_t bytes) { return read_big_endian(take(bytes)); }
  std::uint8_t byte() { return static_cast<std::uint8_t>(word(1)); }
  bool flag() { return (byte() & 1) != 0; }
  // Within [low, high], of as few bytes as that takes.
  template <class Integer>
  Integer integer(Integer low, Integer high) {
    const auto span = static_cast<std::uint64_t>(high) - static_cast<std::uint64_t>(low);
    const auto bytes = static_cast<std::size_t>(std::bit_width(span) + 7) / 8;
    const std::uint64_t more = span == ~std::uint64_t{0} ? word(bytes) : word(bytes) % (span + 1);
    return static_cast<Integer>(static_cast<std::uint64_t>(low) + more);
  }
  // Within [low, high], both of which are met often.
  double real(double low, double high) { return low + (high - low) * static_cast<double>(word(2)) / 0xFFFF; }
  // Anything at all.
  double any_real() { return std::bit_cast<double>(word(8)); }

 private:
  std::span<const std::uint8_t> left_;
};

// What a target does with an input: each defines it.
void try_input(FuzzInput input);

inline std::string_view text_of(std::span<const std::uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

inline void write_big_endian(std::uint64_t value, std::span<std::uint8_t> to) {
  for (std::size_t i = to.size(); i-- > 0; value >>= 8) to[i] = static_cast<std::uint8_t>(value);
}

// Makes of any bytes a T whose size, fingerprint, count, version and CRC are good: random bytes would hardly ever get
// past these, and the fields behind them would never be looked at.
template <class T>
void mend(Bytes* bytes) {
  constexpr std::size_t kCrc = 8, kVersion = 12, kVersionEnd = 14;
  const auto fixed = static_cast<std::size_t>(T{}.getEncodedSize());
  bytes->resize(std::max(bytes->size(), fixed));
  constexpr auto& array = MessageTraits<T>::kArray;
  if constexpr (std::is_same_v<decltype(array), const NoArray&>) {
    bytes->resize(fixed);
  } else {
    constexpr std::size_t count_bytes = sizeof(T{}.*array.count);
    const std::size_t count = std::min((bytes->size() - fixed) / array.element_bytes, array.max_count);
    bytes->resize(fixed + count * array.element_bytes);
    write_big_endian(count, std::span(*bytes).subspan(fixed - count_bytes, count_bytes));
  }
  const std::span all(*bytes);
  write_big_endian(static_cast<std::uint64_t>(T::getHash()), all.first(kCrc));
  write_big_endian(sogm_swarm::header_t::kSchemaVersion, all.subspan(kVersion, kVersionEnd - kVersion));
  write_big_endian(crc32(all.subspan(kVersion)), all.subspan(kCrc, kVersion - kCrc));
}

// Calls use(T{}) with the message type of this number.
template <class Use>
void with_type(std::size_t number, Use&& use) {
  [&]<class... T>(const std::tuple<T...>*) {
    std::size_t at = 0;
    (void)((at++ == number % sizeof...(T) && (use(T{}), true)) || ...);
  }(static_cast<AllMessages*>(nullptr));
}

// Bytes of a message for a channel: as they are, or mended.
inline Bytes message_bytes(FuzzInput& input, std::string_view channel) {
  const bool mended = input.flag();
  const auto part = input.part();
  Bytes bytes(part.begin(), part.end());
  if (!mended) return bytes;
  [&]<class... T>(const std::tuple<T...>*) {
    (void)((is_carried_by<T>(channel) && (mend<T>(&bytes), true)) || ...);
  }(static_cast<AllMessages*>(nullptr));
  return bytes;
}

// A file of these bytes: it has a path, but is in no directory.
class MemoryFile {
 public:
  explicit MemoryFile(std::span<const std::uint8_t> bytes) : file_(::memfd_create("fuzz", MFD_CLOEXEC)) {
    expect(file_ >= 0 && ::fchmod(file_, 0600) == 0, "a file in memory can be had");
    expect(::write(file_, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()), "and written");
  }
  ~MemoryFile() { ::close(file_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  std::string path() const { return "/proc/self/fd/" + std::to_string(file_); }

 private:
  int file_;
};

}  // namespace swarm::fuzz
