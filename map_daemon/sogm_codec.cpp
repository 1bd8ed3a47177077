#include "map_daemon/sogm_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <tuple>
#include <utility>

#include "lcmtypes/bus/wide.h"

namespace swarm {

using sogm_swarm::sogm_t;

// What a changed word will be is guessed from the words around it, as it was after the same ones before; or it is one
// of the newest. Both ends learn the same.
class ChangeMemory {
 public:
  void clear() { by_next_.fill(0), by_previous_.fill(0), newest_.fill(0); }

  // Where a word is guessed.
  struct Guesses {
    std::uint64_t *next, *previous;
  };
  // Of the word in turn and the next one, as they were in the frame before, and the previous one as it is now.
  Guesses look(std::uint64_t before, std::uint64_t next_before, std::uint64_t previous_now) {
    return {&by_next_[slot<kGuessBits>(before, next_before)], &by_previous_[slot<kGuessBits>(before, previous_now)]};
  }
  std::uint64_t& newest(std::size_t index) { return newest_[index]; }
  static std::size_t index_of(std::uint64_t change) { return slot<kNewestBits>(change, 0); }

 private:
  static constexpr int kGuessBits = 12, kNewestBits = 8;

  template <int kBits>
  static std::size_t slot(std::uint64_t a, std::uint64_t b) {
    return ((a * 0x9E3779B97F4A7C15u ^ b * 0xC2B2AE3D27D4EB4Fu) * 0xD6E8FEB86659FD93u) >> (64 - kBits);
  }

  std::array<std::uint64_t, 1 << kGuessBits> by_next_{}, by_previous_{};
  std::array<std::uint64_t, 1 << kNewestBits> newest_{};
};

static_assert(std::endian::native == std::endian::little, "the wire's words are little-endian");

namespace {

// The two highest bits of a token, the others are the number of words before it that have not changed.
enum class Change : std::uint8_t { kNextGuess, kPreviousGuess, kNewest, kNew };
constexpr std::size_t kLongGap = 63;  // and more: the rest follows
constexpr std::size_t kMostPackedBytes = std::size_t{kMaxParts} * kMaxPartBytes;
constexpr std::size_t kCountBytes = 4, kMaxGapBytes = 5, kWordBytes = 8;
constexpr std::size_t kMaxTokenBytes = 1 + kMaxGapBytes + 1 + kWordBytes;
constexpr int kMaxEdges = 8;  // a word with more of them is sent as it is
constexpr std::uint8_t kLastEdge = 0x80, kWholeWord = 0x40;

// Bits that differ from the bit below, and back.
std::uint64_t edges_of(std::uint64_t word) {
  return word ^ word << 1;
}
std::uint64_t word_of(std::uint64_t edges) {
  for (int shift = 1; shift < 64; shift *= 2) edges ^= edges << shift;
  return edges;
}

constexpr std::size_t kBlock = 64;  // words, of which mostly none has changed

constexpr auto kBit = [] {
  std::array<std::uint64_t, kBlock> bits{};
  for (std::size_t i = 0; i < kBlock; ++i) bits[i] = std::uint64_t{1} << i;
  return bits;
}();

// Which of at most that many words have changed, a bit each.
SWARM_WIDE std::uint64_t changes_in(const std::uint64_t* words, const std::uint64_t* before, std::size_t n) {
  std::uint64_t changed = 0;
  for (std::size_t i = 0; i < n; ++i) changed |= words[i] != before[i] ? kBit[i] : 0;
  return changed;
}

// And learns it.
std::uint8_t* put_change(std::uint64_t change, std::size_t gap, ChangeMemory::Guesses guesses, ChangeMemory* memory,
                         std::uint8_t* out) {
  const std::size_t index = ChangeMemory::index_of(change);
  std::uint64_t& newest = memory->newest(index);
  // Reckoned, as a processor cannot foresee which it is: the first that fits.
  const unsigned fits_none = *guesses.next != change, nor_previous = *guesses.previous != change,
                 nor_newest = newest != change;
  const auto kind = static_cast<Change>(fits_none * (1 + nor_previous * (1 + nor_newest)));
  *guesses.next = *guesses.previous = newest = change;
  *out++ = static_cast<std::uint8_t>(static_cast<std::size_t>(kind) << 6 | std::min(gap, kLongGap));
  if (gap >= kLongGap) {
    for (gap -= kLongGap; gap >= 128; gap >>= 7) *out++ = static_cast<std::uint8_t>(gap | 128);
    *out++ = static_cast<std::uint8_t>(gap);
  }
  *out = static_cast<std::uint8_t>(index);  // not asked first whether it counts: that would be foreseen badly
  if (kind != Change::kNew) return out + (kind == Change::kNewest ? 1 : 0);
  std::uint8_t* const first = out;
  std::uint64_t edges = edges_of(change);
  for (; edges != 0 && out < first + kMaxEdges; edges &= edges - 1)
    *out++ = static_cast<std::uint8_t>(std::countr_zero(edges));
  out[-1] |= kLastEdge;
  if (edges == 0) return out;
  *first = kWholeWord;
  std::memcpy(first + 1, &change, kWordBytes);
  return first + 1 + kWordBytes;
}

// Reads at most kMaxTokenBytes; 0 is no change that anybody sends.
std::size_t take_gap(const std::uint8_t*& in) {
  std::size_t gap = *in++ & kLongGap;
  if (gap < kLongGap) return gap;
  for (std::size_t shift = 0; shift < 7 * kMaxGapBytes; shift += 7) {
    gap += static_cast<std::size_t>(*in & 127) << shift;
    if (*in++ < 128) break;
  }
  return gap;
}
std::uint64_t take_change(Change kind, ChangeMemory::Guesses guesses, ChangeMemory* memory, const std::uint8_t*& in) {
  if (kind == Change::kNextGuess) return *guesses.next;
  if (kind == Change::kPreviousGuess) return *guesses.previous;
  if (kind == Change::kNewest) return memory->newest(*in++);
  std::uint64_t word = 0;
  if (*in == kWholeWord) {
    std::memcpy(&word, in + 1, kWordBytes);
    in += 1 + kWordBytes;
    return word;
  }
  for (int i = 0; i < kMaxEdges; ++i) {
    word |= std::uint64_t{1} << (*in & 63);
    if ((*in++ & kLastEdge) != 0) break;
  }
  return word_of(word);
}

GridGeometry geometry_of(const sogm_t& part) {
  return {.resolution_m = part.resolution,
          .origin = Eigen::Vector3i(part.origin[0], part.origin[1], part.origin[2]),
          .size = Eigen::Vector3i(part.size[0], part.size[1], part.size[2])};
}

bool same_map(const sogm_t& a, const sogm_t& b) {
  return a.header.robot_id == b.header.robot_id && a.header.utime == b.header.utime &&
         a.frame_duration_us == b.frame_duration_us && a.num_frames == b.num_frames && a.num_parts == b.num_parts &&
         a.total_bytes == b.total_bytes && geometry_of(a) == geometry_of(b);
}

auto order(const sogm_t& part) {
  return std::tie(part.header.boot, part.header.seq);
}

}  // namespace

std::int64_t map_bytes(const GridGeometry& geometry, int num_frames) {
  return std::int64_t{8} * num_frames * geometry.words_per_frame();
}

SogmEncoder::SogmEncoder() : memory_(std::make_unique<ChangeMemory>()) {}
SogmEncoder::~SogmEncoder() = default;

// False when they take more bytes than can be sent.
bool SogmEncoder::pack(const Sogm& sogm) {
  const auto n = static_cast<std::size_t>(sogm.geometry.words_per_frame());
  zeros_.resize(n);
  memory_->clear();
  std::size_t changes = 0, unchanged_from = 0;  // in the whole map
  packed_size_ = kCountBytes;
  for (std::size_t begin = 0; begin < sogm.words().size(); begin += n) {
    const std::uint64_t* words = sogm.words().data() + begin;
    const std::uint64_t* before = begin == 0 ? zeros_.data() : words - n;
    sogm.for_each_used_run([&](std::size_t first, std::size_t end) {
      for (std::size_t block = first; block < end && packed_size_ <= kMostPackedBytes; block += kBlock) {
        std::uint64_t changed = changes_in(words + block, before + block, std::min(kBlock, end - block));
        if (changed == 0) continue;
        if (packed_.size() < packed_size_ + kBlock * kMaxTokenBytes)
          packed_.resize(2 * packed_.size() + kBlock * kMaxTokenBytes);
        std::uint8_t* out = packed_.data() + packed_size_;
        for (; changed != 0; changed &= changed - 1) {
          const std::size_t i = block + static_cast<std::size_t>(std::countr_zero(changed));
          const auto guesses = memory_->look(before[i], i + 1 < n ? before[i + 1] : 0, i > 0 ? words[i - 1] : 0);
          out = put_change(words[i] ^ before[i], begin + i - unchanged_from, guesses, memory_.get(), out);
          unchanged_from = begin + i + 1;
          ++changes;
        }
        packed_size_ = static_cast<std::size_t>(out - packed_.data());
      }
    });
  }
  packed_.resize(std::max(packed_.size(), packed_size_));
  for (std::size_t i = 0; i < kCountBytes; ++i) packed_[i] = static_cast<std::uint8_t>(changes >> 8 * i);
  return packed_size_ <= kMostPackedBytes;
}

std::span<const sogm_t> SogmEncoder::encode(const Sogm& sogm, sogm_swarm::header_t header) {
  if (!pack(sogm)) return {};
  constexpr std::size_t most = kMaxPartBytes;
  const std::size_t num_parts = (packed_size_ + most - 1) / most;

  header.utime = to_us(sogm.start_utime);
  parts_.resize(std::max(parts_.size(), num_parts));  // keeps the memory of those that this map does not need
  for (std::size_t i = 0; i < num_parts; ++i) {
    sogm_t& part = parts_[i];
    const auto begin = packed_.begin() + static_cast<std::ptrdiff_t>(i * most);
    const std::size_t part_bytes = std::min(most, packed_size_ - i * most);
    part.header = header;
    part.frame_duration_us = static_cast<std::int32_t>(sogm.frame_duration.count());
    part.num_frames = static_cast<std::int16_t>(sogm.num_frames);
    for (int axis = 0; axis < 3; ++axis) {
      part.size[axis] = static_cast<std::int16_t>(sogm.geometry.size[axis]);
      part.origin[axis] = sogm.geometry.origin[axis];
    }
    part.resolution = sogm.geometry.resolution_m;
    part.part = static_cast<std::int16_t>(i);
    part.num_parts = static_cast<std::int16_t>(num_parts);
    part.total_bytes = static_cast<std::int32_t>(packed_size_);
    part.num_bytes = static_cast<std::int32_t>(part_bytes);
    part.packed.assign(begin, begin + static_cast<std::ptrdiff_t>(part_bytes));
  }
  return std::span(parts_).first(num_parts);
}

SogmAssembler::SogmAssembler() : memory_(std::make_unique<ChangeMemory>()), parts_(kMaxParts) {}
SogmAssembler::~SogmAssembler() = default;

Assembly SogmAssembler::add(const sogm_t& part, Sogm* out) {
  Refusal refusal = take(part);
  if (refusal == Refusal::kNone && !complete()) return {AssemblyStatus::kIncomplete};
  if (refusal == Refusal::kNone) {
    done_ = true;  // whatever comes out: the same parts would give the same again
    refusal = unpack();
  }
  if (refusal != Refusal::kNone) return {AssemblyStatus::kRefused, refusal};
  std::swap(*out, map_);
  return {AssemblyStatus::kComplete};
}

Refusal SogmAssembler::take(const sogm_t& part) {
  const bool newer = !started_ || order(layout_) < order(part);
  if (newer) {
    if (map_bytes(geometry_of(part), part.num_frames) > kMaxMapBytes) return Refusal::kLength;
    layout_ = part;
    layout_.packed.clear();
    started_ = true;
    done_ = false;
    have_.reset();
  } else if (done_ || order(part) < order(layout_)) {
    return Refusal::kSequence;
  } else if (!same_map(part, layout_)) {
    return Refusal::kInconsistent;
  }
  const auto index = static_cast<std::size_t>(part.part);
  if (!have_[index]) parts_[index] = part.packed;
  have_.set(index);
  return Refusal::kNone;
}

Refusal SogmAssembler::unpack() {
  packed_.clear();
  for (std::size_t i = 0; i < static_cast<std::size_t>(layout_.num_parts); ++i)
    packed_.insert(packed_.end(), parts_[i].begin(), parts_[i].end());
  const std::size_t size = packed_.size();
  if (size != static_cast<std::size_t>(layout_.total_bytes) || size < kCountBytes) return Refusal::kInconsistent;
  packed_.resize(size + kMaxTokenBytes);  // the last token may be cut short
  const std::uint8_t* in = packed_.data();
  const std::uint8_t* const end = in + size;
  const GridGeometry geometry = geometry_of(layout_);
  const auto n = static_cast<std::size_t>(geometry.words_per_frame());
  const std::size_t num_words = n * static_cast<std::size_t>(layout_.num_frames);
  std::size_t changes = 0;
  for (std::size_t i = 0; i < kCountBytes; ++i) changes |= static_cast<std::size_t>(*in++) << 8 * i;
  if (changes > num_words) return Refusal::kInconsistent;

  map_.reset(geometry, layout_.num_frames, to_utime(layout_.header.utime), Duration(layout_.frame_duration_us));
  int frame = 0;
  std::size_t frame_begin = 0;
  const auto next_frame = [&] {
    map_.repeat_before(++frame);
    frame_begin += n;
  };
  const int tail = geometry.size.z() % 64;
  const std::uint64_t above = tail == 0 ? 0 : ~std::uint64_t{0} << tail;  // the window, in the highest word of a column
  const auto words_per_column = static_cast<std::size_t>(geometry.words_per_column());
  bool is_above = false;
  memory_->clear();
  for (std::size_t i = 0; changes > 0; --changes, ++i) {
    if (in >= end) return Refusal::kInconsistent;
    const auto kind = static_cast<Change>(*in >> 6);
    i += take_gap(in);
    if (i >= num_words) return Refusal::kInconsistent;
    while (i >= frame_begin + n) next_frame();
    const std::size_t at = i - frame_begin;
    std::uint64_t* word = map_.word(frame, at);
    const auto guesses = memory_->look(*word, at + 1 < n ? word[1] : 0, at > 0 ? word[-1] : 0);
    const std::uint64_t change = take_change(kind, guesses, memory_.get(), in);
    if (change == 0) return Refusal::kInconsistent;
    if ((change & above) != 0) is_above |= (i + 1) % words_per_column == 0;
    *word ^= change;
    *guesses.next = *guesses.previous = memory_->newest(ChangeMemory::index_of(change)) = change;
  }
  if (in != end) return Refusal::kInconsistent;
  while (frame + 1 < layout_.num_frames) next_frame();
  return is_above ? Refusal::kValue : Refusal::kNone;
}

}  // namespace swarm
