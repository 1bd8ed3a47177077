#include "tools/ros2/ros2_log.h"

#include <spdlog/fmt/fmt.h>

#include <numeric>

namespace swarm {
namespace {

constexpr Duration kLogPeriod = 10s;  // of what goes wrong, and of the summary

std::string summary_of(const Ros2Report& report) {
  return fmt::format(
      "from ROS: {} states, {} goals, {} obstacle messages ({} markers passed over), {} scans ({} thinned); refused: "
      "{}; overtaken: {}; to ROS: {} commands, {} paths, {} clouds; not published: {}; refused from the bus: {}",
      report.states, report.goals, report.obstacle_messages, report.passed_over, report.scans, report.thinned,
      list_counts<RosRefusal>(kNumRosRefusals,
                              [&](RosRefusal reason) { return report.refused[static_cast<std::size_t>(reason)]; }),
      report.overtaken, report.commands, report.paths, report.clouds, report.unpublished,
      list_counts<Refusal>(kNumRefusals, [&](Refusal reason) { return report.refused_from_bus[reason]; }));
}

}  // namespace

void Ros2Log::tell_more(std::vector<LogLine>* lines, Utime now, std::int64_t count, const char* what,
                        const std::string& newest, Told* told) {
  if (count == told->count || now < told->line.due(now, kLogPeriod)) return;
  add_line(lines, true, fmt::format("{} messages {}; the newest: {}", count - told->count, what, newest));
  told->count = count;
  told->line.done(now);
}

std::vector<LogLine> Ros2Log::update(Utime now, const Ros2Report& report) {
  std::vector<LogLine> lines;
  if (report.is_silent != is_silent_) {
    add_line(&lines, report.is_silent,
             report.is_silent ? "no setpoints: commands follow the committed trajectory" : "setpoints are heard again");
  }
  is_silent_ = report.is_silent;
  const std::int64_t refused = std::accumulate(report.refused.begin(), report.refused.end(), std::int64_t{0});
  tell_more(&lines, now, refused, "refused", report.words, &refused_);
  tell_more(&lines, now, report.unpublished, "not published", report.unpublished_words, &unpublished_);
  if (!summary_) summary_.emplace().done(now);
  if (now >= summary_->due(now, kLogPeriod)) {
    add_line(&lines, false, summary_of(report));
    summary_->done(now);
  }
  return lines;
}

}  // namespace swarm
