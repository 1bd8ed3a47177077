#include "planner_daemon/planner.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace swarm {
namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
constexpr std::int64_t kGuidanceAge_us = 250'000, kCostToGoAge_us = 75'000;
constexpr double kKeepBonus_s = 0.05;  // of the motion already flown where the search got stuck
constexpr double kWorthwhile = 3.0;    // this much less harm makes the quick way out worth its rough flight

// A plan leaves the own motion between two knots, where speed may still rise a little: some is kept for that.
PlannerConfig with_reserve(PlannerConfig config) {
  config.limits.v_max *= Planner::kUsableSpeed;
  return config;
}

// The acceleration changes twice as fast, where half the pieces' duration leaves time to brake.
SearchOptions quick(const SearchLimits& limits, const SearchOptions& options) {
  SearchOptions half = options;
  half.piece_us /= 2;
  half.max_expansions *= 2;  // room for the manoeuvres of both phases
  return KinodynamicSearch::brake_pieces(limits, half.piece_us) < half.num_pieces ? half : options;
}

}  // namespace

const char* to_string(PlanOutcome outcome) {
  switch (outcome) {
    case PlanOutcome::kSmooth:
      return "smooth";
    case PlanOutcome::kRaw:
      return "raw";
    case PlanOutcome::kUnsafe:
      return "unsafe";
  }
  return "?";
}

const char* to_string(PlanStep step) {
  static constexpr const char* kNames[kNumPlanSteps] = {"compose", "search", "corridor", "optimize", "check"};
  return kNames[static_cast<int>(step)];
}

Planner::Planner(const PlannerConfig& config, Stopwatch stopwatch)
    : config_(with_reserve(config)),
      stopwatch_(std::move(stopwatch)),
      search_(config_.limits, config.search),
      quick_search_(config_.limits, quick(config_.limits, config.search)),
      quick_piece_us_(quick(config_.limits, config.search).piece_us),
      corridors_(config.limits.space_min, config.limits.space_max, config.corridor),
      zones_(config.zones) {
  for (int pieces = 1; pieces <= config.search.num_pieces; ++pieces) {
    optimizers_.emplace_back(5, std::vector<double>(static_cast<std::size_t>(pieces), config.search.piece_us * 1e-6));
  }
}

// The paper on one screen.
const PlanResult& Planner::plan(const PlanRequest& request) {
  result_.step_ms.fill(0.0);
  result_.corridors.clear();
  lap_ns_ = stopwatch_ ? stopwatch_() : 0;

  compose(request);  // III-C: the peers' swept volumes join the SOGM; configuration space follows where it is looked at
  lap(PlanStep::kCompose);
  result_.search_status = search(request);  // IV-A: kinodynamic A* to the goal, or to survive to the horizon
  lap(PlanStep::kSearch);
  bool smoothed = grow_corridors(request);  // IV-B: FIRI, one polytope per piece
  lap(PlanStep::kCorridor);
  Trajectory smooth;
  smoothed = smoothed && optimize(request, &smooth);  // IV-C: minimum-jerk Bezier curve inside the corridor
  lap(PlanStep::kOptimize);
  check(request, smoothed, smooth);  // against the same free space; picks the smooth, the raw or the present motion
  lap(PlanStep::kCheck);
  return result_;
}

void Planner::lap(PlanStep step) {
  if (!stopwatch_) return;
  const std::int64_t now_ns = stopwatch_();
  result_.step_ms[static_cast<std::size_t>(step)] += 1e-6 * static_cast<double>(now_ns - lap_ns_);
  lap_ns_ = now_ns;
}

void Planner::compose(const PlanRequest& request) {
  const SearchOptions& search = config_.search;
  const MotionState start = request.own.at(request.start_utime);
  reach_ = {start.position,       request.start_utime, config_.limits.v_max, 1e-6 * search.piece_us * search.num_pieces,
            config_.limits.a_max, start.velocity};
  zones_.compose(*request.sogm, *request.peers, reach_);
}

Planner::Made Planner::made_for(const PlanRequest& request) {
  const GridGeometry& grid = request.sogm->geometry;
  return {request.sogm->start_utime, grid.size, grid.resolution_m, request.goal};
}

// What is free is looked up in the newest map in any case. A younger map only: the same one comes again where parts of
// a plan are timed.
bool Planner::Made::serves(const PlanRequest& request, std::int64_t longest_us) const {
  const Made now = made_for(request);
  const std::int64_t age_us = now.utime - utime;
  return age_us > 0 && age_us < longest_us && size == now.size && resolution_m == now.resolution_m && goal == now.goal;
}

void Planner::build_cost_to_go(const PlanRequest& request) {
  const SearchLimits& limits = config_.limits;
  const double blocked_m = config_.zones.blocked_m();
  if (!guidance_made_.serves(request, kGuidanceAge_us)) {  // what stands still changes slowly
    is_guided_ = guidance_.build(zones_.compose_standing(*request.peers), blocked_m, request.goal, limits.space_min.z(),
                                 limits.space_max.z());
    guidance_made_ = made_for(request);
  }
  cost_to_go_.build(zones_.occupancy(), blocked_m, is_guided_ ? &guidance_ : nullptr, reach_, request.goal,
                    limits.space_min, limits.space_max);
  cost_to_go_made_ = made_for(request);
}

SearchStatus Planner::search(const PlanRequest& request) {
  SearchProblem& problem = search_problem_;
  problem.start = request.own.at(request.start_utime);
  problem.start_utime = request.start_utime;
  problem.goal = request.goal;
  const Sogm& blocked = zones_.blocked();
  problem.blocked = &blocked;
  problem.near = &zones_.near();
  problem.wake = &zones_.wake();
  problem.tight = &zones_.tight();
  problem.contact = &zones_.contact();
  problem.zones = &zones_;
  if (!cost_to_go_made_.serves(request, kCostToGoAge_us)) build_cost_to_go(request);
  problem.cost_to_go = &cost_to_go_;
  in_danger_ = zones_.blocked_at(problem.start.position, request.start_utime);
  if (in_danger_) zones_.enter_emergency();
  problem.fine = looks_finer_;
  problem.emergency = false;
  SearchStatus status = search_.find(problem, &path_);
  result_.expansions = path_.expansions;
  looks_finer_ = !problem.fine && path_.settled;
  if (status == SearchStatus::kPartial) {  // nothing survives: the other steps at once
    problem.fine = !problem.fine;
    const SearchStatus other_status = search_.find(problem, &other_path_);
    result_.expansions += other_path_.expansions;
    if (other_status != SearchStatus::kPartial) {
      std::swap(path_, other_path_);
      status = other_status;
    }
  }
  // Stuck now, but an earlier search knew better: what it found is not dropped.
  keeps_own_ =
      path_.settled && !in_danger_ && status == SearchStatus::kSurvives &&
      zones_.first_blocked(request.own, request.start_utime) == kNever &&
      search_.time_to_goal(request.own.at(request.own.end_utime()).position) <
          search_.time_to_goal(path_.knots[static_cast<std::size_t>(path_.num_pieces)].position) + kKeepBonus_s;
  if (in_danger_ || status == SearchStatus::kPartial) {  // look for the way that does least harm as well
    zones_.enter_emergency();
    in_danger_ = true;
    problem.fine = false;
    problem.emergency = true;
    (void)quick_search_.find(problem, &quick_path_);
    result_.expansions += quick_path_.expansions;
  }
  return status;
}

bool Planner::grow_corridors(const PlanRequest& request) {
  const double h = config_.search.piece_us * 1e-6;
  if (result_.search_status == SearchStatus::kPartial) return false;
  problem_.corridors.resize(static_cast<std::size_t>(path_.num_pieces));
  for (int k = 0; k < path_.num_pieces; ++k) {
    const std::int64_t from = request.start_utime + k * std::int64_t{config_.search.piece_us};
    const ControlPoints piece = quintic_control_points(path_.knots[k], path_.knots[k + 1], h);
    const FiriStatus status =
        corridors_.build(piece, zones_.occupancy(), config_.zones.blocked_m(), from, from + config_.search.piece_us,
                         &problem_.corridors[static_cast<std::size_t>(k)]);
    if (status != FiriStatus::kGrown) return false;
  }
  result_.corridors = problem_.corridors;
  return true;
}

bool Planner::optimize(const PlanRequest& request, Trajectory* smooth) {
  const int n = path_.num_pieces;
  const double h = config_.search.piece_us * 1e-6;
  const MotionState &start = path_.knots[0], &end = path_.knots[n];
  problem_.start = {start.position, start.velocity, start.acceleration};
  problem_.end = {end.position, end.velocity, end.acceleration};
  // The start lies inside a piece of the own motion, so its control points may pass the limits although the motion does
  // not; they are no unknowns. within_limits() looks at the motion itself afterwards.
  const Eigen::Vector3d drift = start.velocity + h / 4 * start.acceleration;
  problem_.v_max = std::max({config_.limits.v_max, start.velocity.cwiseAbs().maxCoeff(), drift.cwiseAbs().maxCoeff()});
  problem_.a_max = std::max(config_.limits.a_max, start.acceleration.cwiseAbs().maxCoeff());
  if (optimizers_[static_cast<std::size_t>(n) - 1].solve(problem_, &solution_) != SplineStatus::kSolved) return false;
  *smooth = Trajectory(0, request.start_utime, config_.search.piece_us, n);
  smooth->set_knot(0, start);
  for (int k = 1; k < n; ++k) {
    const ControlPoints piece = solution_.control_points.middleCols<6>(6 * k);
    smooth->set_knot(k, evaluate_bezier(piece, h, 0.0));
  }
  smooth->set_knot(n, end);
  return true;
}

Trajectory Planner::raw_trajectory(const SearchResult& path, std::int32_t piece_us, std::int64_t start_utime) const {
  Trajectory raw(0, start_utime, piece_us, path.num_pieces);
  for (int k = 0; k <= path.num_pieces; ++k) raw.set_knot(k, path.knots[static_cast<std::size_t>(k)]);
  return raw;
}

bool Planner::within_limits(const Trajectory& trajectory) const {
  constexpr double kTolerance = 1.005;
  const double v_max = config_.limits.v_max * kTolerance, a_max = config_.limits.a_max * kTolerance;
  const double h = trajectory.piece_s();
  for (int k = 0; k < trajectory.num_pieces(); ++k) {
    const ControlPoints points = quintic_control_points(trajectory.knot(k), trajectory.knot(k + 1), h);
    if (max_speed_bound(points, h) <= v_max && max_acceleration_bound(points, h) <= a_max) continue;
    for (double s = 0.0; s < 1.0; s += 0.05) {  // the bounds are not tight
      const MotionState state = evaluate_bezier(points, h, s);
      if (state.velocity.cwiseAbs().maxCoeff() > v_max || state.acceleration.cwiseAbs().maxCoeff() > a_max)
        return false;
    }
  }
  return true;
}

void Planner::check(const PlanRequest& request, bool smoothed, const Trajectory& smooth) {
  const std::int64_t from = request.start_utime;
  const std::int64_t left = from + (path_.left_blocked ? std::llround(config_.search.leave_s * 1e6) : 0);
  const bool safe = result_.search_status != SearchStatus::kPartial;
  result_.fly = !keeps_own_;
  if (safe && smoothed && within_limits(smooth) && zones_.first_blocked({smooth, {}}, left) == kNever) {
    result_.outcome = PlanOutcome::kSmooth;
    result_.trajectory = smooth;
  } else {
    result_.outcome = safe ? PlanOutcome::kRaw : PlanOutcome::kUnsafe;
    result_.trajectory = raw_trajectory(path_, config_.search.piece_us, from);
  }
  if (!in_danger_) return;
  double least = quick_search_.harm({result_.trajectory, {}});
  const Trajectory quick = raw_trajectory(quick_path_, quick_piece_us_, from);
  if (const double quick_harm = quick_search_.harm({quick, {}}); quick_harm + kWorthwhile < least) {
    result_.outcome = PlanOutcome::kUnsafe;
    result_.trajectory = quick;
    least = quick_harm;
  }
  result_.fly = least <= quick_search_.harm(request.own);
}

}  // namespace swarm
