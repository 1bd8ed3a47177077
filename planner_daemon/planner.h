// The planner: the paper's pipeline, one call per plan. Value types in, a result out; no clock, no messages.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "map_daemon/sogm.h"
#include "planner_daemon/corridor/corridor.h"
#include "planner_daemon/optimize/spline_qp.h"
#include "planner_daemon/search/kinodynamic_search.h"
#include "planner_daemon/space/configuration_space.h"
#include "planner_daemon/trajectory/trajectory.h"

namespace swarm {

struct PlannerConfig {
  ZoneOptions zones;
  SearchLimits limits;  // flight space: of the robot's centre
  SearchOptions search;
  CorridorOptions corridor;
};

struct PlanRequest {
  const Sogm* sogm = nullptr;    // obstacles only, not dilated
  Motion own;                    // what this robot is bound to
  std::int64_t start_utime = 0;  // the plan leaves the own motion here
  Eigen::Vector3d goal = Eigen::Vector3d::Zero();
  const std::vector<Peer>* peers = nullptr;
};

enum class PlanOutcome {
  kSmooth,  // the optimised trajectory
  kRaw,     // the search's own path: smoothing was not possible or not safe
  kUnsafe,  // nothing free: the motion that comes least near, in pieces of half the duration or as already flown
};
const char* to_string(PlanOutcome outcome);

enum class PlanStep { kCompose, kSearch, kCorridor, kOptimize, kCheck };
inline constexpr int kNumPlanSteps = 5;
const char* to_string(PlanStep step);

struct PlanResult {
  PlanOutcome outcome = PlanOutcome::kUnsafe;
  bool fly = false;                 // false: keep the own motion, it is the better one
  Trajectory trajectory;            // seq 0: the caller numbers it
  std::vector<Polytope> corridors;  // one per piece that was smoothed; bound the robot's centre
  SearchStatus search_status = SearchStatus::kPartial;
  int expansions = 0;
  std::array<double, kNumPlanSteps> step_ms{};  // wall time; 0 without a stopwatch
};

class Planner {
 public:
  static constexpr double kUsableSpeed = 0.995;  // of v_max

  using Stopwatch = std::function<std::int64_t()>;  // monotonic [ns]; may be null

  // Throws std::invalid_argument with name, value and rule.
  explicit Planner(const PlannerConfig& config, Stopwatch stopwatch = nullptr);

  const PlanResult& plan(const PlanRequest& request);

  // Of the newest plan, for benchmarks: what was searched, the path found, what was optimised.
  const SearchProblem& search_problem() const { return search_problem_; }
  const SearchResult& path() const { return path_; }
  const Occupancy& occupancy() const { return zones_.occupancy(); }
  void build_cost_to_go(const PlanRequest& request);  // a part of some plans' searches: again
  const SplineProblem& spline_problem() const { return problem_; }

 private:
  void compose(const PlanRequest& request);
  SearchStatus search(const PlanRequest& request);
  bool grow_corridors(const PlanRequest& request);
  bool optimize(const PlanRequest& request, Trajectory* smooth);
  void check(const PlanRequest& request, bool smoothed, const Trajectory& smooth);
  Trajectory raw_trajectory(const SearchResult& path, std::int32_t piece_us, std::int64_t start_utime) const;
  bool within_limits(const Trajectory& trajectory) const;
  void lap(PlanStep step);

  PlannerConfig config_;
  Stopwatch stopwatch_;
  std::int64_t lap_ns_ = 0;
  CostToGo cost_to_go_;
  KinodynamicSearch search_, quick_search_;
  std::int32_t quick_piece_us_;
  bool looks_finer_ = false;  // the newest search got stuck: the next one takes finer steps
  bool keeps_own_ = false;    // the search got stuck, and the own motion ends nearer to the goal
  bool in_danger_ = false;    // starts in blocked space, or nothing survives
  CorridorBuilder corridors_;
  std::vector<SplineQp> optimizers_;  // [n - 1]: for n pieces
  SplineProblem problem_;
  SplineSolution solution_;
  Reach reach_;  // of the robot: all that the plan can touch
  Zones zones_;
  // What looks far ahead serves several plans: made from which map, to which goal.
  struct Made {
    std::int64_t utime = 0;
    Eigen::Vector3i size = Eigen::Vector3i::Zero();  // of the window [voxels]
    double resolution_m = 0.0;
    Eigen::Vector3d goal = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());

    bool serves(const PlanRequest& request, std::int64_t longest_us) const;
  };
  static Made made_for(const PlanRequest& request);
  Guidance guidance_;
  bool is_guided_ = false;
  Made guidance_made_, cost_to_go_made_;
  SearchProblem search_problem_;  // refers to the zones and the cost to go
  SearchResult path_, other_path_, quick_path_;
  PlanResult result_;
};

}  // namespace swarm
