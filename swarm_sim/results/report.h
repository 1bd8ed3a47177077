// report.json and the table on the terminal: what came of a run.
//
// The room results/ holds what a flight leaves behind: trace, logs of the buses, audit of what was committed, report.
// It reads the judge's verdict, so it stands on environment/; the hosts feed it.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/timing_stats.h"
#include "swarm_sim/environment/simulation.h"
#include "swarm_sim/results/air_traffic.h"
#include "swarm_sim/results/commit_audit.h"

namespace swarm {

// The steps of one plan, all of them, and what is worked out until the next one; in the order of RunReport::planning.
inline constexpr std::array<const char*, 7> kPlanningSteps = {"compose", "search", "corridor", "optimize",
                                                              "check",   "total",  "prepare"};

// Durations of every plan of one robot [ms], by step.
using PlanningSamples = std::array<std::vector<double>, kPlanningSteps.size()>;

struct ChannelCount {
  std::int64_t messages = 0;  // sent
  std::int64_t bytes = 0;     // sent
  std::int64_t lost = 0;      // deliveries that did not take place
};

// A share of the time; above 1 where more is sent than fits.
struct Airtime {
  double mean = 0.0, busiest_second = 0.0;  // over the flight; of its seconds from the start on
};

// What crossed the air, or would have, of all robots; see air_traffic.h.
struct AirReport {
  std::int64_t datagrams = 0;   // sent
  double datagram_bytes = 0.0;  // mean, with UDP header and seal
  std::array<Airtime, kAirRates_mbps.size()> airtime{};
  std::optional<RadioCounts> radio{};  // where the channel was modelled
};

// How far a robot was from where it was told to be.
struct TrackingError {
  double p50_m = 0.0, p99_m = 0.0, max_m = 0.0;
};

struct RobotReport {
  RobotVerdict verdict;
  TrackingError tracking;
  bool is_unreachable = false;  // the goal, as the planner said last
  std::int64_t plans = 0;
  double plan_rate_hz = 0.0;
  std::int64_t missed = 0;                                // maps that arrived while no plan could start in time
  double sent_hz = 0.0;                                   // datagrams to other robots
  double received_hz = NAN;                               // datagrams from other robots; not finite: not measured
  double datagram_bytes = 0.0;                            // mean of those sent, with UDP header and seal
  std::array<std::int64_t, kNumRefusals> refused{};       // by all daemons of the robot, by reason
  std::vector<std::pair<std::string, double>> processor;  // share of a core, by daemon; nothing in lock-step
};

struct RunReport {
  std::string world;
  std::string mode;                                          // lockstep, processes
  std::vector<std::pair<std::string, std::string>> options;  // in the order to be shown
  Outcome outcome = Outcome::kTimeout;
  Outcome paper_outcome = Outcome::kTimeout;  // as the paper splits failures: see paper_outcome_of()
  double duration_s = 0.0;                    // simulated
  double wall_s = 0.0;                        // spent on it
  std::vector<Touch> touches;
  std::int64_t commit_conflicts = 0;  // committed motions that meet though nobody was forced; see commit_audit.h
  std::int64_t forced_commits = 0;    // without everybody's word, before an impact; see commit_protocol.h
  std::int64_t forced_conflicts = 0;  // of these, with others
  std::vector<RobotReport> robots;
  std::array<TimingStats, kPlanningSteps.size()> planning;  // over all robots
  TimingStats mapping;                                      // building and encoding a SOGM; nothing in processes
  TimingStats commit;                                       // of trajectories, see CommitAudit::delays_ms()
  AirReport air;
  std::map<std::string, ChannelCount> channels;

  void count_commits(const CommitAudit& audit);
};

// What every host reports the same way: the judge's view and the planning times over all robots. `robots`, in the
// world's order: what the hosts have counted; verdicts, tracking and rates join it.
RunReport make_report(const std::string& mode, const Simulation& simulation, double wall_s,
                      const std::vector<PlanningSamples>& planning, std::vector<RobotReport> robots);

// The paper's split: success; deadlock, where a robot that had stopped for want of a plan was hit, or did
// not arrive; collision, where one flew into something. By the first touch.
Outcome paper_outcome_of(Outcome outcome, const std::vector<Touch>& touches);

// Keys in a fixed order; what was never measured is null.
nlohmann::ordered_json to_json(const RunReport& report);

// Writes report.json whole or not at all. Throws std::runtime_error with path and reason.
void write_report(const RunReport& report, const std::filesystem::path& path);

// "robot 1 touched obstacle 3 at 4.20 s".
std::string line_of(const Touch& touch);

// A small aligned table: outcome, a line per robot, planning times, airtime.
std::string summary_table(const RunReport& report);

}  // namespace swarm
