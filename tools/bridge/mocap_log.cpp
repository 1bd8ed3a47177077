#include "tools/bridge/mocap_log.h"

#include <spdlog/fmt/fmt.h>

#include <cstdlib>
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
  const bool heard = report.heard_us && std::abs(now_us - *report.heard_us) < kSecond_us;
  if (heard && !heard_) add_line(&lines, false, "motion capture is heard");
  if (!heard && heard_) add_line(&lines, true, "motion capture is silent");
  heard_ = heard;
  if (report.obstacles != obstacles_) add_line(&lines, false, fmt::format("{} obstacles", report.obstacles));
  obstacles_ = report.obstacles;
  const std::int64_t refused = std::accumulate(report.refused.begin(), report.refused.end(), std::int64_t{0});
  if (refused != refused_ && now_us >= refusal_.due_us(now_us, kSecond_us)) {
    add_line(&lines, true, fmt::format("{} datagrams refused; the newest: {}", refused - refused_, report.words));
    refused_ = refused;
    refusal_.done(now_us);
  }
  if (!summary_) summary_.emplace().done(now_us);
  if (now_us >= summary_->due_us(now_us, kSummaryPeriod_us)) {
    add_line(&lines, false, summary(report));
    summary_->done(now_us);
  }
  return lines;
}

}  // namespace swarm
