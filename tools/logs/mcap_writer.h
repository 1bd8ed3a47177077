// Writes MCAP files (https://mcap.dev/spec), version 0: messages in compressed chunks, each with an index of its
// messages, and a summary at the end, so that readers find every message without reading the whole.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/atomic_file.h"

struct ZSTD_CCtx_s;

namespace swarm {

struct McapOptions {
  bool compress = true;                 // chunks by zstd, or not at all
  std::size_t chunk_bytes = 4'000'000;  // a chunk ends with the message that makes it longer than this
};

// Takes the memory of one chunk, of the schemas and channels and of 10 bytes a channel and chunk. The file has its name
// after close() only; without it nothing is left. All members throw std::runtime_error with path and reason when the
// file cannot be written.
class McapWriter {
 public:
  // `library`: the program that writes.
  McapWriter(const std::filesystem::path& path, std::string_view library, const McapOptions& options = {});
  ~McapWriter();

  // Numbers schemas and channels from 1 on; std::runtime_error after the 65535th. `encoding` as in the registry of
  // MCAP: "jsonschema" for schemas, "json" for messages.
  std::uint16_t add_schema(std::string_view name, std::string_view encoding, std::string_view data);
  std::uint16_t add_channel(std::uint16_t schema, std::string_view topic, std::string_view encoding);

  // A message of an added channel, at `time_ns` since the epoch; numbered within its channel from 0 on.
  void write(std::uint16_t channel, std::uint64_t time_ns, std::string_view data);

  // Writes the summary and gives the file its name. Nothing may be written afterwards.
  void close();

  std::uint64_t messages() const { return messages_; }
  std::size_t channels() const { return channel_counts_.size(); }
  std::uint64_t bytes() const { return position_; }  // of the file so far

 private:
  using Bytes = std::vector<std::uint8_t>;
  struct Free {
    void operator()(ZSTD_CCtx_s* context) const;
  };
  struct IndexEntry {
    std::uint64_t time_ns, offset;  // of the message's record in the chunk's content
  };
  struct Extent {
    std::uint64_t first_ns = ~std::uint64_t{0}, last_ns = 0;
    void add(std::uint64_t time_ns);
    std::uint64_t first_or_zero() const { return first_ns <= last_ns ? first_ns : 0; }
  };

  void put(std::span<const std::uint8_t> bytes);  // into the file
  void end_chunk();
  std::string_view pack();  // the chunk into packed_; how it was packed

  AtomicFile file_;
  std::ofstream out_;
  McapOptions options_;
  std::unique_ptr<ZSTD_CCtx_s, Free> context_;
  std::uint64_t position_ = 0, messages_ = 0, chunks_ = 0;
  std::uint32_t crc_ = 0;
  Bytes chunk_, packed_, scratch_;
  Extent chunk_extent_, extent_;
  std::map<std::uint16_t, std::vector<IndexEntry>> chunk_index_;
  std::uint16_t num_schemas_ = 0;
  std::vector<std::uint64_t> channel_counts_;        // messages of channel i + 1
  Bytes schemas_, channel_records_, chunk_indexes_;  // records for the summary
};

}  // namespace swarm
