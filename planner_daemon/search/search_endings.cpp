// How a path of the search ends: it brakes, or it is shot at the goal; and what that, or any motion, harms.
#include <algorithm>
#include <cmath>

#include "planner_daemon/search/kinodynamic_search.h"

namespace swarm {
namespace {

constexpr std::int64_t kHarmStep_us = 10'000;
constexpr double kStrayHarm = 1e6;  // of leaving the flight space: worse than any touch

// Bernstein polynomials of degree 4 and 3 at a quarter, a half and three quarters.
const Eigen::Matrix<double, 5, 3> kFourth =
    (Eigen::Matrix<double, 5, 3>() << 81, 16, 1, 108, 64, 12, 54, 96, 54, 12, 64, 108, 1, 16, 81).finished() / 256;
const Eigen::Matrix<double, 4, 3> kThird =
    (Eigen::Matrix<double, 4, 3>() << 27, 8, 1, 27, 24, 9, 9, 24, 27, 1, 8, 27).finished() / 64;

// Passes the limits at one of these, and so do the bounds of the piece around it: finds out at once most of the
// quintics that are too short.
bool hurries(const ControlPoints& whole, double h_s, const SearchLimits& limits) {
  const Eigen::Matrix<double, 3, 5> steps = whole.rightCols<5>() - whole.leftCols<5>();
  const double v = 5 / h_s * (steps * kFourth).cwiseAbs().maxCoeff();
  const double a = 20 / (h_s * h_s) * ((steps.rightCols<4>() - steps.leftCols<4>()) * kThird).cwiseAbs().maxCoeff();
  return v > limits.v_max * (1 + 1e-6) || a > limits.a_max * (1 + 1e-6);
}

}  // namespace

bool KinodynamicSearch::blocked_at(const Eigen::Vector3d& position, int frame) const {
  const Eigen::Vector3i voxel = problem_.blocked->geometry.voxel_of(position);
  if (problem_.zones != nullptr) problem_.zones->prepare_blocked(frame, frame, {voxel.head<2>(), voxel.head<2>()});
  return problem_.blocked->occupied(frame, voxel);
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
  const Sogm& map = *problem_.blocked;
  const int words = map.geometry.words_per_frame();
  const Eigen::Vector3d drift = node.state.velocity + tau_ / 3 * node.state.acceleration;
  const Eigen::Vector3d a1 = -drift / (tau_ * (brake_pieces_ - 1));
  std::int64_t first_blocked = kNever;
  *harm = 0.0;
  const auto pass = [&](std::size_t word, std::uint64_t bit, std::int64_t utime, double duration_s) {
    if ((map.words[word] & bit) == 0) return;
    const double ahead_s = 1e-6 * static_cast<double>(utime - problem_.start_utime);
    if (problem_.emergency) {
      *harm += duration_s * blocked_weight(ahead_s, (problem_.tight->words[word] & bit) != 0,
                                           (problem_.contact->words[word] & bit) != 0);
    } else if (!start_blocked_ || ahead_s > options_.leave_s) {
      first_blocked = utime;
    }
  };
  MotionState state = node.state.motion();
  std::array<AxisSamples, 3> samples;
  for (int k = 0; k < brake_pieces_; ++k) {
    const bool last = k == brake_pieces_ - 1;
    const Eigen::Vector3d a = last ? Eigen::Vector3d::Zero().eval() : a1;
    const auto& frames = frames_[static_cast<std::size_t>(node.depth + k)];
    const std::int64_t begin = problem_.start_utime + (node.depth + k) * std::int64_t{options_.piece_us};
    if (first_blocked == kNever) {
      for (int axis = 0; axis < 3; ++axis) {
        samples[static_cast<std::size_t>(axis)] =
            sample_axis(axis, state.position[axis], state.velocity[axis], state.acceleration[axis], a[axis]);
      }
      const auto& [x, y, z] = samples;
      if (problem_.zones != nullptr)
        problem_.zones->prepare_blocked(frames.front() / words, frames.back() / words,
                                        {{x.low, y.low}, {x.high, y.high}});
      for (std::size_t i = 0; i < kSamples && first_blocked == kNever; ++i) {
        const std::int64_t utime = begin + (static_cast<std::int64_t>(i) + 1) * options_.piece_us / kSamples;
        pass(static_cast<std::size_t>(frames[i] + x.offset[i] + y.offset[i] + z.offset[i]),
             x.in_window[i] & y.in_window[i] & z.in_window[i], utime, tau_ / kSamples);
        if (first_blocked == kNever && ((x.strays | y.strays | z.strays) >> i & 1u) != 0) {
          first_blocked = utime;
          *harm += kStrayHarm;
        }
      }
    }
    state = propagate(state, a);
    if (last) state.velocity.setZero(), state.acceleration.setZero();
    result->knots[static_cast<std::size_t>(node.depth + k + 1)] = state;
  }
  result->num_pieces = node.depth + brake_pieces_;
  const Eigen::Vector3i voxel = map.geometry.voxel_of(state.position);
  if (first_blocked != kNever || !map.geometry.contains(voxel)) return first_blocked;
  // At rest, one look per frame is enough.
  std::int64_t utime = problem_.start_utime + result->num_pieces * std::int64_t{options_.piece_us};
  const GridGeometry& grid = map.geometry;
  const int column = (voxel.x() * grid.size.y() + voxel.y()) * grid.words_per_column() + (voxel.z() >> 6);
  int frame = map.frame_at(utime);
  if (problem_.zones != nullptr)
    problem_.zones->prepare_blocked(frame, map.num_frames - 1, {voxel.head<2>(), voxel.head<2>()});
  for (; first_blocked == kNever && utime < hover_until_utime_; ++frame) {
    const bool stays = frame == map.num_frames - 1;
    const std::int64_t end = map.start_utime + (frame + 1) * map.frame_duration_us;
    const std::int64_t next = stays ? hover_until_utime_ : std::min(hover_until_utime_, end);
    pass(static_cast<std::size_t>(frame * words + column), std::uint64_t{1} << (voxel.z() & 63), utime,
         1e-6 * static_cast<double>(next - utime));
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
    if (hurries(whole, duration, limits_)) continue;
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
