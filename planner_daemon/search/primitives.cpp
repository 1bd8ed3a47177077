#include "planner_daemon/search/primitives.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "lcmtypes/bus/text.h"
#include "lcmtypes/bus/wide.h"

namespace swarm {
namespace {

constexpr double kUsable = 0.98;       // of the limits: a little is left for rounding
constexpr double kOverspeed = 1.0025;  // of v_max: what a start in the middle of a piece may still rise to

// Largest velocity during a primitive from (v, a > 0).
double peak_velocity(double v, double a, double a1, double tau) {
  if (a1 >= 0.0) return v + tau / 3 * (a + 2 * a1);
  const double s = 1.0 - std::sqrt(a1 / (a1 - a));  // where the acceleration is 0
  return v + tau * (a * s + (a1 - a) * (s * s - s * s * s / 3));
}

// The jerk of a primitive is largest at its begin: twice the change of acceleration over its duration.
double largest_step(const MotionLimits& limits, double tau_s) {
  return limits.limits_jerk() ? kUsable * limits.j_max_mps3 * tau_s / 2 : std::numeric_limits<double>::infinity();
}

// How much the velocity still grows while an acceleration ends in steps of `step` [primitives' durations].
double ramp_gain(double a, double step) {
  const double pieces = std::max(1.0, std::ceil(a / step));
  return a / 3 + (pieces - 1) * a - step * pieces * (pieces - 1) / 2;
}

// The largest acceleration after a primitive, or after steps that end it, by which the velocity still grows by at most
// `room` times the duration of a primitive.
double strongest(double room, double step, int ramp_pieces) {
  double most = room;
  for (int k = 2; k <= ramp_pieces; ++k) most = std::min(most, room / k + step * (k - 1) / 2);
  return most;
}

// Of braking from (v, a) in n primitives: the acceleration goes to a level, as fast as steps allow, stays there, and is
// 0 in time. After the k-th, 1 <= k < n:
double axis_brake(int k, int n, double a, double level, double step) {
  const double ending = std::clamp(level, (k - n) * step, (n - k) * step);
  return std::clamp(ending, a - k * step, a + k * step);  // which is what counts where `a` cannot end in time
}

// The level that ends at rest: there the sum of all a_k is -(v + tau / 3 a) / tau. It grows with the level, by straight
// lines: Newton's method, inside a bracket.
double axis_brake_level(int n, double tau, double v, double a, double step) {
  constexpr int kMostSteps = 40;  // it takes five at most, and none without limits of jerk
  constexpr double kRounding_mps2 = 1e-12;
  const double drift = v + tau / 3 * a;
  double level = -drift / (tau * (n - 1));
  if (std::isinf(step)) return level;
  double high = std::abs(a) + step * n, low = -high;
  for (int i = 0; i < kMostSteps; ++i) {
    double missing = -drift / tau;
    int at_level = 0;
    for (int k = 1; k < n; ++k) {
      const double a_k = axis_brake(k, n, a, level, step);
      missing -= a_k;
      at_level += a_k == level;
    }
    if (std::abs(missing) < kRounding_mps2) break;
    (missing > 0.0 ? low : high) = level;
    level += missing / std::max(at_level, 1);
    if (level <= low || level >= high) level = (low + high) / 2;
  }
  return level;
}

// The largest acceleration of one axis while it brakes in n primitives from any state that search can come to; infinite
// where it cannot.
double most_while_braking(int n, double tau, double v_max, double a_usable, double step) {
  constexpr int kStates = 64;  // that differ in acceleration, at the speed that still can be kept below v_max
  if (std::isinf(step)) return v_max / (tau * (n - 1));
  double most = 0.0;
  for (int i = -kStates; i <= kStates; ++i) {
    const double a = a_usable * i / kStates, v = v_max - tau * ramp_gain(std::abs(a), step);
    if (v < 0.0) continue;  // so slow a robot does not come to accelerate so fast
    if (std::abs(a) > n * step) return std::numeric_limits<double>::infinity();
    const double level = axis_brake_level(n, tau, v, a, step);
    double missing = -(v + tau / 3 * a) / tau;
    for (int k = 1; k < n; ++k) {
      const double a_k = axis_brake(k, n, a, level, step);
      missing -= a_k;
      most = std::max(most, std::abs(a_k));
    }
    if (std::abs(missing) > 1e-9) return std::numeric_limits<double>::infinity();
  }
  return most;
}

// Of the most pieces that there may be, one is left besides braking.
bool can_brake_within_most(const SearchLimits& limits, Duration piece) {
  return Primitives::brake_pieces(limits, piece) < Trajectory::kMaxPieces;
}

// Shortest one that does, in milliseconds, and highest speed in cm/s: what the message advises.
Duration shortest_piece(const SearchLimits& limits, Duration piece) {
  constexpr Duration kStep = 1ms, kLongest = 100s;
  Duration low = kStep, high = can_brake_within_most(limits, piece) ? piece : kLongest;
  while (high - low > kStep) {
    const Duration middle = (low + high) / 2 / kStep * kStep;
    (can_brake_within_most(limits, middle) ? high : low) = middle;
  }
  return high;
}
double highest_speed(SearchLimits limits, Duration piece) {
  constexpr double kStep_mps = 0.01;
  int low = 0, high = static_cast<int>(std::ceil(limits.v_max_mps / kStep_mps)) + 1;
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    limits.v_max_mps = middle * kStep_mps;
    (can_brake_within_most(limits, piece) ? low : high) = middle;
  }
  return low * kStep_mps;
}

}  // namespace

double min_time_to_rest(double d, double v, double v_max_mps, double a_max_mps2) {
  v = std::clamp(v, -v_max_mps, v_max_mps);
  // Mirror so that the motion first accelerates in the positive direction.
  if (d < v * std::abs(v) / (2 * a_max_mps2)) d = -d, v = -v;
  const double peak = std::sqrt(std::max(0.0, a_max_mps2 * d + v * v / 2));
  if (peak <= v_max_mps) return (peak - v + peak) / a_max_mps2;
  const double cruise = d - (2 * v_max_mps * v_max_mps - v * v) / (2 * a_max_mps2);
  return (2 * v_max_mps - v) / a_max_mps2 + cruise / v_max_mps;
}

Primitives::Primitives(const SearchLimits& limits, const SearchOptions& options)
    : limits_(limits),
      options_(options),
      tau_s_(to_seconds(options.piece)),
      axis_mps2_(limits.axis_mps2()),
      a_usable_mps2_(kUsable * axis_mps2_),
      step_mps2_(largest_step(limits, tau_s_)),
      tilt_slope_(limits.limits_thrust() ? limits.tilt_slope() : 0.0),
      ramp_pieces_(limits.limits_jerk() ? static_cast<int>(std::ceil(a_usable_mps2_.maxCoeff() / step_mps2_)) : 1),
      brake_pieces_(brake_pieces(limits, options.piece)),
      max_depth_(options.num_pieces - brake_pieces_),
      v_max_mps_(limits.v_max_mps) {
  if (options.num_pieces > Trajectory::kMaxPieces || max_depth_ < 1) {
    const Duration enough = shortest_piece(limits, options.piece);
    const double slow_mps = highest_speed(limits, options.piece);
    throw std::invalid_argument(
        "horizon: " + std::to_string(options.num_pieces) + " pieces of " + fixed(tau_s_, 3) + " s; must be at least " +
        std::to_string(brake_pieces_ + 1) + " (braking from " + text_of(limits.v_max_mps) + " m/s at " +
        fixed(limits.stopping_mps2(), 2) + " m/s^2 takes " + std::to_string(brake_pieces_) + ") and at most " +
        std::to_string(Trajectory::kMaxPieces) + ": of so many, pieces of " + fixed(to_seconds(enough), 3) +
        " s or more do, or a speed of " + fixed(slow_mps, 2) + " m/s or less");
  }
}

int Primitives::brake_pieces(const SearchLimits& limits, Duration piece) {
  const double tau = to_seconds(piece), step = largest_step(limits, tau);
  const Eigen::Vector3d usable = kUsable * limits.axis_mps2();
  // Axes that brake together must not tilt the robot further than it may be.
  const auto can_brake = [&](int n) {
    const double x = most_while_braking(n, tau, limits.v_max_mps, usable.x(), step);
    const double z = most_while_braking(n, tau, limits.v_max_mps, usable.z(), step);
    return x <= usable.x() && z <= usable.z() &&
           (!limits.limits_thrust() ||
            std::numbers::sqrt2 * x <= limits.tilt_slope() * (MotionLimits::kGravity_mps2 - z));
  };
  int n = static_cast<int>(std::ceil(limits.v_max_mps / (tau * usable.minCoeff()))) + 1;
  if (limits.limits_jerk() || limits.limits_thrust()) {
    while (n <= Trajectory::kMaxPieces && !can_brake(n)) ++n;
  }
  return n;
}

void Primitives::lay_out(const GridGeometry& grid, const Eigen::AlignedBox3d& space, double v_max_mps) {
  v_max_mps_ = v_max_mps;
  const double longest_m = limits_.v_max_mps * tau_s_;  // of a primitive, along an axis
  const double blocks = std::ceil(longest_m / (kBlockSamples * grid.resolution_m));
  const int num_samples = kBlockSamples * static_cast<int>(std::clamp<double>(blocks, 1, kMaxBlocks));
  if (num_samples != num_samples_) {
    num_samples_ = num_samples;
    for (std::size_t i = 0; i < static_cast<std::size_t>(num_samples); ++i) {
      const double s = (static_cast<double>(i) + 1.0) / num_samples;
      const double lag = s * s * s / 3 - s * s * s * s / 12;  // double integral of 2 s - s^2
      weights_.v[i] = tau_s_ * s;
      weights_.a0[i] = tau_s_ * tau_s_ * (s * s / 2 - lag);
      weights_.a1[i] = tau_s_ * tau_s_ * lag;
    }
  }
  for (int axis = 0; axis < 3; ++axis) {
    const int words = axis == 0 ? grid.size.y() * grid.words_per_column() : axis == 1 ? grid.words_per_column() : 1;
    axes_[static_cast<std::size_t>(axis)] = {
        2.0 / grid.resolution_m,           grid.origin[axis], grid.size[axis],  axis == 2 ? 6 : 0, words,
        axis == 2 ? 0 : ~std::uint64_t{0}, space.min()[axis], space.max()[axis]};
  }
}

// One axis of the map: how far apart its voxels are in the map's words; along z they are bits of words.
SWARM_WIDE void Primitives::place(const SampleWeights& weights, int num_samples, const AxisGrid& grid, double p,
                                  double v, double a, double a1, AxisSamples* out) {
  double before = p;
  out->strays = 0;
  for (int first = 0; first < num_samples; first += kBlockSamples) {
    std::array<double, kBlockSamples + 1> position;  // from the sample before the block on
    std::array<std::int32_t, kBlockSamples> voxel;
    const double *wv = weights.v.data() + first, *wa0 = weights.a0.data() + first, *wa1 = weights.a1.data() + first;
    std::int32_t* offset = out->offset.data() + first;
    std::uint64_t* in_window = out->in_window.data() + first;
    position[0] = before;
    for (std::size_t i = 0; i < kBlockSamples; ++i) position[i + 1] = p + wv[i] * v + wa0[i] * a + wa1[i] * a1;
    std::int32_t* half = out->half.data() + first;
    for (std::size_t i = 0; i < kBlockSamples; ++i) half[i] = floor_of(position[i + 1] * grid.halves_per_m);
    for (std::size_t i = 0; i < kBlockSamples; ++i) voxel[i] = (half[i] >> 1) - grid.origin;
    if (first == 0) out->low = out->high = voxel[0];
    for (std::size_t i = 0; i < kBlockSamples; ++i) {
      out->low = std::min(out->low, voxel[i]);
      out->high = std::max(out->high, voxel[i]);
    }
    for (std::size_t i = 0; i < kBlockSamples; ++i) {
      const auto known = -static_cast<std::int32_t>((voxel[i] >= 0) & (voxel[i] < grid.size));  // all ones or 0
      offset[i] = ((voxel[i] & known) >> grid.shift) * grid.stride;
      const std::uint64_t bit = std::uint64_t{1} << (voxel[i] & 63);
      in_window[i] = (bit | grid.whole_words) & static_cast<std::uint64_t>(std::int64_t{known});
    }
    std::uint32_t strays = 0;
    for (std::size_t i = 0; i < kBlockSamples; ++i) {
      const double last = position[i], at = position[i + 1];
      const bool is_stray = ((at < grid.space_min) & (at < last)) | ((at > grid.space_max) & (at > last));
      strays |= static_cast<std::uint32_t>(is_stray) << i;
    }
    out->strays |= strays << first;
    before = position[kBlockSamples];
  }
}

AxisSamples Primitives::axis_samples(int axis, double p, double v, double a, double a1) const {
  AxisSamples samples;
  place(weights_, num_samples_, axes_[static_cast<std::size_t>(axis)], p, v, a, a1, &samples);
  return samples;
}

// A start in the middle of a piece may rise above v_max_mps before a primitive ends: the largest a1 <= `high` that
// prevents it, or the least there is. By bisection: the peak grows with a1.
double Primitives::calm_down(double v, double a, double high, double a_usable_mps2) const {
  const double limit = kOverspeed * v_max_mps_;
  if (a <= 0.0 || peak_velocity(v, a, high, tau_s_) <= limit) return high;
  double low = -a_usable_mps2;
  for (int i = 0; i < 12; ++i) {
    const double middle = (low + high) / 2;
    (peak_velocity(v, a, middle, tau_s_) <= limit ? low : high) = middle;
  }
  return low;
}

Eigen::Vector3d Primitives::brake_level(const MotionState& from) const {
  Eigen::Vector3d level;
  for (int axis = 0; axis < 3; ++axis)
    level[axis] = axis_brake_level(brake_pieces_, tau_s_, from.velocity[axis], from.acceleration[axis], step_mps2_);
  return level;
}

Eigen::Vector3d Primitives::brake_acceleration(int k, const MotionState& from, const Eigen::Vector3d& level) const {
  if (k == brake_pieces_) return Eigen::Vector3d::Zero();
  Eigen::Vector3d a;
  for (int axis = 0; axis < 3; ++axis)
    a[axis] = axis_brake(k, brake_pieces_, from.acceleration[axis], level[axis], step_mps2_);
  return a;
}

// lag: double integral of 2 s - s^2 over the whole primitive.
double Primitives::end_position(double p, double v, double a, double a1) const {
  const double lag = 1.0 / 3 - 1.0 / 12;
  return p + tau_s_ * v + tau_s_ * tau_s_ * (0.5 - lag) * a + tau_s_ * tau_s_ * lag * a1;
}

void Primitives::axis_options(int axis, const MotionState& from, bool fine, AxisOptions* options) const {
  const double p = from.position[axis], v = from.velocity[axis], a = from.acceleration[axis];
  // The largest and smallest a1 after which the next primitive can still keep the speed limit: v1 + tau/3 a1 <= v_max.
  const double drift = v + tau_s_ / 3 * a;
  const double usable = a_usable_mps2_[axis];
  double high = std::clamp(strongest((v_max_mps_ - drift) / tau_s_, step_mps2_, ramp_pieces_), -usable, usable);
  double low = std::clamp(0.0 - strongest((v_max_mps_ + drift) / tau_s_, step_mps2_, ramp_pieces_), -usable, usable);
  if (drift > v_max_mps_) high = calm_down(v, a, high, usable);
  if (drift < -v_max_mps_) low = -calm_down(-v, -a, -low, usable);
  high = std::clamp(high, a - step_mps2_, a + step_mps2_);
  low = std::clamp(low, a - step_mps2_, a + step_mps2_);
  const double rest = std::clamp(-drift / tau_s_, low, high);  // at rest one primitive later, or as near as may be
  const double gentle = fine && std::abs(v) < 0.5 * options_.slow_mps ? 0.25 * usable : 0.0;
  options->count = 0;
  for (double wanted : {usable, -usable, rest, 0.0, gentle, -gentle}) {
    const double a1 = std::clamp(wanted, low, high);
    bool is_new = true;
    for (int i = 0; i < options->count; ++i) {
      is_new = is_new && std::abs(options->option[static_cast<std::size_t>(i)].acceleration - a1) > 0.05 * usable;
    }
    if (!is_new) continue;
    AxisOption& option = options->option[static_cast<std::size_t>(options->count)];
    place(weights_, num_samples_, axes_[static_cast<std::size_t>(axis)], p, v, a, a1, &option.samples);
    if (option.samples.strays != 0) continue;
    ++options->count;
    option.position = end_position(p, v, a, a1);
    option.velocity = v + tau_s_ / 3 * (a + 2 * a1);
    option.acceleration = a1;
    option.effort = options_.effort_weight * (a1 / axis_mps2_[axis]) * (a1 / axis_mps2_[axis]);
  }
}

MotionState Primitives::propagate(const MotionState& from, const Eigen::Vector3d& a1) const {
  MotionState to;
  for (int axis = 0; axis < 3; ++axis) {
    to.position[axis] = end_position(from.position[axis], from.velocity[axis], from.acceleration[axis], a1[axis]);
  }
  to.velocity = from.velocity + tau_s_ / 3 * (from.acceleration + 2 * a1);
  to.acceleration = a1;
  return to;
}

}  // namespace swarm
