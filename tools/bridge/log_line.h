// Lines for the operator, and how counters are told in them.
#pragma once

#include <spdlog/spdlog.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace swarm {

struct LogLine {
  bool warning = false;
  std::string text;
};

inline void add_line(std::vector<LogLine>* lines, bool warning, std::string_view text) {
  LogLine& line = lines->emplace_back();
  line.warning = warning;
  line.text = text;
}

inline void write(const std::vector<LogLine>& lines) {
  for (const LogLine& line : lines) spdlog::log(line.warning ? spdlog::level::warn : spdlog::level::info, line.text);
}

// "REASON N, ..." for every reason that occurred, by its to_string; "none".
template <class Reason, class Count>
std::string list_counts(int reasons, const Count& count) {
  std::string text;
  for (int i = 0; i < reasons; ++i) {
    const auto reason = static_cast<Reason>(i);
    const std::int64_t n = count(reason);
    if (n > 0) text.append(text.empty() ? "" : ", ").append(to_string(reason)).append(" ").append(std::to_string(n));
  }
  return text.empty() ? "none" : text;
}

}  // namespace swarm
