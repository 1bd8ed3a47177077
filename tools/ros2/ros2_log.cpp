#include "tools/ros2/ros2_log.h"

#include <spdlog/fmt/fmt.h>

#include <numeric>

namespace swarm {
namespace {

constexpr Duration kLogPeriod = 10s;  // of what is refused, and of the summary

std::string summary_of(const Ros2Report& report) {
  return fmt::format(
      "from ROS: {} states, {} goals, {} obstacle messages ({} markers passed over), {} scans ({} thinned); refused: "
      "{}; to ROS: {} commands, {} paths, {} clouds; refused from the bus: {}",
      report.states, report.goals, report.obstacle_messages, report.passed_over, report.scans, report.thinned,
      list_counts<RosRefusal>(kNumRosRefusals,
                              [&](RosRefusal reason) { return report.refused[static_cast<std::size_t>(reason)]; }),
      report.commands, report.paths, report.clouds,
      list_counts<Refusal>(kNumRefusals, [&](Refusal reason) { return report.refused_from_bus[reason]; }));
}

}  // namespace

std::vector<LogLine> Ros2Log::update(Utime now, const Ros2Report& report) {
  std::vector<LogLine> lines;
  if (report.is_silent != is_silent_) {
    add_line(&lines, report.is_silent,
             report.is_silent ? "no setpoints: commands follow the committed trajectory" : "setpoints are heard again");
  }
  is_silent_ = report.is_silent;
  const std::int64_t refused = std::accumulate(report.refused.begin(), report.refused.end(), std::int64_t{0});
  if (refused != refused_ && now >= refusal_.due(now, kLogPeriod)) {
    add_line(&lines, true, fmt::format("{} messages refused; the newest: {}", refused - refused_, report.words));
    refused_ = refused;
    refusal_.done(now);
  }
  if (!summary_) summary_.emplace().done(now);
  if (now >= summary_->due(now, kLogPeriod)) {
    add_line(&lines, false, summary_of(report));
    summary_->done(now);
  }
  return lines;
}

}  // namespace swarm
