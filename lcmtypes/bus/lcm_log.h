// Reading LCM logs, damaged ones too: whatever is no event is skipped and counted.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "lcmtypes/bus/time.h"

namespace swarm {

struct LogEvent {
  Utime utime{};  // when it was recorded, up to kMaxUtime
  std::string channel;
  std::vector<std::uint8_t> bytes;
  std::int64_t offset = 0;  // in the file, where it begins
};

class LcmLog {
 public:
  static constexpr std::uint32_t kMaxBytes = 1u << 26;  // of one event

  // Throws std::runtime_error with path and reason when the file cannot be read.
  explicit LcmLog(const std::filesystem::path& path);

  // The next event in the file's order; false: there is none.
  bool next(LogEvent* event);
  // The same from an event's offset on.
  void go_to(std::int64_t offset) { next_ = offset; }
  // Bytes that were no events, so far.
  std::int64_t skipped() const { return skipped_; }
  std::int64_t size() const { return size_; }

 private:
  bool read(LogEvent* event);

  std::ifstream file_;
  std::int64_t size_ = 0, next_ = 0, skipped_ = 0;
};

}  // namespace swarm
