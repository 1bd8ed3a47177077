#include "tools/bridge/mocap_log.h"

#include <spdlog/fmt/fmt.h>

#include <numeric>

namespace swarm {
namespace {

constexpr Duration kMocapSilence = 1s;
constexpr Duration kRefusalPeriod = 1s;
constexpr Duration kMocapSummaryPeriod = 10s;

std::string summary(const MocapReport& report) {
  return fmt::format(
      "{} datagrams, {} states, {} obstacle messages, {} obstacles in the newest; {} bodies passed over, {} "
      "jumps; refused: {}",
      report.datagrams, report.states, report.obstacle_messages, report.obstacles, report.passed_over, report.jumps,
      list_counts<MocapRefusal>(kNumMocapRefusals,
                                [&](MocapRefusal reason) { return report.refused[static_cast<std::size_t>(reason)]; }));
}

}  // namespace

std::vector<LogLine> MocapLog::update(Utime now, const MocapReport& report) {
  std::vector<LogLine> lines;
  const bool heard = report.heard_utime && std::chrono::abs(now - *report.heard_utime) < kMocapSilence;
  if (heard && !heard_) add_line(&lines, false, "motion capture is heard");
  if (!heard && heard_) add_line(&lines, true, "motion capture is silent");
  heard_ = heard;
  if (report.obstacles != obstacles_) add_line(&lines, false, fmt::format("{} obstacles", report.obstacles));
  obstacles_ = report.obstacles;
  const std::int64_t refused = std::accumulate(report.refused.begin(), report.refused.end(), std::int64_t{0});
  if (refused != refused_ && now >= refusal_.due(now, kRefusalPeriod)) {
    add_line(&lines, true, fmt::format("{} datagrams refused; the newest: {}", refused - refused_, report.words));
    refused_ = refused;
    refusal_.done(now);
  }
  if (!summary_) summary_.emplace().done(now);
  if (now >= summary_->due(now, kMocapSummaryPeriod)) {
    add_line(&lines, false, summary(report));
    summary_->done(now);
  }
  return lines;
}

}  // namespace swarm
