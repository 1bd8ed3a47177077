#include "swarm_sim/campaign/trial.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "lcmtypes/bus/text.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"

namespace swarm {
namespace {

// A cell of the table: empty where it is not known.
std::string cell_of(double value, int decimals) {
  return fixed(value, decimals, "");
}

// robot 1-obstacle 5@3.21; robot 0-robot 2@4.00
std::string touches(const RunReport& report) {
  std::string text;
  for (const Touch& touch : report.touches) {
    text.append(text.empty() ? "" : "; ").append("robot ").append(std::to_string(touch.robot)).append("-");
    text.append(to_string(touch.counterpart));
    if (touch.other >= 0) text.append(" ").append(std::to_string(touch.other));
    text.append("@").append(cell_of(touch.t_s, 2));
  }
  return text;
}

}  // namespace

Trial seeded_trial(const std::string& task, const std::string& environment, int obstacles, int seed,
                   const Fleet& fleet) {
  Trial trial;
  trial.name = task + "-" + environment + "-" + std::to_string(obstacles) + "-" + std::to_string(seed);
  trial.task = task;
  trial.environment = environment;
  trial.obstacles = obstacles;
  trial.seed = std::to_string(seed);
  trial.fleet = fleet;
  return trial;
}

Trial listed_trial(const std::string& text, const std::string& list_at) {
  Trial trial;
  trial.name = trial.list_at = list_at;
  trial.world_text = text;
  const World world = trial.world();
  trial.task = world.name;
  trial.obstacles = static_cast<int>(world.obstacles.size());
  const std::vector<std::string> parts = split(world.name, '-');
  try {
    if (parts.size() != 4 || parts[3].empty() || parts[3].find_first_not_of("0123456789") != std::string::npos)
      return trial;
    (void)task_from(parts[0]);
    (void)environment_from(parts[1]);
    trial.task = parts[0];
    trial.environment = parts[1];
    trial.seed = parts[3];
  } catch (const WorldError&) {  // some other name
  }
  return trial;
}

World Trial::world() const {
  if (!list_at.empty())
    return parse_world(world_text, list_at, std::filesystem::path(list_at.substr(0, list_at.rfind(':'))).parent_path());
  return make_world(task_from(task), environment_from(environment), obstacles, std::stoull(seed), fleet);
}

std::string Trial::command(const FlightArguments& arguments) const {
  if (!list_at.empty()) return "swarm_sim run " + quoted(list_at) + " --out trial" + command_line(arguments);
  return "swarm_sim world --task " + task + " --env " + environment + " --obstacles " + std::to_string(obstacles) +
         " --seed " + seed + command_line(fleet) + " -o trial.json && swarm_sim run trial.json --out trial" +
         command_line(arguments);
}

const std::vector<std::string>& trial_columns() {
  static const std::vector<std::string> kColumns = [] {
    std::vector<std::string> columns = {"trial",
                                        "task",
                                        "env",
                                        "obstacles",
                                        "seed",
                                        "outcome",
                                        "touches",
                                        "paper_outcome",
                                        "commit_conflicts",
                                        "forced_commits",
                                        "forced_conflicts",
                                        "last_arrival_s",
                                        "mean_flight_s",
                                        "to_obstacles_m",
                                        "to_static_map_m",
                                        "to_robots_m",
                                        "tracking_p99_m",
                                        "max_speed_ratio",
                                        "max_acceleration_ratio",
                                        "max_position_jump_m",
                                        "max_acceleration_step_mps2",
                                        "plans"};
    for (const char* step : kPlanningSteps) {
      for (const char* statistic : {"mean", "p50", "p95", "p99", "max"})
        columns.push_back(std::string(step) + "_" + statistic + "_ms");
    }
    columns.insert(columns.end(), {"map_p50_ms", "map_p99_ms", "commit_p50_ms", "commit_p99_ms", "sent_hz",
                                   "received_hz", "datagram_bytes"});
    for (const double rate_mbps : kAirRates_mbps) {
      columns.push_back("airtime_" + fixed(rate_mbps, 0) + "mbps");
      columns.push_back("busiest_airtime_" + fixed(rate_mbps, 0) + "mbps");
    }
    columns.insert(columns.end(), {"collided_share", "dropped_share", "duration_s", "wall_s", "command"});
    return columns;
  }();
  return kColumns;
}

TrialRow trial_row(const Trial& trial, const World& world, const RunReport& report, const std::string& command) {
  double last_s = 0.0, sum_s = 0.0, tracking_m = 0.0, speed = 0.0, acceleration = 0.0, jump_m = 0.0, step_mps2 = 0.0;
  double sent_hz = 0.0, received_hz = 0.0;
  double obstacles_m = INFINITY, static_m = INFINITY, robots_m = INFINITY;
  std::int64_t plans = 0;
  for (std::size_t i = 0; i < report.robots.size(); ++i) {
    const RobotReport& robot = report.robots[i];
    const RobotVerdict& verdict = robot.verdict;
    const MotionLimits& limits = limits_of(world, world.robots[i]);
    const double flight_s = verdict.flight_time_s.value_or(INFINITY);
    last_s = std::max(last_s, flight_s);
    sum_s += flight_s;
    obstacles_m = std::min(obstacles_m, verdict.to_obstacles.distance_m);
    static_m = std::min(static_m, verdict.to_static_map.distance_m);
    robots_m = std::min(robots_m, verdict.to_robots.distance_m);
    tracking_m = std::max(tracking_m, robot.tracking.p99_m);
    speed = std::max(speed, verdict.max_speed_mps.maxCoeff() / limits.v_max_mps);
    acceleration = std::max(acceleration, verdict.max_acceleration_mps2.cwiseQuotient(limits.axis_mps2()).maxCoeff());
    jump_m = std::max(jump_m, verdict.max_position_jump_m);
    step_mps2 = std::max(step_mps2, verdict.max_acceleration_step_mps2);
    plans += robot.plans;
    sent_hz += robot.sent_hz;
    received_hz += robot.received_hz;
  }
  const auto robots = static_cast<double>(report.robots.size());
  TrialRow row = {trial.name,
                  trial.task,
                  trial.environment,
                  std::to_string(trial.obstacles),
                  trial.seed,
                  to_string(report.outcome),
                  touches(report),
                  to_string(report.paper_outcome),
                  std::to_string(report.commit_conflicts),
                  std::to_string(report.forced_commits),
                  std::to_string(report.forced_conflicts),
                  cell_of(last_s, 2),
                  cell_of(sum_s / robots, 3),
                  cell_of(obstacles_m, 4),
                  cell_of(static_m, 4),
                  cell_of(robots_m, 4),
                  cell_of(tracking_m, 4),
                  cell_of(speed, 5),
                  cell_of(acceleration, 5),
                  cell_of(jump_m, 7),
                  cell_of(step_mps2, 4),
                  std::to_string(plans)};
  for (const TimingStats& step : report.planning) {
    for (const double ms : {step.mean_ms, step.p50_ms, step.p95_ms, step.p99_ms, step.max_ms})
      row.push_back(cell_of(ms, 4));
  }
  row.insert(row.end(),
             {cell_of(report.mapping.p50_ms, 4), cell_of(report.mapping.p99_ms, 4), cell_of(report.commit.p50_ms, 3),
              cell_of(report.commit.p99_ms, 3), cell_of(sent_hz / robots, 2), cell_of(received_hz / robots, 2),
              cell_of(report.air.datagram_bytes, 1)});
  for (const Airtime& airtime : report.air.airtime) {
    row.push_back(cell_of(airtime.mean, 4));
    row.push_back(cell_of(airtime.busiest_second, 4));
  }
  const std::optional<RadioCounts>& radio = report.air.radio;
  row.insert(row.end(),
             {cell_of(radio ? radio->collided_share() : NAN, 4), cell_of(radio ? radio->dropped_share() : NAN, 4),
              cell_of(report.duration_s, 2), cell_of(report.wall_s, 3), command});
  return row;
}

const std::string& cell(const TrialRow& row, const std::string& column) {
  const auto& columns = trial_columns();
  const auto found = std::ranges::find(columns, column);
  if (found == columns.end()) throw std::out_of_range("no column " + column);
  return row.at(static_cast<std::size_t>(found - columns.begin()));
}

}  // namespace swarm
