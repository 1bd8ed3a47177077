#include "tools/bridge/mocap_log.h"

#include <spdlog/fmt/fmt.h>

#include <numeric>

namespace swarm {
namespace {

constexpr std::int64_t kSecond_us = 1'000'000;
constexpr std::int64_t kSummaryPeriod_us = 10 * kSecond_us;

std::string summary(const MocapReport& report) {
  return fmt::format(
      "{} datagrams, {} states, {} obstacle messages, {} obstacles in the newest; {} bodies passed over, {} "
      "jumps; refused: {}",
      report.datagrams, report.states, report.obstacle_messages, report.obstacles, report.passed_over, report.jumps,
      list_counts<MocapRefusal>(kNumMocapRefusals,
                                [&](MocapRefusal reason) { return report.refused[static_cast<std::size_t>(reason)]; }));
}

}  // namespace

std::vector<LogLine> MocapLog::update(std::int64_t now_us, const MocapReport& report) {
  std::vector<LogLine> lines;
  const bool heard = report.heard_us && now_us - *report.heard_us < kSecond_us;
  if (heard && !heard_) add_line(&lines, false, "motion capture is heard");
  if (!heard && heard_) add_line(&lines, true, "motion capture is silent");
  heard_ = heard;
  if (report.obstacles != obstacles_) add_line(&lines, false, fmt::format("{} obstacles", report.obstacles));
  obstacles_ = report.obstacles;
  const std::int64_t refused = std::accumulate(report.refused.begin(), report.refused.end(), std::int64_t{0});
  if (refused != refused_ && now_us >= next_refusal_us_.value_or(now_us)) {
    add_line(&lines, true, fmt::format("{} datagrams refused; the newest: {}", refused - refused_, report.words));
    refused_ = refused;
    next_refusal_us_ = now_us + kSecond_us;
  }
  if (!next_summary_us_) next_summary_us_ = now_us + kSummaryPeriod_us;
  if (now_us >= *next_summary_us_) {
    add_line(&lines, false, summary(report));
    next_summary_us_ = now_us + kSummaryPeriod_us;
  }
  return lines;
}

}  // namespace swarm
