// How a path of the search ends: it brakes, or it is shot at the goal; and what that, or any motion, harms.
#include <algorithm>
#include <cmath>

#include "planner_daemon/kinodynamic_search.h"

namespace swarm {
namespace {

constexpr std::int64_t kHarmStep_us = 10'000;
constexpr double kStrayHarm = 1e6;  // of leaving the flight space: worse than any touch

}  // namespace

bool KinodynamicSearch::strays(const Eigen::Vector3d& before, const Eigen::Vector3d& position) const {
  return ((position.array() < limits_.space_min.array() && position.array() < before.array()) ||
          (position.array() > limits_.space_max.array() && position.array() > before.array()))
      .any();
}

bool KinodynamicSearch::blocked_at(const Eigen::Vector3d& position, int frame) const {
  const Eigen::Vector3i voxel = problem_.blocked->geometry.voxel_of(position);
  if (problem_.zones != nullptr) problem_.zones->prepare_blocked(frame, frame, {voxel.head<2>(), voxel.head<2>()});
  return problem_.blocked->occupied(frame, voxel);
}

bool KinodynamicSearch::free_at(const Eigen::Vector3d& position, std::int64_t utime) const {
  return problem_.emergency ||
         (start_blocked_ && utime - problem_.start_utime <= static_cast<std::int64_t>(options_.leave_s * 1e6)) ||
         !blocked_at(position, problem_.blocked->frame_at(utime));
}

double KinodynamicSearch::harm_at(const Eigen::Vector3d& position, std::int64_t utime) const {
  const int frame = problem_.blocked->frame_at(utime);
  if (!blocked_at(position, frame)) return 0.0;
  const Eigen::Vector3i voxel = problem_.blocked->geometry.voxel_of(position);
  return blocked_weight(1e-6 * static_cast<double>(utime - problem_.start_utime),
                        problem_.tight->occupied(frame, voxel), problem_.contact->occupied(frame, voxel));
}

double KinodynamicSearch::harm(const Motion& motion) const {
  double harm = 0.0;
  for (std::int64_t t = problem_.start_utime; t < hover_until_utime_; t += kHarmStep_us)
    harm += harm_at(motion.at(t).position, t);
  return harm * 1e-6 * kHarmStep_us;
}

std::int64_t KinodynamicSearch::brake(const Node& node, SearchResult* result, double* harm) const {
  const Eigen::Vector3d drift = node.state.velocity + tau_ / 3 * node.state.acceleration;
  const Eigen::Vector3d a1 = -drift / (tau_ * (brake_pieces_ - 1));
  std::int64_t first_blocked = kNever;
  *harm = 0.0;
  const auto look = [&](const Eigen::Vector3d& position, std::int64_t utime, double duration_s) {
    if (problem_.emergency) *harm += harm_at(position, utime) * duration_s;
    if (!free_at(position, utime)) first_blocked = utime;
  };
  MotionState state = node.state.motion();
  Eigen::Vector3d before = state.position;
  for (int k = 0; k < brake_pieces_; ++k) {
    const bool last = k == brake_pieces_ - 1;
    const Eigen::Vector3d a = last ? Eigen::Vector3d::Zero().eval() : a1;
    const std::int64_t begin = problem_.start_utime + (node.depth + k) * std::int64_t{options_.piece_us};
    for (std::size_t i = 0; i < kSamples && first_blocked == kNever; ++i) {
      const std::int64_t utime = begin + (static_cast<std::int64_t>(i) + 1) * options_.piece_us / kSamples;
      const Eigen::Vector3d position =
          state.position + weights_.v[i] * state.velocity + weights_.a0[i] * state.acceleration + weights_.a1[i] * a;
      look(position, utime, tau_ / kSamples);
      if (first_blocked == kNever && strays(before, position)) {
        first_blocked = utime;
        *harm += kStrayHarm;
      }
      before = position;
    }
    state = propagate(state, a);
    if (last) state.velocity.setZero(), state.acceleration.setZero();
    result->knots[static_cast<std::size_t>(node.depth + k + 1)] = state;
  }
  result->num_pieces = node.depth + brake_pieces_;
  // At rest, one look per frame is enough.
  const Sogm& map = *problem_.blocked;
  std::int64_t utime = problem_.start_utime + result->num_pieces * std::int64_t{options_.piece_us};
  while (first_blocked == kNever && utime < hover_until_utime_) {
    const std::int64_t into_frame = std::max<std::int64_t>(0, utime - map.start_utime) % map.frame_duration_us;
    const std::int64_t next = std::min(hover_until_utime_, utime + map.frame_duration_us - into_frame);
    look(state.position, utime, 1e-6 * static_cast<double>(next - utime));
    utime = next;
  }
  return first_blocked;
}

bool KinodynamicSearch::avoided_at(const Eigen::Vector3d& position, int frame) const {
  const Sogm& avoided = problem_.wake != nullptr ? *problem_.wake : *problem_.blocked;
  const Eigen::Vector3i voxel = avoided.geometry.voxel_of(position);
  if (problem_.zones != nullptr) problem_.zones->prepare(frame, frame, {voxel.head<2>(), voxel.head<2>()});
  return avoided.occupied(frame, voxel);
}

std::int64_t KinodynamicSearch::goal_open_from() const {
  const Sogm& map = *problem_.blocked;
  int frame = map.frame_at(problem_.start_utime + options_.num_pieces * std::int64_t{options_.piece_us});
  if (avoided_at(problem_.goal, frame)) return kNever;
  while (frame > 0 && !avoided_at(problem_.goal, frame - 1)) --frame;
  return frame == 0 ? problem_.start_utime : map.start_utime + frame * map.frame_duration_us;
}

bool KinodynamicSearch::shoot(const Node& node, SearchResult* result) {
  const MotionState start = node.state.motion();
  MotionState goal;
  goal.position = problem_.goal;
  const double least_s = node.time_to_goal;
  const int room = options_.num_pieces - node.depth;
  const int first = std::max(1, static_cast<int>(std::ceil(least_s / tau_ - 1e-9)));
  for (int pieces = first; pieces <= std::min(room, first + 3); ++pieces) {
    if (!goal_open_utime_) goal_open_utime_ = goal_open_from();
    if (problem_.start_utime + (node.depth + pieces) * std::int64_t{options_.piece_us} < *goal_open_utime_) continue;
    const double duration = pieces * tau_;
    const ControlPoints whole = quintic_control_points(start, goal, duration);
    bool ok = true;
    for (int k = 1; k <= pieces && ok; ++k) {
      MotionState& knot = result->knots[node.depth + k];
      knot = k == pieces ? goal : evaluate_bezier(whole, duration, static_cast<double>(k) / pieces);
      const MotionState& before = k == 1 ? start : result->knots[node.depth + k - 1];
      const ControlPoints points = quintic_control_points(before, knot, tau_);
      ok = max_speed_bound(points, tau_) <= limits_.v_max + 1e-9 &&
           max_acceleration_bound(points, tau_) <= limits_.a_max + 1e-9;
    }
    if (!ok) continue;
    // Free on the way, and at the goal until the horizon; inside the flight space.
    const std::int64_t begin = problem_.start_utime + node.depth * std::int64_t{options_.piece_us};
    const int samples = room * kSamples;
    for (int i = 1; i <= samples && ok; ++i) {
      const double s = std::min(1.0, static_cast<double>(i) / (pieces * kSamples));
      const Eigen::Vector3d position = bezier_position(whole, s);
      const std::int64_t utime = begin + i * std::int64_t{options_.piece_us} / kSamples;
      ok = !avoided_at(position, problem_.blocked->frame_at(utime)) &&
           (position.array() >= limits_.space_min.array() - 1e-6).all() &&
           (position.array() <= limits_.space_max.array() + 1e-6).all();
    }
    if (!ok) continue;
    result->num_pieces = node.depth + pieces;
    return true;
  }
  return false;
}

}  // namespace swarm
