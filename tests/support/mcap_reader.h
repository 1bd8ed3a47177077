// Reads MCAP files back, straight from the specification, and checks what they say of themselves: magic, checksums,
// offsets, indexes, statistics.
#pragma once

#include <gtest/gtest.h>
#include <zstd.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "lcmtypes/bus/crc32.h"
#include "tests/support/harness.h"

namespace swarm::test {

struct McapMessage {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  std::uint64_t time_ns = 0;
  std::string data;
};

struct McapFile {
  struct Schema {
    std::string name, encoding, data;
    bool operator==(const Schema&) const = default;
  };
  struct Channel {
    std::uint16_t schema = 0;
    std::string topic, encoding;
    bool operator==(const Channel&) const = default;
  };
  std::map<std::uint16_t, Schema> schemas;
  std::map<std::uint16_t, Channel> channels;
  std::vector<McapMessage> messages;  // in the file's order
  int chunks = 0;
  std::string compression, library;

  std::string topic(const McapMessage& message) const { return channels.at(message.channel).topic; }
  std::map<std::string, std::int64_t> counts() const {
    std::map<std::string, std::int64_t> by_topic;
    for (const McapMessage& message : messages) ++by_topic[topic(message)];
    return by_topic;
  }
  // Of one topic, in order.
  std::vector<McapMessage> of(const std::string& topic_name) const {
    std::vector<McapMessage> found;
    std::copy_if(messages.begin(), messages.end(), std::back_inserter(found),
                 [&](const McapMessage& message) { return topic(message) == topic_name; });
    return found;
  }
};

class McapCursor {
 public:
  explicit McapCursor(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  bool empty() const { return bytes_.empty(); }
  std::span<const std::uint8_t> take(std::size_t size) {
    if (size > bytes_.size()) throw std::runtime_error("a record ends too early");
    const auto taken = bytes_.first(size);
    bytes_ = bytes_.subspan(size);
    return taken;
  }
  std::span<const std::uint8_t> rest() { return take(bytes_.size()); }
  template <class Number>
  Number number() {
    std::uint64_t value = 0;
    const auto taken = take(sizeof(Number));
    for (std::size_t i = 0; i < taken.size(); ++i) value |= std::uint64_t{taken[i]} << (8 * i);
    return static_cast<Number>(value);
  }
  std::string text() {
    const auto taken = take(number<std::uint32_t>());
    return {taken.begin(), taken.end()};
  }

 private:
  std::span<const std::uint8_t> bytes_;
};

// Calls visit(operation, content, offset of the record in `bytes`) for every record.
template <class Visit>
void for_each_mcap_record(std::span<const std::uint8_t> bytes, const Visit& visit) {
  for (std::size_t offset = 0; offset < bytes.size();) {
    McapCursor cursor(bytes.subspan(offset));
    const auto op = cursor.number<std::uint8_t>();
    const auto size = cursor.number<std::uint64_t>();
    visit(op, McapCursor(cursor.take(size)), offset);
    offset += 9 + size;
  }
}

class McapReader {
 public:
  static McapFile read(const std::filesystem::path& path) {
    const std::string text = read_text(path);
    McapReader reader({text.begin(), text.end()});
    reader.read_all();
    return reader.file_;
  }

 private:
  using Span = std::span<const std::uint8_t>;
  struct Chunk {
    std::uint64_t first_ns = 0, last_ns = 0, offset = 0, length = 0, packed = 0, content = 0, index_bytes = 0;
    std::string compression;
    std::map<std::uint16_t, std::uint64_t> index_offsets;
    bool operator==(const Chunk&) const = default;
  };

  explicit McapReader(Bytes bytes) : bytes_(std::move(bytes)) {}

  void read_all() {
    const Bytes magic = {0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
    ASSERT_GT(bytes_.size(), 2 * magic.size() + 29);
    ASSERT_TRUE(std::equal(magic.begin(), magic.end(), bytes_.begin()));
    ASSERT_TRUE(std::equal(magic.rbegin(), magic.rend(), bytes_.rbegin()));
    bytes_.resize(bytes_.size() - magic.size());
    const Span records = Span(bytes_).subspan(magic.size());
    std::vector<std::uint8_t> ops;
    for_each_mcap_record(records, [&](std::uint8_t op, McapCursor content, std::size_t offset) {
      ops.push_back(op);
      take(op, content, offset + magic.size());
    });
    ASSERT_EQ(ops.front(), 1) << "the header is first";
    ASSERT_EQ(ops.back(), 2) << "the footer is last";
    EXPECT_TRUE(ended_);
    EXPECT_TRUE(pending_.empty()) << "messages that are in no index";
    EXPECT_EQ(chunks_, indexed_chunks_);
    EXPECT_EQ(file_.schemas, summary_schemas_);
    EXPECT_EQ(file_.channels, summary_channels_);
    EXPECT_TRUE(statistics_seen_);
    EXPECT_EQ(groups_, groups_named_) << "summary offsets";
  }

  void take(std::uint8_t op, McapCursor content, std::size_t offset) {
    if (ended_ && (op == 3 || op == 4 || op == 8 || op == 11)) {
      auto& [begin, end] = groups_.try_emplace(op, offset, offset).first->second;
      EXPECT_EQ(end, offset) << "records of one kind stand together";
      end = offset + 9 + McapCursor(Span(bytes_).subspan(offset + 1)).number<std::uint64_t>();
    }
    switch (op) {
      case 1:
        EXPECT_EQ(content.text(), "");
        file_.library = content.text();
        break;
      case 2:
        take_footer(content, offset);
        break;
      case 3:
      case 4:
        EXPECT_TRUE(ended_) << "schemas and channels are in chunks";
        take_definition(op, content, &summary_schemas_, &summary_channels_);
        break;
      case 6:
        take_chunk(content, offset);
        break;
      case 7:
        take_message_index(content, offset);
        break;
      case 8:
        take_chunk_index(content);
        break;
      case 11:
        take_statistics(content);
        break;
      case 14:
        take_summary_offset(content);
        break;
      case 15:
        ended_ = true;
        EXPECT_EQ(content.number<std::uint32_t>(), crc32(Span(bytes_).first(offset)));
        summary_begin_ = offset + 13;
        break;
      default:
        ADD_FAILURE() << "operation " << int{op};
    }
    EXPECT_TRUE(content.empty() || op == 6 || op == 2) << "bytes left over in a record of " << int{op};
  }

  static void take_definition(std::uint8_t op, McapCursor& content, std::map<std::uint16_t, McapFile::Schema>* schemas,
                              std::map<std::uint16_t, McapFile::Channel>* channels) {
    const auto id = content.number<std::uint16_t>();
    if (op == 3) {
      auto name = content.text(), encoding = content.text(), data = content.text();
      EXPECT_TRUE(schemas->try_emplace(id, McapFile::Schema{name, encoding, data}).second);
    } else {
      const auto schema = content.number<std::uint16_t>();
      EXPECT_TRUE(schemas->contains(schema));
      auto topic = content.text(), encoding = content.text();
      EXPECT_EQ(content.number<std::uint32_t>(), 0u) << "metadata";
      EXPECT_TRUE(channels->try_emplace(id, McapFile::Channel{schema, topic, encoding}).second);
    }
  }

  void take_chunk(McapCursor& content, std::size_t offset) {
    EXPECT_FALSE(ended_);
    EXPECT_TRUE(pending_.empty()) << "messages that are in no index";
    Chunk chunk;
    chunk.first_ns = content.number<std::uint64_t>();
    chunk.last_ns = content.number<std::uint64_t>();
    chunk.content = content.number<std::uint64_t>();
    const auto crc = content.number<std::uint32_t>();
    chunk.compression = file_.compression = content.text();
    chunk.packed = content.number<std::uint64_t>();
    const Span packed = content.rest();
    EXPECT_EQ(packed.size(), chunk.packed);
    Bytes records(packed.begin(), packed.end());
    if (chunk.compression == "zstd") {
      records.resize(chunk.content);
      EXPECT_EQ(ZSTD_decompress(records.data(), records.size(), packed.data(), packed.size()), chunk.content);
    }
    EXPECT_EQ(records.size(), chunk.content);
    EXPECT_EQ(crc32(records), crc);
    std::uint64_t first_ns = ~std::uint64_t{0}, last_ns = 0;
    for_each_mcap_record(records, [&](std::uint8_t op, McapCursor record, std::size_t record_offset) {
      if (op != 5) return take_definition(op, record, &file_.schemas, &file_.channels);
      McapMessage message;
      message.channel = record.number<std::uint16_t>();
      message.sequence = record.number<std::uint32_t>();
      message.time_ns = record.number<std::uint64_t>();
      EXPECT_EQ(record.number<std::uint64_t>(), message.time_ns);
      const Span data = record.rest();
      message.data.assign(data.begin(), data.end());
      EXPECT_TRUE(file_.channels.contains(message.channel)) << "a channel stands before its messages";
      EXPECT_EQ(message.sequence, counts_[message.channel]++);
      first_ns = std::min(first_ns, message.time_ns);
      last_ns = std::max(last_ns, message.time_ns);
      pending_.insert({message.channel, message.time_ns, record_offset});
      file_.messages.push_back(std::move(message));
    });
    EXPECT_EQ(chunk.first_ns, pending_.empty() ? 0 : first_ns);
    EXPECT_EQ(chunk.last_ns, last_ns);
    chunk.offset = offset;
    chunk.length = 9 + 8 + 8 + 8 + 4 + 4 + chunk.compression.size() + 8 + chunk.packed;
    chunks_.push_back(chunk);
    ++file_.chunks;
  }

  void take_message_index(McapCursor& content, std::size_t offset) {
    ASSERT_FALSE(chunks_.empty());
    const auto channel = content.number<std::uint16_t>();
    const auto size = content.number<std::uint32_t>();
    for (std::uint32_t i = 0; i < size / 16; ++i) {
      const auto time_ns = content.number<std::uint64_t>(), record_offset = content.number<std::uint64_t>();
      EXPECT_EQ(pending_.erase({channel, time_ns, record_offset}), 1u);
    }
    EXPECT_TRUE(chunks_.back().index_offsets.try_emplace(channel, offset).second);
    chunks_.back().index_bytes += 9 + 2 + 4 + size;
  }

  void take_chunk_index(McapCursor& content) {
    Chunk& chunk = indexed_chunks_.emplace_back();
    chunk.first_ns = content.number<std::uint64_t>();
    chunk.last_ns = content.number<std::uint64_t>();
    chunk.offset = content.number<std::uint64_t>();
    chunk.length = content.number<std::uint64_t>();
    for (auto left = content.number<std::uint32_t>(); left > 0; left -= 10) {
      const auto channel = content.number<std::uint16_t>();
      chunk.index_offsets[channel] = content.number<std::uint64_t>();
    }
    chunk.index_bytes = content.number<std::uint64_t>();
    chunk.compression = content.text();
    chunk.packed = content.number<std::uint64_t>();
    chunk.content = content.number<std::uint64_t>();
  }

  void take_statistics(McapCursor& content) {
    statistics_seen_ = true;
    EXPECT_EQ(content.number<std::uint64_t>(), file_.messages.size());
    EXPECT_EQ(content.number<std::uint16_t>(), file_.schemas.size());
    EXPECT_EQ(content.number<std::uint32_t>(), file_.channels.size());
    EXPECT_EQ(content.number<std::uint32_t>(), 0u) << "attachments";
    EXPECT_EQ(content.number<std::uint32_t>(), 0u) << "metadata";
    EXPECT_EQ(content.number<std::uint32_t>(), chunks_.size());
    std::uint64_t first_ns = file_.messages.empty() ? 0 : ~std::uint64_t{0}, last_ns = 0;
    for (const McapMessage& message : file_.messages) {
      first_ns = std::min(first_ns, message.time_ns);
      last_ns = std::max(last_ns, message.time_ns);
    }
    EXPECT_EQ(content.number<std::uint64_t>(), first_ns);
    EXPECT_EQ(content.number<std::uint64_t>(), last_ns);
    EXPECT_EQ(content.number<std::uint32_t>(), 10 * file_.channels.size());
    for (std::size_t i = 0; i < file_.channels.size(); ++i) {
      const auto channel = content.number<std::uint16_t>();
      EXPECT_EQ(content.number<std::uint64_t>(), counts_[channel]) << channel;
    }
  }

  void take_summary_offset(McapCursor& content) {
    if (offsets_begin_ == 0) {
      for (const auto& [op, group] : groups_) offsets_begin_ = std::max<std::uint64_t>(offsets_begin_, group.second);
    }
    const auto op = content.number<std::uint8_t>();
    const auto begin = content.number<std::uint64_t>();
    groups_named_[op] = {begin, begin + content.number<std::uint64_t>()};
  }

  void take_footer(McapCursor& content, std::size_t offset) {
    EXPECT_EQ(content.number<std::uint64_t>(), summary_begin_);
    EXPECT_EQ(content.number<std::uint64_t>(), offsets_begin_);
    const Span covered = Span(bytes_).subspan(summary_begin_, offset + 9 + 16 - summary_begin_);
    EXPECT_EQ(content.number<std::uint32_t>(), crc32(covered));
  }

  Bytes bytes_;
  McapFile file_;
  bool ended_ = false, statistics_seen_ = false;
  std::vector<Chunk> chunks_, indexed_chunks_;
  std::set<std::tuple<std::uint16_t, std::uint64_t, std::uint64_t>> pending_;  // not indexed yet
  std::map<std::uint16_t, std::uint64_t> counts_;
  std::map<std::uint16_t, McapFile::Schema> summary_schemas_;
  std::map<std::uint16_t, McapFile::Channel> summary_channels_;
  std::map<std::uint8_t, std::pair<std::uint64_t, std::uint64_t>> groups_, groups_named_;
  std::uint64_t summary_begin_ = 0, offsets_begin_ = 0;
};

}  // namespace swarm::test
