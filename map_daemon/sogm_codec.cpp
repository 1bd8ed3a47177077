#include "map_daemon/sogm_codec.h"

#include <zstd.h>

#include <algorithm>
#include <bit>
#include <tuple>
#include <utility>

namespace swarm {

using sogm_swarm::sogm_t;

static_assert(std::endian::native == std::endian::little, "the wire's words are little-endian");

namespace {

constexpr int kCompressionLevel = 1;  // higher levels cost milliseconds and save little on sparse bits

std::size_t bitmap_size(std::size_t words) {
  return (words + 63) / 64;
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

const char* to_string(AssemblyStatus status) {
  switch (status) {
    case AssemblyStatus::kIncomplete:
      return "incomplete";
    case AssemblyStatus::kComplete:
      return "complete";
    case AssemblyStatus::kRefused:
      return "refused";
  }
  return "unknown";
}

void SogmEncoder::Free::operator()(ZSTD_CCtx_s* context) const {
  ZSTD_freeCCtx(context);
}
SogmEncoder::SogmEncoder() : context_(ZSTD_createCCtx()) {}
SogmEncoder::~SogmEncoder() = default;

std::span<const sogm_t> SogmEncoder::encode(const Sogm& sogm, sogm_swarm::header_t header) {
  const std::size_t n = static_cast<std::size_t>(sogm.geometry.words_per_frame());
  const std::size_t bitmap_words = bitmap_size(sogm.words.size());
  content_.resize(bitmap_words + sogm.words.size());
  std::fill_n(content_.begin(), bitmap_words, 0);
  std::size_t size = bitmap_words;
  zeros_.assign(n, 0);
  const auto append = [&](std::size_t i, std::uint64_t delta) {
    content_[size] = delta;  // written over when it is zero
    const std::uint64_t changed = delta != 0 ? 1 : 0;
    content_[i / 64] |= changed << (i % 64);
    size += changed;
  };
  constexpr std::size_t kBlock = 8;  // words, of which mostly none has changed
  for (std::size_t begin = 0; begin < sogm.words.size(); begin += n) {
    const std::uint64_t* words = sogm.words.data() + begin;
    const std::uint64_t* before = begin == 0 ? zeros_.data() : words - n;
    std::size_t i = 0;
    for (; i + kBlock <= n; i += kBlock) {
      std::uint64_t any = 0;
      for (std::size_t k = 0; k < kBlock; ++k) any |= words[i + k] ^ before[i + k];
      if (any == 0) continue;
      for (std::size_t k = 0; k < kBlock; ++k) append(begin + i + k, words[i + k] ^ before[i + k]);
    }
    for (; i < n; ++i) append(begin + i, words[i] ^ before[i]);
  }

  const std::size_t raw_bytes = size * sizeof(std::uint64_t);
  packed_.resize(ZSTD_compressBound(raw_bytes));
  packed_size_ =
      ZSTD_compressCCtx(context_.get(), packed_.data(), packed_.size(), content_.data(), raw_bytes, kCompressionLevel);
  constexpr std::size_t most = kMaxPartBytes;
  const std::size_t num_parts = (packed_size_ + most - 1) / most;
  if (num_parts > kMaxParts) return {};

  header.utime = sogm.start_utime;
  parts_.resize(num_parts);
  for (std::size_t i = 0; i < num_parts; ++i) {
    sogm_t& part = parts_[i];
    const auto begin = packed_.begin() + static_cast<std::ptrdiff_t>(i * most);
    const std::size_t part_bytes = std::min(most, packed_size_ - i * most);
    part.header = header;
    part.frame_duration_us = static_cast<std::int32_t>(sogm.frame_duration_us);
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
    part.data.assign(begin, begin + static_cast<std::ptrdiff_t>(part_bytes));
  }
  return parts_;
}

void SogmAssembler::Free::operator()(ZSTD_DCtx_s* context) const {
  ZSTD_freeDCtx(context);
}
SogmAssembler::SogmAssembler() : context_(ZSTD_createDCtx()), parts_(kMaxParts) {}
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
    layout_.data.clear();
    started_ = true;
    done_ = false;
    have_.reset();
  } else if (done_ || order(part) < order(layout_)) {
    return Refusal::kSequence;
  } else if (!same_map(part, layout_)) {
    return Refusal::kInconsistent;
  }
  const auto index = static_cast<std::size_t>(part.part);
  if (!have_[index]) parts_[index] = part.data;
  have_.set(index);
  return Refusal::kNone;
}

Refusal SogmAssembler::unpack() {
  packed_.clear();
  for (int i = 0; i < layout_.num_parts; ++i) packed_.insert(packed_.end(), parts_[i].begin(), parts_[i].end());
  const GridGeometry geometry = geometry_of(layout_);
  const auto n = static_cast<std::size_t>(geometry.words_per_frame());
  const std::size_t num_words = n * static_cast<std::size_t>(layout_.num_frames), bitmap_words = bitmap_size(num_words);
  const std::uint64_t raw_bytes = ZSTD_getFrameContentSize(packed_.data(), packed_.size());  // huge on errors
  if (packed_.size() != static_cast<std::size_t>(layout_.total_bytes) || raw_bytes % sizeof(std::uint64_t) != 0 ||
      raw_bytes < bitmap_words * sizeof(std::uint64_t) ||
      raw_bytes > (bitmap_words + num_words) * sizeof(std::uint64_t) ||
      ZSTD_findFrameCompressedSize(packed_.data(), packed_.size()) != packed_.size()) {
    return Refusal::kInconsistent;
  }
  content_.resize(raw_bytes / sizeof(std::uint64_t));
  if (ZSTD_decompressDCtx(context_.get(), content_.data(), raw_bytes, packed_.data(), packed_.size()) != raw_bytes)
    return Refusal::kDecode;
  std::size_t changed = 0;
  for (std::size_t i = 0; i < bitmap_words; ++i) changed += static_cast<std::size_t>(std::popcount(content_[i]));
  const bool beyond = num_words % 64 != 0 && content_[bitmap_words - 1] >> num_words % 64 != 0;
  if (beyond || bitmap_words + changed != content_.size()) return Refusal::kInconsistent;

  map_.geometry = geometry;
  map_.num_frames = layout_.num_frames;
  map_.start_utime = layout_.header.utime;
  map_.frame_duration_us = layout_.frame_duration_us;
  map_.words.resize(num_words);
  std::fill_n(map_.words.begin(), n, 0);
  std::size_t next = bitmap_words, frame_end = n;
  const auto begin_frame = [&] {  // as the one before
    std::uint64_t* words = map_.words.data() + frame_end;
    std::copy_n(words - n, n, words);
    frame_end += n;
  };
  for (std::size_t i = 0; i < bitmap_words; ++i) {
    for (std::uint64_t bits = content_[i]; bits != 0; bits &= bits - 1) {
      const std::size_t word = 64 * i + static_cast<std::size_t>(std::countr_zero(bits));
      while (word >= frame_end) begin_frame();
      map_.words[word] ^= content_[next++];
    }
  }
  while (frame_end < num_words) begin_frame();

  const int tail = geometry.size.z() % 64;
  if (tail == 0) return Refusal::kNone;
  const auto words_per_column = static_cast<std::size_t>(geometry.words_per_column());
  std::uint64_t above = 0;
  for (std::size_t i = words_per_column - 1; i < map_.words.size(); i += words_per_column)
    above |= map_.words[i] >> tail;
  return above == 0 ? Refusal::kNone : Refusal::kValue;
}

}  // namespace swarm
