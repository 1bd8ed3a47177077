// Sequences of bits in which packed messages say their fields, the highest bit of a byte first. Each field is said once
// for both ways: a function that is handed a BitWriter takes its value, with a BitReader it sets it.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "lcmtypes/bus/codec.h"

namespace swarm::bit_coding {

inline constexpr std::uint64_t kMostZeros = 24;  // in front of a Rice code

inline std::uint64_t zigzag(std::int64_t value) {
  return static_cast<std::uint64_t>(value) << 1u ^ static_cast<std::uint64_t>(value >> 63);
}
inline std::int64_t unzigzag(std::uint64_t value) {
  return static_cast<std::int64_t>(value >> 1u) ^ -static_cast<std::int64_t>(value & 1u);
}

class BitWriter {
 public:
  static constexpr bool kReads = false;

  explicit BitWriter(std::vector<std::uint8_t>* bytes) : bytes_(bytes) { bytes_->clear(); }

  // The lowest `count` <= 32 bits.
  void bits(int count, std::uint64_t& value) {
    window_ = window_ << static_cast<unsigned>(count) | value;
    for (pending_ += count; pending_ >= 8; pending_ -= 8)
      bytes_->push_back(static_cast<std::uint8_t>(window_ >> static_cast<unsigned>(pending_ - 8)));
  }
  // Below 2^63: how many bits, in six, then all but the first one.
  void number(std::uint64_t& value) {
    auto width = static_cast<std::uint64_t>(std::bit_width(value));
    bits(6, width);
    const int low = std::max(static_cast<int>(width) - 1, 0);
    std::uint64_t upper = low > 32 ? value >> 32u & ((std::uint64_t{1} << static_cast<unsigned>(low - 32)) - 1) : 0;
    std::uint64_t lower = value & ((std::uint64_t{1} << static_cast<unsigned>(std::min(low, 32))) - 1);
    if (low > 32) bits(low - 32, upper);
    bits(std::min(low, 32), lower);
  }
  // The quotient by 2^k, at most kMostZeros, as so many zeros and a one; then the k bits of the rest.
  void rice(int k, std::uint64_t& value) {
    const auto shift = static_cast<unsigned>(k);
    std::uint64_t one = 1, rest = value & ((std::uint64_t{1} << shift) - 1);
    bits(static_cast<int>(value >> shift) + 1, one);
    bits(k, rest);
  }
  void refuse() {}
  void finish() {
    std::uint64_t none = 0;
    if (pending_ > 0) bits(8 - pending_, none);
  }

 private:
  std::vector<std::uint8_t>* bytes_;
  std::uint64_t window_ = 0;
  int pending_ = 0;  // bits
};

// Beyond the end it reads zeros.
class BitReader {
 public:
  static constexpr bool kReads = true;

  explicit BitReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  void bits(int count, std::uint64_t& value) {
    if (held_ < count) fill();
    value = count == 0 ? 0 : window_ >> static_cast<unsigned>(64 - count);
    drop(count);
  }
  void number(std::uint64_t& value) {
    std::uint64_t width = 0, upper = 0, lower = 0;
    bits(6, width);
    const int low = std::max(static_cast<int>(width) - 1, 0);
    if (low > 32) bits(low - 32, upper);
    bits(std::min(low, 32), lower);
    value = width == 0 ? 0 : std::uint64_t{1} << static_cast<unsigned>(low) | upper << 32u | lower;
  }
  void rice(int k, std::uint64_t& value) {
    if (held_ < 32) fill();
    const int zeros = std::min(std::countl_zero(window_), 32);
    if (zeros > static_cast<int>(kMostZeros)) return value = 0, refuse();
    drop(zeros + 1);
    bits(k, value);
    value |= static_cast<std::uint64_t>(zeros) << static_cast<unsigned>(k);
  }
  void refuse() { refused_ = true; }
  Refusal finish() const {
    const std::ptrdiff_t left = 8 * (std::ssize(bytes_) - static_cast<std::ptrdiff_t>(next_)) + held_;
    if (left < 0) return Refusal::kLength;
    if (refused_) return Refusal::kValue;
    if (left >= 8) return Refusal::kSize;
    return window_ == 0 ? Refusal::kNone : Refusal::kValue;
  }

 private:
  void fill() {
    for (; held_ <= 56; held_ += 8, ++next_) {
      const std::uint64_t byte = next_ < bytes_.size() ? bytes_[next_] : 0;
      window_ |= byte << static_cast<unsigned>(56 - held_);
    }
  }
  void drop(int count) {
    window_ <<= static_cast<unsigned>(count);
    held_ -= count;
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t next_ = 0;
  std::uint64_t window_ = 0;  // what comes next, from its highest bit on
  int held_ = 0;              // bits of it
  bool refused_ = false;
};

template <class Bits>
void flag(Bits& bits, bool& value) {
  std::uint64_t bit = value ? 1 : 0;
  bits.bits(1, bit);
  value = bit != 0;
}

// Not negative.
template <class Bits, class Int>
void whole(Bits& bits, Int& value) {
  auto number = static_cast<std::uint64_t>(value);
  bits.number(number);
  if (number > static_cast<std::uint64_t>(std::numeric_limits<Int>::max())) return value = 0, bits.refuse();
  value = static_cast<Int>(number);
}

template <class Bits, class Int>
void set_checked(Bits& bits, std::int64_t number, Int& value) {
  if (number < std::numeric_limits<Int>::min() || number > std::numeric_limits<Int>::max()) bits.refuse(), number = 0;
  value = static_cast<Int>(number);
}

// By its difference.
template <class Bits, class Int>
void relative(Bits& bits, std::int64_t to, Int& value) {
  std::uint64_t difference = zigzag(value - to);
  bits.number(difference);
  set_checked(bits, to + unzigzag(difference), value);
}

// Fewer than 2048: how many, in eleven bits, then each.
template <class Bits>
void octets(Bits& bits, std::vector<std::uint8_t>& bytes) {
  std::uint64_t count = bytes.size();
  bits.bits(11, count);
  bytes.resize(count);
  for (std::uint8_t& byte : bytes) {
    std::uint64_t value = byte;
    bits.bits(8, value);
    byte = static_cast<std::uint8_t>(value);
  }
}

}  // namespace swarm::bit_coding
