// Long because the paper's pipeline, and what becomes of its result, is to be read in one place.
#include "planner_daemon/planner.h"

#include <algorithm>
#include <utility>

#include "planner_daemon/optimize/acceleration_polytope.h"
#include "planner_daemon/space/first_touch.h"

namespace swarm {
namespace {

constexpr Duration kStaticHeuristicAge = 500ms, kSpaceTimeHeuristicAge = 75ms;
constexpr Duration kAtGoalAge = 1s;  // of the static heuristic, which leads nowhere there
constexpr double kAtGoal_m = 0.1;
constexpr double kMarginStep_m = 0.05;
constexpr double kAhead_m = 1.0;  // of the static way that is followed out of a local minimum
constexpr int kApproach = 3;      // the last pieces of a plan

// A plan leaves the own motion between two knots, where speed may still rise a little: some is kept for that.
PlannerConfig with_reserve(PlannerConfig config) {
  config.limits.v_max_mps *= Planner::kUsableSpeed;
  return config;
}

// The acceleration changes twice as fast, where half the pieces' duration leaves time to brake.
SearchOptions escape_options(const SearchLimits& limits, const SearchOptions& options) {
  SearchOptions half = options;
  half.piece /= 2;
  half.max_expansions *= 2;  // room for the manoeuvres of both phases
  return Primitives::brake_pieces(limits, half.piece) < half.num_pieces ? half : options;
}

Trajectory to_trajectory(const SearchPath& path, Duration piece, Utime start_utime) {
  Trajectory trajectory(0, start_utime, piece, path.num_pieces);
  for (int k = 0; k <= path.num_pieces; ++k) trajectory.set_knot(k, path.knots[static_cast<std::size_t>(k)]);
  return trajectory;
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
      space_(config.space, config.static_map),
      guidance_(config.static_map, config.limits.space_min, config.limits.space_max, config.explores),
      search_(config_.limits, config.search),
      escape_search_(config_.limits, escape_options(config_.limits, config.search)),
      escape_piece_(escape_options(config_.limits, config.search).piece),
      corridor_builder_(config.corridor) {
  std::vector<double> durations_s, jerk_weights;
  for (int piece = 0; piece < config.search.num_pieces; ++piece) {
    durations_s.push_back(to_seconds(config.search.piece));
    jerk_weights.push_back(jerk_weight(piece));
    optimizers_.emplace_back(5, durations_s, jerk_weights);
  }
  candidates_.reserve(4);
  const SearchLimits& limits = config_.limits;
  spline_problem_.a_max_mps2 = limits.axis_mps2().maxCoeff();
  spline_problem_.j_max_mps3 = limits.j_max_mps3;
  if (limits.limits_thrust()) {
    spline_problem_.accelerations = acceleration_polytope(limits.axis_mps2(), limits.tilt_slope(),
                                                          MotionLimits::kGravity_mps2, MotionLimits::kTiltSides);
  }
}

// The paper on one screen.
const PlanResult& Planner::plan(const PlanRequest& request) {
  result_.step_ms.fill(0.0);
  result_.prepare_ms = std::exchange(prepare_ms_, 0.0);
  result_.corridors.clear();
  candidates_.clear();
  lap_began_ = stopwatch_ ? stopwatch_() : 0ns;

  compose(request);  // III-C: the peers' swept volumes join the SOGM; configuration space follows where it is looked at
  lap(PlanStep::kCompose);
  result_.search_status = search(request);  // IV-A: kinodynamic A* to the goal, or to survive to the horizon
  lap(PlanStep::kSearch);
  const bool survives = result_.search_status != SearchStatus::kPartial;
  const bool has_corridors = survives && grow_corridors(request);  // IV-B: FIRI, one polytope per piece
  lap(PlanStep::kCorridor);
  Trajectory smooth;
  const bool is_smooth = has_corridors && optimize(request, &smooth);  // IV-C: minimum-jerk Bezier curve inside them
  lap(PlanStep::kOptimize);
  bool is_free = is_smooth && is_flyable(smooth);  // against the same free space
  if (is_free) {
    add_planned(Candidate::Kind::kSmooth, smooth);
  } else {
    const Trajectory raw = to_trajectory(path_, config_.search.piece, request.start_utime);
    is_free = survives && is_flyable(raw);
    add_planned(is_free ? Candidate::Kind::kRaw : Candidate::Kind::kBlocked, raw);
  }
  if (survives && !is_free) searches_finer_ = !search_problem_.fine;  // not the same again
  if (path_.left_blocked || !is_free) {
    lap(PlanStep::kCheck);
    add_escape(request);
    lap(PlanStep::kSearch);
  } else if (path_.settled && space_.first_blocked(request.own, request.start_utime) == kNever) {
    add_own_motion(request, 0.0);
  }
  take_best();
  lap(PlanStep::kCheck);
  return result_;
}

void Planner::lap(PlanStep step) {
  if (!stopwatch_) return;
  const std::chrono::nanoseconds now = stopwatch_();
  result_.step_ms[static_cast<std::size_t>(step)] += to_ms(now - lap_began_);
  lap_began_ = now;
}

void Planner::compose(const PlanRequest& request) {
  const SearchOptions& search = config_.search;
  const MotionState start = request.own.at(request.start_utime);
  reachable_ = {start.position,
                request.start_utime,
                v_max_mps(request),
                to_seconds(search.piece) * search.num_pieces,
                config_.limits.axis_mps2().maxCoeff(),
                start.velocity};
  // A margin that has grown since the own motion was planned may hold its place: it is left as fast as others come, not
  // fled from.
  const int frame = request.sogm->frame_at(request.start_utime);
  for (double margin_m = request.margin_m;; margin_m = std::max(0.0, margin_m - kMarginStep_m)) {
    space_.compose(*request.sogm, *request.peers, reachable_, margin_m, request.seen);
    if (margin_m == 0.0 || !space_.blocked_at(start.position, frame)) break;
  }
}

Planner::CacheKey Planner::cache_key(const PlanRequest& request) {
  const GridGeometry& grid = request.sogm->geometry;
  return {request.sogm->start_utime, grid.size, grid.resolution_m, request.goal, request.v_max_mps};
}

// What is free is looked up in the newest map in any case. A younger map only: the same one comes again where parts of
// a plan are timed.
bool Planner::CacheKey::serves(const PlanRequest& request, Duration longest) const {
  const CacheKey now = cache_key(request);
  const Duration age = now.utime - utime;
  return age > 0us && age < longest && size == now.size && resolution_m == now.resolution_m && goal == now.goal &&
         v_max_mps == now.v_max_mps;
}

bool Planner::is_slow(const PlanRequest& request) const {
  return !space_time_key_.serves(request, kSpaceTimeHeuristicAge);
}

void Planner::prepare(const PlanRequest& request) {
  const std::chrono::nanoseconds began = stopwatch_ ? stopwatch_() : 0ns;
  if (static_heuristic_ages(request, 8)) {
    renew_static_heuristic(request);
  } else {
    guidance_.work();
  }
  if (stopwatch_) prepare_ms_ += to_ms(stopwatch_() - began);
}

void Planner::prepare_meanwhile(const PlanRequest& request) {
  if (!static_heuristic_ages(request, 9)) return;  // it may wait longer: there are many maps between calm plans
  const std::chrono::nanoseconds began = stopwatch_ ? stopwatch_() : 0ns;
  compose(request);
  renew_static_heuristic(request);
  if (stopwatch_) prepare_ms_ += to_ms(stopwatch_() - began);
}

void Planner::forget() {
  guidance_.forget();
  static_key_ = space_time_key_ = voxel_ways_key_ = CacheKey();
  local_minimum_ = LocalMinimum();
  searches_finer_ = path_.settled = false;
  result_.fly = result_.is_unreachable = false;
}

// What stands still changes slowly.
Duration Planner::static_heuristic_age(const PlanRequest& request) const {
  return (reachable_.center - request.goal).norm() < kAtGoal_m ? kAtGoalAge : kStaticHeuristicAge;
}

bool Planner::static_heuristic_ages(const PlanRequest& request, int tenths) const {
  const Duration age = request.sogm->start_utime - static_key_.utime;
  return age > 0us && 10 * age >= tenths * static_heuristic_age(request);
}

Occupancy Planner::compose_standing(const std::vector<Peer>& peers) {
  const Occupancy standing = space_.compose_standing(peers);
  space_.add_known(guidance_.known());
  return standing;
}

void Planner::renew_static_heuristic(const PlanRequest& request) {
  const Eigen::AlignedBox3d space(config_.limits.space_min, config_.limits.space_max);
  const Occupancy standing = space_.compose_standing(*request.peers);
  if (!request.is_aside) {
    guidance_.reconsider(reachable_.center);
    guidance_.update(*request.sogm, *standing.sogm, space_.seen(), request.goal, space_.way_m());
  }
  space_.add_known(guidance_.known());
  const Guidance* guidance = request.is_aside ? nullptr : &guidance_;
  static_heuristic_.build(standing, space_.way_m(), request.goal, space, guidance);
  if (static_heuristic_.is_cut_off()) {  // by peers that hover in the way: they may go on
    static_heuristic_.build({standing.sogm, nullptr}, space_.way_m(), request.goal, space, guidance);
  }
  static_key_ = cache_key(request);
}

void Planner::work_out_ways(const PlanRequest& request) {
  const std::chrono::nanoseconds began = stopwatch_ ? stopwatch_() : 0ns;
  compose(request);
  renew_static_heuristic(request);
  static_key_.utime -= 1us;  // they serve a plan with this map
  if (stopwatch_) prepare_ms_ += to_ms(stopwatch_() - began);
}

void Planner::build_heuristics(const PlanRequest& request) {
  if (!static_key_.serves(request, static_heuristic_age(request))) renew_static_heuristic(request);
  aim_ = static_heuristic_.beside_goal(reachable_.center).value_or(request.goal);
  space_time_heuristic_.build(space_.occupancy(), space_.blocked_m(), &static_heuristic_, reachable_, aim_,
                              config_.limits.space_min, config_.limits.space_max);
  space_time_key_ = cache_key(request);
}

std::optional<double> Planner::way_m(const PlanRequest& request) const {
  if (!knows_ways(request)) return {};
  const int cost = static_heuristic_.cost(request.own.at(request.start_utime).position);
  if (cost == Wavefront::kUnreached) return {};
  return request.sogm->geometry.resolution_m * cost / Wavefront::kStraight;
}

std::optional<Eigen::Vector3d> Planner::place_ahead(const PlanRequest& request) {
  const Eigen::Vector3d place = request.own.at(request.start_utime).position;
  if (request.is_aside) local_minimum_.give_up(request.start_utime);
  const std::optional<double> way_m = this->way_m(request);
  if (request.is_aside || !way_m || (place - request.goal).norm() < kAtGoal_m) return {};
  const bool stands = request.own.end_utime() <= request.start_utime && path_.settled && !result_.fly;
  if (!local_minimum_.leads(request.start_utime, request.goal, *way_m, stands, v_max_mps(request))) return {};
  if (!voxel_ways_key_.serves(request, kStaticHeuristicAge)) {
    voxel_ways_.build(compose_standing(*request.peers), space_.way_m(), request.goal,
                      {config_.limits.space_min, config_.limits.space_max}, &guidance_,
                      StaticHeuristic::Detail::kVoxels);
    voxel_ways_key_ = cache_key(request);
  }
  const auto ahead = voxel_ways_.ahead(place, kAhead_m);
  if (ahead) return ahead->position;
  local_minimum_.give_up(request.start_utime);
  return {};
}

std::optional<StaticHeuristic::Refuge> Planner::refuge(const PlanRequest& request, const Peer& met, double apart_m) {
  const Eigen::AlignedBox3d space(config_.limits.space_min, config_.limits.space_max);
  const Eigen::Vector3d place = request.own.at(request.start_utime).position;
  const Eigen::Vector3d other = met.motion.at(request.start_utime).position;
  Peer standing = met;
  standing.motion = {Trajectory::hover(1, request.sogm->start_utime - 1s, other), {}};
  // From outside what the peer closes, on this robot's side of it.
  const double closed_m = met.radius_m + space_.way_m() + 2.0 * request.sogm->geometry.resolution_m;
  const double distance_m = (place - other).norm();
  const Eigen::Vector3d from = other + std::max(1.0, closed_m / distance_m) * (place - other);
  compose(request);
  voxel_ways_key_ = {};
  voxel_ways_.build_within(compose_standing({standing}), space_.way_m(), from, space);
  return voxel_ways_.refuge(space, other, apart_m);
}

SearchStatus Planner::search(const PlanRequest& request) {
  if (is_slow(request)) build_heuristics(request);
  if (!request.is_aside) result_.is_unreachable = guidance_.is_unreachable(reachable_.center);
  const auto ahead = place_ahead(request);
  SearchProblem& problem = search_problem_;
  problem = {request.own.at(request.start_utime),
             request.start_utime,
             ahead.value_or(aim_),
             v_max_mps(request),
             &space_,
             ahead ? nullptr : &space_time_heuristic_,
             /*fine=*/searches_finer_};
  SearchStatus status = search_.find(problem, &path_);
  result_.expansions = path_.expansions;
  searches_finer_ = !problem.fine && path_.settled;
  if (status == SearchStatus::kPartial) {  // nothing survives: the other steps at once
    problem.fine = !problem.fine;
    const SearchStatus other_status = search_.find(problem, &other_path_);
    result_.expansions += other_path_.expansions;
    if (other_status != SearchStatus::kPartial) {
      std::swap(path_, other_path_);
      status = other_status;
    }
  }
  return status;
}

bool Planner::grow_corridors(const PlanRequest& request) {
  const double h = to_seconds(config_.search.piece);
  spline_problem_.corridors.resize(static_cast<std::size_t>(path_.num_pieces));
  for (int k = 0; k < path_.num_pieces; ++k) {
    const auto piece_at = static_cast<std::size_t>(k);
    const Utime from = request.start_utime + k * config_.search.piece;
    const ControlPoints piece = quintic_control_points(path_.knots[piece_at], path_.knots[piece_at + 1], h);
    const auto grow = [&](const Occupancy& occupancy) {
      return corridor_builder_.build(piece, occupancy, space_.blocked_m(), search_.space(), from,
                                     from + config_.search.piece, &spline_problem_.corridors[piece_at]);
    };
    // What the path keeps from silent peers the curve keeps as well.
    const auto wide = space_.with_silent_peer_margin();
    if (wide && grow(*wide) == FiriStatus::kGrown) continue;
    if (grow(space_.occupancy()) != FiriStatus::kGrown) return false;
  }
  result_.corridors = spline_problem_.corridors;
  return true;
}

bool Planner::optimize(const PlanRequest& request, Trajectory* smooth) {
  const int n = path_.num_pieces;
  const double h = to_seconds(config_.search.piece);
  const MotionState &start = path_.start(), &end = path_.end();
  spline_problem_.start = {start.position, start.velocity, start.acceleration};
  spline_problem_.end = {end.position, end.velocity, end.acceleration};
  // The start lies inside a piece of the own motion, so its control points may pass the limits although the motion does
  // not. keeps() looks at the motion itself afterwards.
  const Eigen::Vector3d drift = start.velocity + h / 4 * start.acceleration;
  const double start_mps = start.velocity.cwiseAbs().maxCoeff();  // a faster one than now allowed brakes
  spline_problem_.v_max_mps = std::clamp(start_mps, v_max_mps(request), config_.limits.v_max_mps);
  spline_problem_.end_v_max_mps = std::max(start_mps, drift.cwiseAbs().maxCoeff());
  spline_problem_.end_a_max_mps2 = start.acceleration.cwiseAbs().maxCoeff();
  SplineQp& optimizer = optimizers_[static_cast<std::size_t>(n) - 1];
  shrink_corridors(n - kApproach);
  if (optimizer.solve(spline_problem_, &spline_solution_) != SplineStatus::kSolved) {
    shrink_corridors(0);
    if (optimizer.solve(spline_problem_, &spline_solution_) != SplineStatus::kSolved) return false;
  }
  *smooth = Trajectory(0, request.start_utime, config_.search.piece, n);
  smooth->set_knot(0, start);
  for (int k = 1; k < n; ++k) {
    const ControlPoints piece = spline_solution_.control_points.middleCols<6>(6 * k);
    smooth->set_knot(k, evaluate_bezier(piece, h, 0.0));
  }
  smooth->set_knot(n, end);
  return true;
}

// The first `num_past_path` pieces' by the margin, even past the path, but for what is fixed of the first one. The
// others' not past the path: its pieces are a curve that stays inside, and a goal close to something is come to.
void Planner::shrink_corridors(int num_past_path) {
  const double h = to_seconds(config_.search.piece);
  for (int k = 0; k < path_.num_pieces; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const Polytope& grown = result_.corridors[at];
    const ControlPoints piece = quintic_control_points(path_.knots[at], path_.knots[at + 1], h);
    const bool past_path = k < num_past_path;
    for (int i = 0; i < grown.num_faces(); ++i) {
      double least = grown.offsets(i) - (past_path ? config_.corridor.margin_m : config_.corridor.margin_to_path_m);
      if (k == 0 || !past_path) {
        const Eigen::Matrix<double, 1, 6> along = grown.normals.row(i) * piece;
        least = std::max(least, past_path ? along.head<3>().maxCoeff() : along.maxCoeff());
      }
      spline_problem_.corridors[at].offsets(i) = std::min(grown.offsets(i), least);
    }
  }
}

bool Planner::is_flyable(const Trajectory& trajectory) {
  const Duration leave = path_.left_blocked ? to_duration(config_.search.leave_s) : 0us;
  return keeps(trajectory, config_.limits) &&
         space_.first_blocked({trajectory, {}}, trajectory.start_utime() + leave) == kNever;
}

void Planner::add_planned(Candidate::Kind kind, const Trajectory& trajectory) {
  candidates_.push_back({kind, trajectory, 0.0, search_.time_to_goal(path_.end().position)});
}

void Planner::add_escape(const PlanRequest& request) {
  escape_search_.find(search_problem_, &escape_path_);
  result_.expansions += escape_path_.expansions;
  candidates_.push_back({Candidate::Kind::kEscape, to_trajectory(escape_path_, escape_piece_, request.start_utime)});
  for (Candidate& candidate : candidates_)
    candidate.violation_cost = escape_search_.violation_cost({candidate.trajectory, {}});
  const bool is_clear =
      keeps_clear(request.own, *request.sogm, *request.peers, space_.blocked_m(), request.start_utime);
  add_own_motion(request, is_clear ? 0.0 : escape_search_.violation_cost(request.own));
}

void Planner::add_own_motion(const PlanRequest& request, double violation_cost) {
  const Eigen::Vector3d end = request.own.at(request.own.end_utime()).position;
  candidates_.push_back({Candidate::Kind::kOwn, {}, violation_cost, search_.time_to_goal(end)});
}

void Planner::take_best() {
  const bool in_danger = path_.left_blocked || result_.search_status == SearchStatus::kPartial;
  const auto [planned, fly] = choose(candidates_, {in_danger, path_.settled});
  result_.fly = fly;
  result_.trajectory = planned->trajectory;
  if (planned->kind == Candidate::Kind::kEscape) result_.corridors.clear();  // they are of the searched path
  result_.outcome = planned->kind == Candidate::Kind::kSmooth ? PlanOutcome::kSmooth
                    : planned->kind == Candidate::Kind::kRaw  ? PlanOutcome::kRaw
                                                              : PlanOutcome::kUnsafe;
}

}  // namespace swarm
