#include "tools/logs/mcap_writer.h"

#include <zstd.h>

#include <algorithm>
#include <limits>
#include <stdexcept>

#include "lcmtypes/bus/crc32.h"

namespace swarm {
namespace {

using Bytes = std::vector<std::uint8_t>;

enum class Op : std::uint8_t {
  kHeader = 1,
  kFooter = 2,
  kSchema = 3,
  kChannel = 4,
  kMessage = 5,
  kChunk = 6,
  kMessageIndex = 7,
  kChunkIndex = 8,
  kStatistics = 11,
  kSummaryOffset = 14,
  kDataEnd = 15,
};

constexpr std::uint8_t kMagic[] = {0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
constexpr std::uint16_t kMaxId = std::numeric_limits<std::uint16_t>::max();

// Little-endian.
template <class Number>
void append_number(Number value, Bytes* bytes) {
  for (std::size_t i = 0; i < sizeof value; ++i) bytes->push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// A record at the end of `bytes`, whose length is known when it ends with this object.
class Record {
 public:
  Record(Op op, Bytes* bytes) : bytes_(bytes) {
    bytes_->push_back(static_cast<std::uint8_t>(op));
    append_number(std::uint64_t{0}, bytes_);
    begin_ = bytes_->size();
  }
  ~Record() {
    const std::uint64_t length = bytes_->size() - begin_;
    for (std::size_t i = 0; i < sizeof length; ++i)
      (*bytes_)[begin_ - sizeof length + i] = static_cast<std::uint8_t>(length >> (8 * i));
  }
  Record(const Record&) = delete;
  Record& operator=(const Record&) = delete;

  template <class Number>
  Record& number(Number value) {
    append_number(value, bytes_);
    return *this;
  }
  Record& raw(std::span<const std::uint8_t> bytes) {
    bytes_->insert(bytes_->end(), bytes.begin(), bytes.end());
    return *this;
  }
  Record& text(std::string_view text) { return number(static_cast<std::uint32_t>(text.size())).raw(bytes_of(text)); }

 private:
  Bytes* bytes_;
  std::size_t begin_;
};

}  // namespace

void McapWriter::Free::operator()(ZSTD_CCtx_s* context) const {
  ZSTD_freeCCtx(context);
}

void McapWriter::Extent::add(std::uint64_t time_ns) {
  first_ns = std::min(first_ns, time_ns);
  last_ns = std::max(last_ns, time_ns);
}

McapWriter::McapWriter(const std::filesystem::path& path, std::string_view library, const McapOptions& options)
    : file_(path), out_(file_.temporary(), std::ios::binary), options_(options), context_(ZSTD_createCCtx()) {
  if (!context_) throw std::runtime_error(path.string() + ": no memory to compress");
  put(kMagic);
  scratch_.clear();
  Record(Op::kHeader, &scratch_).text("").text(library);
  put(scratch_);
}

McapWriter::~McapWriter() = default;

void McapWriter::put(std::span<const std::uint8_t> bytes) {
  out_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!out_) fail_to_write(file_.path());
  crc_ = crc32(bytes, crc_);
  position_ += bytes.size();
}

std::uint16_t McapWriter::add_schema(std::string_view name, std::string_view encoding, std::string_view data) {
  if (num_schemas_ == kMaxId) throw std::runtime_error(file_.path().string() + ": more schemas than MCAP can hold");
  const std::uint16_t id = ++num_schemas_;
  for (Bytes* bytes : {&chunk_, &schemas_}) Record(Op::kSchema, bytes).number(id).text(name).text(encoding).text(data);
  return id;
}

std::uint16_t McapWriter::add_channel(std::uint16_t schema, std::string_view topic, std::string_view encoding) {
  if (channel_counts_.size() == kMaxId)
    throw std::runtime_error(file_.path().string() + ": more topics than MCAP can hold");
  channel_counts_.push_back(0);
  const auto id = static_cast<std::uint16_t>(channel_counts_.size());
  for (Bytes* bytes : {&chunk_, &channel_records_})
    Record(Op::kChannel, bytes).number(id).number(schema).text(topic).text(encoding).number(std::uint32_t{0});
  return id;
}

void McapWriter::write(std::uint16_t channel, std::uint64_t time_ns, std::string_view data) {
  chunk_index_[channel].push_back({time_ns, chunk_.size()});
  chunk_extent_.add(time_ns);
  extent_.add(time_ns);
  const auto sequence = static_cast<std::uint32_t>(channel_counts_[channel - 1]++);
  Record(Op::kMessage, &chunk_).number(channel).number(sequence).number(time_ns).number(time_ns).raw(bytes_of(data));
  ++messages_;
  if (chunk_.size() > options_.chunk_bytes) end_chunk();
}

std::string_view McapWriter::pack() {
  if (!options_.compress) {
    packed_ = chunk_;
    return "";
  }
  packed_.resize(ZSTD_compressBound(chunk_.size()));
  const std::size_t size = ZSTD_compress2(context_.get(), packed_.data(), packed_.size(), chunk_.data(), chunk_.size());
  if (ZSTD_isError(size) != 0) throw std::runtime_error(file_.path().string() + ": zstd: " + ZSTD_getErrorName(size));
  packed_.resize(size);
  return "zstd";
}

void McapWriter::end_chunk() {
  if (chunk_.empty()) return;
  const std::string_view compression = pack();
  const std::uint64_t begin = position_;
  scratch_.clear();
  Record(Op::kChunk, &scratch_)
      .number(chunk_extent_.first_or_zero())
      .number(chunk_extent_.last_ns)
      .number(std::uint64_t{chunk_.size()})
      .number(crc32(chunk_))
      .text(compression)
      .number(std::uint64_t{packed_.size()})
      .raw(packed_);
  put(scratch_);
  const std::uint64_t end = position_;
  std::map<std::uint16_t, std::uint64_t> index_offsets;
  for (const auto& [channel, entries] : chunk_index_) {
    index_offsets[channel] = position_;
    scratch_.clear();
    {
      Record record(Op::kMessageIndex, &scratch_);
      record.number(channel).number(static_cast<std::uint32_t>(16 * entries.size()));
      for (const IndexEntry& entry : entries) record.number(entry.time_ns).number(entry.offset);
    }
    put(scratch_);
  }
  Record index(Op::kChunkIndex, &chunk_indexes_);
  index.number(chunk_extent_.first_or_zero()).number(chunk_extent_.last_ns).number(begin).number(end - begin);
  index.number(static_cast<std::uint32_t>(10 * index_offsets.size()));
  for (const auto& [channel, offset] : index_offsets) index.number(channel).number(offset);
  index.number(position_ - end).text(compression);
  index.number(std::uint64_t{packed_.size()}).number(std::uint64_t{chunk_.size()});
  ++chunks_;
  chunk_.clear();
  chunk_index_.clear();
  chunk_extent_ = {};
}

void McapWriter::close() {
  end_chunk();
  scratch_.clear();
  Record(Op::kDataEnd, &scratch_).number(crc_);
  put(scratch_);

  Bytes statistics;
  {
    Record record(Op::kStatistics, &statistics);
    record.number(messages_).number(num_schemas_).number(static_cast<std::uint32_t>(channel_counts_.size()));
    record.number(std::uint32_t{0}).number(std::uint32_t{0});  // attachments, metadata
    record.number(static_cast<std::uint32_t>(chunks_)).number(extent_.first_or_zero()).number(extent_.last_ns);
    record.number(static_cast<std::uint32_t>(10 * channel_counts_.size()));
    for (std::size_t i = 0; i < channel_counts_.size(); ++i)
      record.number(static_cast<std::uint16_t>(i + 1)).number(channel_counts_[i]);
  }
  const std::uint64_t summary = position_;
  Bytes summary_section, offsets;
  const std::pair<Op, const Bytes*> groups[] = {{Op::kSchema, &schemas_},
                                                {Op::kChannel, &channel_records_},
                                                {Op::kStatistics, &statistics},
                                                {Op::kChunkIndex, &chunk_indexes_}};
  for (const auto& [op, records] : groups) {
    if (records->empty()) continue;
    Record(Op::kSummaryOffset, &offsets)
        .number(static_cast<std::uint8_t>(op))
        .number(summary + summary_section.size())
        .number(std::uint64_t{records->size()});
    summary_section.insert(summary_section.end(), records->begin(), records->end());
  }
  const std::uint64_t offsets_begin = summary + summary_section.size();
  summary_section.insert(summary_section.end(), offsets.begin(), offsets.end());
  Record(Op::kFooter, &summary_section).number(summary).number(offsets_begin).number(std::uint32_t{0});
  // The checksum covers what stands before it, from the summary's start on.
  const std::uint32_t crc = crc32(std::span(summary_section).first(summary_section.size() - sizeof crc));
  summary_section.resize(summary_section.size() - sizeof crc);
  append_number(crc, &summary_section);
  put(summary_section);
  put(kMagic);
  out_.close();
  if (!out_) fail_to_write(file_.path());
  file_.commit();
}

}  // namespace swarm
