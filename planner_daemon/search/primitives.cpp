#include "planner_daemon/search/primitives.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "lcmtypes/bus/text.h"
#include "lcmtypes/bus/wide.h"

namespace swarm {
namespace {

constexpr double kUsable = 0.98;       // of a_max: a little is left for rounding
constexpr double kOverspeed = 1.0025;  // of v_max: what a start in the middle of a piece may still rise to

// Largest velocity during a primitive from (v, a > 0).
double peak_velocity(double v, double a, double a1, double tau) {
  if (a1 >= 0.0) return v + tau / 3 * (a + 2 * a1);
  const double s = 1.0 - std::sqrt(a1 / (a1 - a));  // where the acceleration is 0
  return v + tau * (a * s + (a1 - a) * (s * s - s * s * s / 3));
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
      a_usable_mps2_(kUsable * limits.a_max_mps2),
      brake_pieces_(brake_pieces(limits, options.piece)),
      max_depth_(options.num_pieces - brake_pieces_),
      v_max_mps_(limits.v_max_mps) {
  if (options.num_pieces > Trajectory::kMaxPieces || max_depth_ < 1) {
    const double most_mps = (Trajectory::kMaxPieces - 2) * tau_s_ * a_usable_mps2_;  // to brake from within the most
    throw std::invalid_argument("horizon: " + std::to_string(options.num_pieces) + " pieces of " + fixed(tau_s_, 3) +
                                " s; must be at least " + std::to_string(brake_pieces_ + 1) + " (braking from " +
                                text_of(limits.v_max_mps) + " m/s at " + text_of(limits.a_max_mps2) + " m/s^2 takes " +
                                std::to_string(brake_pieces_) + ") and at most " +
                                std::to_string(Trajectory::kMaxPieces) + ": of so many, pieces of " +
                                fixed(tau_s_ * limits.v_max_mps / most_mps, 3) + " s or more do, or a speed of " +
                                fixed(most_mps, 2) + " m/s or less");
  }
}

int Primitives::brake_pieces(const SearchLimits& limits, Duration piece) {
  return static_cast<int>(std::ceil(limits.v_max_mps / (to_seconds(piece) * kUsable * limits.a_max_mps2))) + 1;
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
double Primitives::calm_down(double v, double a, double high) const {
  const double limit = kOverspeed * v_max_mps_;
  if (a <= 0.0 || peak_velocity(v, a, high, tau_s_) <= limit) return high;
  double low = -a_usable_mps2_;
  for (int i = 0; i < 12; ++i) {
    const double middle = (low + high) / 2;
    (peak_velocity(v, a, middle, tau_s_) <= limit ? low : high) = middle;
  }
  return low;
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
  double high = std::clamp((v_max_mps_ - drift) / tau_s_, -a_usable_mps2_, a_usable_mps2_);
  double low = std::clamp((-v_max_mps_ - drift) / tau_s_, -a_usable_mps2_, a_usable_mps2_);
  if (drift > v_max_mps_) high = calm_down(v, a, high);
  if (drift < -v_max_mps_) low = -calm_down(-v, -a, -low);
  const double rest = std::clamp(-drift / tau_s_, low, high);  // at rest one primitive later, or as near as may be
  const double gentle = fine && std::abs(v) < 0.5 * options_.slow_mps ? 0.25 * a_usable_mps2_ : 0.0;
  options->count = 0;
  for (double wanted : {a_usable_mps2_, -a_usable_mps2_, rest, 0.0, gentle, -gentle}) {
    const double a1 = std::clamp(wanted, low, high);
    bool is_new = true;
    for (int i = 0; i < options->count; ++i) {
      is_new =
          is_new && std::abs(options->option[static_cast<std::size_t>(i)].acceleration - a1) > 0.05 * a_usable_mps2_;
    }
    if (!is_new) continue;
    AxisOption& option = options->option[static_cast<std::size_t>(options->count)];
    place(weights_, num_samples_, axes_[static_cast<std::size_t>(axis)], p, v, a, a1, &option.samples);
    if (option.samples.strays != 0) continue;
    ++options->count;
    option.position = end_position(p, v, a, a1);
    option.velocity = v + tau_s_ / 3 * (a + 2 * a1);
    option.acceleration = a1;
    option.effort = options_.effort_weight * (a1 / limits_.a_max_mps2) * (a1 / limits_.a_max_mps2);
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
