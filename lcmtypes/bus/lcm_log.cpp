#include "lcmtypes/bus/lcm_log.h"

#include <algorithm>
#include <array>
#include <span>
#include <stdexcept>

#include "lcmtypes/bus/big_endian.h"
#include "lcmtypes/bus/limits.h"

namespace swarm {
namespace {

// An event: this word, its number (8 bytes), time (8), lengths of channel and data (4 each), channel, data; big-endian.
constexpr std::uint32_t kSync = 0xEDA1DA01;
constexpr std::size_t kHeader = 28, kMaxChannel = 63;

}  // namespace

LcmLog::LcmLog(const std::filesystem::path& path) : file_(path, std::ios::binary) {
  std::error_code error;
  size_ = static_cast<std::int64_t>(std::filesystem::file_size(path, error));
  if (!file_ || error) throw std::runtime_error(path.string() + ": must be a readable LCM log");
}

bool LcmLog::next(LogEvent* event) {
  while (next_ < size_) {
    const std::int64_t begin = next_;
    file_.clear();
    file_.seekg(begin);
    if (read(event)) {
      next_ = file_.tellg();
      return true;
    }
    // To the next place that may begin one.
    file_.clear();
    file_.seekg(begin + 1);
    std::uint32_t word = 0;
    int byte = 0;
    for (next_ = begin - 3; word != kSync && (byte = file_.get()) >= 0; ++next_)
      word = word << 8 | static_cast<std::uint32_t>(byte);
    next_ = word == kSync ? next_ : size_;
    skipped_ += next_ - begin;
  }
  return false;
}

bool LcmLog::read(LogEvent* event) {
  const std::int64_t from = file_.tellg();
  std::array<std::uint8_t, kHeader> header;
  if (!file_.read(reinterpret_cast<char*>(header.data()), header.size())) return false;
  const std::span<const std::uint8_t> fields(header);
  const std::uint64_t channel = read_big_endian(fields.subspan(20, 4)), data = read_big_endian(fields.subspan(24, 4));
  if (read_big_endian(fields.first(4)) != kSync || channel < 1 || channel > kMaxChannel || data > kMaxBytes ||
      from + static_cast<std::int64_t>(kHeader + channel + data) > size_)
    return false;
  event->offset = from;
  const std::uint64_t utime_us = read_big_endian(fields.subspan(12, 8));
  if (utime_us > static_cast<std::uint64_t>(to_us(kMaxUtime))) return false;  // nobody can reckon with it
  event->utime = to_utime(static_cast<std::int64_t>(utime_us));
  event->channel.resize(channel);
  event->bytes.resize(data);
  file_.read(event->channel.data(), static_cast<std::streamsize>(channel));
  file_.read(reinterpret_cast<char*>(event->bytes.data()), static_cast<std::streamsize>(data));
  if (!file_ ||
      !std::all_of(event->channel.begin(), event->channel.end(), [](char c) { return c > ' ' && c < '\x7f'; }))
    return false;
  // Another one or nothing must follow, or the lengths are wrong.
  const std::int64_t end = file_.tellg();
  std::array<std::uint8_t, 4> word;
  const bool ends = !file_.read(reinterpret_cast<char*>(word.data()), word.size());
  file_.clear();
  file_.seekg(end);
  return ends || read_big_endian(word) == kSync;
}

}  // namespace swarm
