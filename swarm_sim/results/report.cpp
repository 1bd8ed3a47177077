#include "swarm_sim/results/report.h"

#include <algorithm>
#include <cmath>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

using nlohmann::ordered_json;

ordered_json array(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

ordered_json to_json(const TimingStats& s) {
  return {{"count", s.count}, {"mean", s.mean_ms}, {"p50", s.p50_ms},
          {"p95", s.p95_ms},  {"p99", s.p99_ms},   {"max", s.max_ms}};
}

ordered_json to_json(const Touch& touch) {
  return {{"t", touch.t_s},       {"robot", touch.robot},         {"counterpart", to_string(touch.counterpart)},
          {"other", touch.other}, {"distance", touch.distance_m}, {"at_rest", touch.at_rest}};
}

ordered_json to_json(const Clearance& clearance) {
  if (!std::isfinite(clearance.distance_m)) return nullptr;
  return {{"distance", clearance.distance_m}, {"t", clearance.t_s}, {"other", clearance.other}};
}

ordered_json to_json(const RobotReport& robot) {
  const RobotVerdict& verdict = robot.verdict;
  ordered_json refused = ordered_json::object();  // only what happened
  for (int i = 0; i < kNumRefusals; ++i) {
    if (robot.refused[static_cast<std::size_t>(i)] != 0)
      refused[to_string(static_cast<Refusal>(i))] = robot.refused[static_cast<std::size_t>(i)];
  }
  ordered_json processor = ordered_json::object();
  for (const auto& [daemon, share] : robot.processor) processor[daemon] = share;
  return {
      {"id", verdict.id},
      {"flight_time", verdict.flight_time_s ? ordered_json(*verdict.flight_time_s) : ordered_json()},
      {"goals_reached", verdict.goals_reached},
      {"unreachable", robot.is_unreachable},
      {"clearance",
       {{"obstacles", to_json(verdict.to_obstacles)},
        {"static_map", to_json(verdict.to_static_map)},
        {"robots", to_json(verdict.to_robots)}}},
      {"tracking_error", {{"p50", robot.tracking.p50_m}, {"p99", robot.tracking.p99_m}, {"max", robot.tracking.max_m}}},
      {"path_length", verdict.path_length_m},
      {"max_speed", array(verdict.max_speed_mps)},
      {"max_acceleration", array(verdict.max_acceleration_mps2)},
      {"max_position_jump", verdict.max_position_jump_m},
      {"max_acceleration_step", verdict.max_acceleration_step_mps2},
      {"plans", robot.plans},
      {"plan_rate_hz", robot.plan_rate_hz},
      {"missed", robot.missed},
      {"sent_hz", robot.sent_hz},
      {"received_hz", std::isfinite(robot.received_hz) ? ordered_json(robot.received_hz) : ordered_json()},
      {"datagram_bytes", robot.datagram_bytes},
      {"processor", processor.empty() ? ordered_json(nullptr) : processor},
      {"refused", refused}};
}

ordered_json to_json(const AirReport& air) {
  ordered_json airtime = ordered_json::array();
  for (std::size_t i = 0; i < air.airtime.size(); ++i) {
    airtime.push_back({{"rate_mbps", kAirRates_mbps[i]},
                       {"share", air.airtime[i].mean},
                       {"busiest_second", air.airtime[i].busiest_second}});
  }
  ordered_json radio;
  if (air.radio)
    radio = {{"sent", air.radio->sent}, {"collided", air.radio->collided}, {"dropped", air.radio->dropped}};
  return {{"datagrams", air.datagrams}, {"datagram_bytes", air.datagram_bytes}, {"airtime", airtime}, {"radio", radio}};
}

std::vector<std::vector<std::string>> airtime_rows(const AirReport& air) {
  std::vector<std::vector<std::string>> rows = {{"airtime %", "mean", "busiest second"}};
  for (std::size_t i = 0; i < air.airtime.size(); ++i) {
    rows.push_back({"at " + fixed(kAirRates_mbps[i], 0) + " Mbit/s", fixed(100 * air.airtime[i].mean, 1),
                    fixed(100 * air.airtime[i].busiest_second, 1)});
  }
  return rows;
}

// What each daemon takes of a core, and all of a robot; nothing where that was not measured.
std::vector<std::vector<std::string>> processor_rows(const RunReport& report) {
  std::vector<std::vector<std::string>> rows;
  for (const RobotReport& robot : report.robots) {
    if (robot.processor.empty()) continue;
    if (rows.empty()) {
      rows = {{"% of a core"}};
      for (const auto& [daemon, share] : robot.processor) rows.front().push_back(daemon);
      rows.front().emplace_back("all");
    }
    std::vector<std::string>& row = rows.emplace_back(1, "robot " + std::to_string(robot.verdict.id));
    double sum = 0.0;
    for (const auto& [daemon, share] : robot.processor) {
      row.push_back(fixed(100 * share, 2));
      sum += share;
    }
    row.push_back(fixed(100 * sum, 2));
  }
  return rows;
}

std::vector<std::string> timing_row(const char* name, const TimingStats& s) {
  std::vector<std::string> row = {name};
  for (const double ms : {s.mean_ms, s.p50_ms, s.p95_ms, s.p99_ms, s.max_ms}) row.push_back(fixed(ms, 3));
  return row;
}

TrackingError tracking_error(const std::vector<double>& errors_m) {
  const TimingStats stats = timing_stats(errors_m);
  return {stats.p50_ms, stats.p99_ms, stats.max_ms};
}

template <class Item>
ordered_json list(const std::vector<Item>& items) {
  ordered_json json = ordered_json::array();
  for (const Item& item : items) json.push_back(to_json(item));
  return json;
}

}  // namespace

RunReport make_report(const std::string& mode, const Simulation& simulation, double wall_s,
                      const std::vector<PlanningSamples>& planning, std::vector<RobotReport> robots) {
  const Judge& judge = simulation.judge();
  RunReport report;
  report.world = simulation.world().name;
  report.mode = mode;
  report.touches = judge.touches();
  report.duration_s = simulation.t_s(simulation.now());
  report.wall_s = wall_s;
  report.robots = std::move(robots);
  for (std::size_t i = 0; i < report.robots.size(); ++i) {
    report.robots[i].verdict = judge.robots()[i];
    report.robots[i].tracking = tracking_error(simulation.tracking_m()[i]);
    report.robots[i].plan_rate_hz = static_cast<double>(report.robots[i].plans) / report.duration_s;
  }
  report.outcome = judge.outcome();
  const bool is_stuck = report.outcome == Outcome::kDeadlock || report.outcome == Outcome::kTimeout;
  const bool is_unreachable = std::ranges::any_of(
      report.robots, [](const RobotReport& robot) { return robot.is_unreachable && !robot.verdict.flight_time_s; });
  if (is_stuck && is_unreachable) report.outcome = Outcome::kUnreachable;
  report.paper_outcome = paper_outcome_of(report.outcome, report.touches);
  for (std::size_t step = 0; step < kPlanningSteps.size(); ++step) {
    std::vector<double> all;
    for (const PlanningSamples& robot : planning) all.insert(all.end(), robot[step].begin(), robot[step].end());
    report.planning[step] = timing_stats(std::move(all));
  }
  return report;
}

Outcome paper_outcome_of(Outcome outcome, const std::vector<Touch>& touches) {
  if (outcome == Outcome::kSuccess) return outcome;
  if (touches.empty()) return Outcome::kDeadlock;
  return touches.front().at_rest && touches.front().counterpart == Counterpart::kObstacle ? Outcome::kDeadlock
                                                                                          : Outcome::kCollision;
}

void RunReport::count_commits(const CommitAudit& audit) {
  commit = timing_stats(audit.delays_ms());
  forced_commits = audit.forced();
  forced_conflicts = std::ranges::count(audit.conflicts(), true, &CommitConflict::forced);
  commit_conflicts = static_cast<std::int64_t>(audit.conflicts().size()) - forced_conflicts;
}

ordered_json to_json(const RunReport& report) {
  ordered_json options = ordered_json::object(), planning = ordered_json::object(), channels = ordered_json::object();
  for (const auto& [name, value] : report.options) options[name] = value;
  for (std::size_t i = 0; i < kPlanningSteps.size(); ++i) planning[kPlanningSteps[i]] = to_json(report.planning[i]);
  for (const auto& [name, count] : report.channels)
    channels[name] = {{"messages", count.messages}, {"bytes", count.bytes}, {"lost", count.lost}};
  return {{"world", report.world},
          {"mode", report.mode},
          {"options", options},
          {"outcome", to_string(report.outcome)},
          {"paper_outcome", to_string(report.paper_outcome)},
          {"duration", report.duration_s},
          {"wall", report.wall_s},
          {"touches", list(report.touches)},
          {"commit_conflicts", report.commit_conflicts},
          {"forced_commits", report.forced_commits},
          {"forced_conflicts", report.forced_conflicts},
          {"robots", list(report.robots)},
          {"planning_ms", planning},
          {"mapping_ms", report.mapping.count > 0 ? to_json(report.mapping) : ordered_json(nullptr)},
          {"commit_ms", to_json(report.commit)},
          {"air", to_json(report.air)},
          {"channels", channels}};
}

void write_report(const RunReport& report, const std::filesystem::path& path) {
  write_file(path, to_json(report).dump(1, ' ', false, ordered_json::error_handler_t::replace) + "\n");
}

std::string line_of(const Touch& touch) {
  return "robot " + std::to_string(touch.robot) + (touch.at_rest ? ", at rest," : "") + " touched " +
         to_string(touch.counterpart) + (touch.other < 0 ? "" : " " + std::to_string(touch.other)) + " at " +
         fixed(touch.t_s, 2) + " s";
}

std::string summary_table(const RunReport& report) {
  std::string text = report.world + ": " + to_string(report.outcome) + " after " + fixed(report.duration_s, 2) +
                     " s (" + report.mode + ", " + fixed(report.wall_s, 2) + " s of wall time)\n";
  if (report.commit_conflicts > 0)
    text.append("  committed trajectories that meet: ").append(std::to_string(report.commit_conflicts)).append("\n");
  if (report.forced_commits > 0)
    text.append("  trajectories forced before an impact: ")
        .append(std::to_string(report.forced_commits))
        .append(", of which meet others: ")
        .append(std::to_string(report.forced_conflicts))
        .append("\n");
  for (const Touch& touch : report.touches) text.append("  ").append(line_of(touch)).append("\n");
  for (const RobotReport& robot : report.robots) {
    if (!robot.is_unreachable || robot.verdict.flight_time_s) continue;
    text.append("  robot ").append(std::to_string(robot.verdict.id)).append(": no way leads to its goal\n");
  }
  std::vector<std::vector<std::string>> rows = {{"robot", "flight s", "to obstacles m", "to static m", "to robots m",
                                                 "path m", "plans", "plans/s", "missed", "sent/s", "heard/s", "bytes"}};
  for (const RobotReport& robot : report.robots) {
    const RobotVerdict& v = robot.verdict;
    rows.push_back({std::to_string(v.id), fixed(v.flight_time_s.value_or(INFINITY), 2),
                    fixed(v.to_obstacles.distance_m, 3), fixed(v.to_static_map.distance_m, 3),
                    fixed(v.to_robots.distance_m, 3), fixed(v.path_length_m, 2), std::to_string(robot.plans),
                    fixed(robot.plan_rate_hz, 1), std::to_string(robot.missed), fixed(robot.sent_hz, 1),
                    fixed(robot.received_hz, 1), fixed(robot.datagram_bytes, 0)});
  }
  text += aligned(rows);
  rows = {{"planning ms", "mean", "p50", "p95", "p99", "max"}};
  for (std::size_t i = 0; i < kPlanningSteps.size(); ++i)
    rows.push_back(timing_row(kPlanningSteps[i], report.planning[i]));
  rows.push_back(timing_row("commit", report.commit));
  text += aligned(rows) + aligned(airtime_rows(report.air));
  if (const auto& radio = report.air.radio) {
    text.append("  lost in collisions ").append(fixed(100 * radio->collided_share(), 1));
    text.append(" %, in queues ").append(fixed(100 * radio->dropped_share(), 1)).append(" %\n");
  }
  rows = processor_rows(report);
  return rows.empty() ? text : text + aligned(rows);
}

}  // namespace swarm
