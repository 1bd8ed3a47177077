// The planner: the paper's pipeline, one call per plan. Value types in, a result out; no clock, no messages.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "lcmtypes/bus/node_clock.h"
#include "map_daemon/sogm.h"
#include "planner_daemon/candidate.h"
#include "planner_daemon/corridor/corridor.h"
#include "planner_daemon/guidance/guidance.h"
#include "planner_daemon/optimize/spline_qp.h"
#include "planner_daemon/search/escape.h"
#include "planner_daemon/search/kinodynamic_search.h"
#include "planner_daemon/search/local_minimum.h"
#include "planner_daemon/search/static_heuristic.h"
#include "planner_daemon/space/configuration_space.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

struct PlannerConfig {
  ConfigurationSpaceOptions space;
  SearchLimits limits;  // flight space: of the robot's centre
  SearchOptions search;
  std::string static_map;  // OctoMap file; empty: none
  bool explores = true;    // what is seen to stand is a building, see GlobalMap
  CorridorOptions corridor;
};

struct PlanRequest {
  const Sogm* sogm = nullptr;  // obstacles only, not dilated
  Motion own;                  // what this robot is bound to
  Utime start_utime{};         // the plan leaves the own motion here
  Eigen::Vector3d goal = Eigen::Vector3d::Zero();
  double v_max_mps = std::numeric_limits<double>::infinity();  // per axis, where the limits allow more
  double margin_m = 0.0;  // kept beyond the clearance: so far from its motion the robot may be
  bool is_aside = false;  // the goal is a place nearby beside the way: the way through the whole map stays as it is
  const std::vector<Peer>* peers = nullptr;
  const Sogm* seen = nullptr;  // a SEEN_SPACE: ways may lead through what was not seen, plans not. Null: all was
};

enum class PlanOutcome {
  kSmooth,  // the optimised trajectory
  kRaw,     // the search's own path: smoothing was not possible or not safe
  kUnsafe,  // nothing free: the searched path as far as it goes, an escape in pieces of half the duration, or the own
            // motion
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
  bool is_unreachable = false;                  // the goal, see Guidance
  std::array<double, kNumPlanSteps> step_ms{};  // wall time; 0 without a stopwatch
  double prepare_ms = 0.0;                      // wall time of what was prepared for it since the plan before

  double total_ms() const { return std::accumulate(step_ms.begin(), step_ms.end(), 0.0); }
};

class Planner {
 public:
  static constexpr double kUsableSpeed = 0.995;  // of v_max
  // Jerk counts little in the near pieces: only the beginning of a plan is flown before the next one, and with equal
  // weights every plan would put off what can be put off.
  static double jerk_weight(int piece) { return std::min(1.0, 0.1 * std::pow(3.0, piece)); }

  // Throws std::invalid_argument with name, value and rule, and what GlobalMap throws.
  explicit Planner(const PlannerConfig& config, Stopwatch stopwatch = nullptr);

  const PlanResult& plan(const PlanRequest& request);
  // What may wait until the newest plan is out: what looks far ahead is worked out for the next ones, from that plan's
  // request. Where nobody calls it, plans do so themselves when it is due.
  void prepare(const PlanRequest& request);
  // The same from a newer map than the newest plan's, while nothing asks for a plan: the next one will come late.
  void prepare_meanwhile(const PlanRequest& request);
  // All that plans leave to later ones, but for memory.
  void forget();
  // Whether ways to the request's goal are known. A plan that must work them out first takes many times as long.
  bool knows_ways(const PlanRequest& request) const { return static_key_.goal == request.goal; }
  void work_out_ways(const PlanRequest& request);
  // Whether a plan takes several times as long as other plans: its heuristics are to be built anew.
  bool is_slow(const PlanRequest& request) const;

  // The static way from where the newest plan began to the request's goal; none: no plan to it knows one, or nothing
  // stands around.
  std::optional<double> way_m(const PlanRequest& request) const;
  // Where the robot goes back to from where its own motion ends, to let `met` pass, which is somewhere else, by ways
  // not past where that is now: at least `apart_m` beside the longest of these in sight, or to its end. None: nowhere.
  std::optional<StaticHeuristic::Refuge> refuge(const PlanRequest& request, const Peer& met, double apart_m);

  // Of the newest plan, for benchmarks: what was searched, the path found, what was optimised.
  const SearchProblem& search_problem() const { return search_problem_; }
  const SearchResult& path() const { return path_; }
  const Occupancy& occupancy() const { return space_.occupancy(); }
  void build_heuristics(const PlanRequest& request);  // a part of some plans' searches: again
  const SplineProblem& spline_problem() const { return spline_problem_; }

 private:
  // What looks far ahead serves several plans: made from which map, to which goal.
  struct CacheKey {
    Utime utime{};
    Eigen::Vector3i size = Eigen::Vector3i::Zero();  // of the window [voxels]
    double resolution_m = 0.0;
    Eigen::Vector3d goal = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    double v_max_mps = 0.0;

    bool serves(const PlanRequest& request, Duration longest) const;
  };
  static CacheKey cache_key(const PlanRequest& request);
  double v_max_mps(const PlanRequest& request) const { return std::min(config_.limits.v_max_mps, request.v_max_mps); }

  void compose(const PlanRequest& request);
  Duration static_heuristic_age(const PlanRequest& request) const;           // so long it serves
  bool static_heuristic_ages(const PlanRequest& request, int tenths) const;  // it has served for so much of that
  // And what is known to stand where it is not seen.
  Occupancy compose_standing(const std::vector<Peer>& peers);
  void renew_static_heuristic(const PlanRequest& request);
  SearchStatus search(const PlanRequest& request);
  // Where a robot in a local minimum goes next: along the way past all that stands still, as far as it sees. None: it
  // is in none.
  std::optional<Eigen::Vector3d> place_ahead(const PlanRequest& request);
  [[nodiscard]] bool grow_corridors(const PlanRequest& request);
  [[nodiscard]] bool optimize(const PlanRequest& request, Trajectory* smooth);
  void shrink_corridors(int num_past_path);
  // Free and within the limits.
  bool is_flyable(const Trajectory& trajectory);
  // A candidate more: the path of the search, or what became of it.
  void add_planned(Candidate::Kind kind, const Trajectory& trajectory);
  // Two candidates more: the way out that violates least, and the own motion; and what all of them violate.
  void add_escape(const PlanRequest& request);
  void add_own_motion(const PlanRequest& request, double violation_cost);
  void take_best();  // of the candidates
  void lap(PlanStep step);

  PlannerConfig config_;
  Stopwatch stopwatch_;
  std::chrono::nanoseconds lap_began_{};
  double prepare_ms_ = 0.0;  // since the newest plan

  ConfigurationSpace space_;
  ReachableSet reachable_;  // of the robot: all that the plan can touch
  Guidance guidance_;
  StaticHeuristic static_heuristic_;
  Eigen::Vector3d aim_ = Eigen::Vector3d::Zero();  // of the search: the goal, or the place beside it
  LocalMinimum local_minimum_;
  StaticHeuristic voxel_ways_;  // to the goal, by single voxels: while the robot is in a local minimum
  CacheKey voxel_ways_key_;
  SpaceTimeHeuristic space_time_heuristic_;
  CacheKey static_key_, space_time_key_;
  KinodynamicSearch search_;
  EscapeSearch escape_search_;
  Duration escape_piece_;
  bool searches_finer_ = false;  // the newest search got stuck: the next one takes finer steps
  CorridorBuilder corridor_builder_;
  std::vector<SplineQp> optimizers_;  // [n - 1]: for n pieces

  SearchProblem search_problem_;  // refers to space and heuristic
  SearchResult path_, other_path_, escape_path_;
  SplineProblem spline_problem_;
  SplineSolution spline_solution_;
  std::vector<Candidate> candidates_;  // of the newest plan, the preferred first
  PlanResult result_;
};

}  // namespace swarm
