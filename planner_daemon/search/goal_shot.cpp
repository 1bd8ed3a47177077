#include "planner_daemon/search/goal_shot.h"

#include <algorithm>
#include <cmath>

namespace swarm {
namespace {

// Bernstein polynomials of degree 4 and 3 at a quarter, a half and three quarters.
const Eigen::Matrix<double, 5, 3> kFourth =
    (Eigen::Matrix<double, 5, 3>() << 81, 16, 1, 108, 64, 12, 54, 96, 54, 12, 64, 108, 1, 16, 81).finished() / 256;
const Eigen::Matrix<double, 4, 3> kThird =
    (Eigen::Matrix<double, 4, 3>() << 27, 8, 1, 27, 24, 9, 9, 24, 27, 1, 8, 27).finished() / 64;

// Passes the limits at one of these, and so do the bounds of the piece around it: finds out at once most of the
// quintics that are too short.
bool hurries(const ControlPoints& whole, double h_s, double v_max_mps, double a_max_mps2) {
  const Eigen::Matrix<double, 3, 5> steps = whole.rightCols<5>() - whole.leftCols<5>();
  const double v = 5 / h_s * (steps * kFourth).cwiseAbs().maxCoeff();
  const double a = 20 / (h_s * h_s) * ((steps.rightCols<4>() - steps.leftCols<4>()) * kThird).cwiseAbs().maxCoeff();
  return v > v_max_mps * (1 + 1e-6) || a > a_max_mps2 * (1 + 1e-6);
}

}  // namespace

Utime GoalShot::goal_open_from() const {
  const SearchProblem& problem = context_.problem;
  const Sogm& map = problem.space->grid();
  const int last_frame = map.frame_at(context_.utime_at(context_.options.num_pieces));
  const int frame = problem.space->clear_from(problem.goal, last_frame);
  if (frame > last_frame) return kNever;
  return frame == 0 ? problem.start_utime : map.start_utime + frame * map.frame_duration;
}

// Between the samples too: else the next plan would find the same again.
bool GoalShot::is_free(const SearchNode& node, const SearchPath& path, int pieces) const {
  Trajectory shot(0, context_.utime_at(node.depth), context_.options.piece, pieces);
  shot.set_knot(0, node.state.motion());
  for (int k = 1; k <= pieces; ++k) shot.set_knot(k, path.knots[static_cast<std::size_t>(node.depth + k)]);
  return context_.problem.space->first_blocked({shot, {}}, shot.start_utime()) == kNever;
}

bool GoalShot::shoot(const SearchNode& node, SearchPath* path) {
  const double v_max_mps = context_.v_max_mps, a_max_mps2 = context_.limits.axis_mps2().maxCoeff();
  const Eigen::AlignedBox3d& space = context_.space;
  const Sogm& map = context_.problem.space->grid();
  const double tau_s = context_.primitives.tau_s();
  const MotionState start = node.state.motion();
  MotionState goal;
  goal.position = context_.problem.goal;
  const int room = context_.options.num_pieces - node.depth;
  const int first = std::max(1, static_cast<int>(std::ceil(node.time_to_goal_s / tau_s - 1e-9)));
  const int last = std::min(room, first + 2 + context_.primitives.ramp_pieces());
  for (int pieces = first; pieces <= last; ++pieces) {
    if (!goal_open_utime_) goal_open_utime_ = goal_open_from();
    if (context_.utime_at(node.depth + pieces) < *goal_open_utime_) continue;
    const double duration_s = pieces * tau_s;
    const ControlPoints whole = quintic_control_points(start, goal, duration_s);
    if (hurries(whole, duration_s, v_max_mps, a_max_mps2)) continue;
    bool ok = true;
    for (int k = 1; k <= pieces && ok; ++k) {
      const auto at = static_cast<std::size_t>(node.depth + k);
      MotionState& knot = path->knots[at];
      knot = k == pieces ? goal : evaluate_bezier(whole, duration_s, static_cast<double>(k) / pieces);
      const MotionState& before = k == 1 ? start : path->knots[at - 1];
      const ControlPoints points = quintic_control_points(before, knot, tau_s);
      ok =
          max_speed_bound(points, tau_s) <= v_max_mps + 1e-9 && context_.limits.can_follow(points, tau_s, {1.0 + 1e-6});
    }
    if (!ok) continue;
    // Free on the way; at the goal it is.
    const int num_samples = pieces * context_.primitives.num_samples();
    for (int i = 1; i <= num_samples && ok; ++i) {
      const Eigen::Vector3d position = bezier_position(whole, static_cast<double>(i) / num_samples);
      const Utime utime = context_.utime_of_sample(node.depth, i - 1);
      ok = !context_.problem.space->recently_occupied_at(position, map.frame_at(utime)) &&
           (position.array() >= space.min().array() - 1e-6).all() &&
           (position.array() <= space.max().array() + 1e-6).all();
    }
    if (!ok || !is_free(node, *path, pieces)) continue;
    path->num_pieces = node.depth + pieces;
    return true;
  }
  return false;
}

}  // namespace swarm
