// The primitives of the search: what they may be, where they lead, and what the zones they pass cost.
#include <algorithm>
#include <cmath>
#include <limits>

#include "map_daemon/wide.h"
#include "planner_daemon/search/kinodynamic_search.h"

namespace swarm {
namespace {

// What lies ahead counts less and less, for it can still be replanned: down to a least share after this long.
constexpr double kFade_s = 1.0, kLeastFade = 0.05;
constexpr double kOverspeed = 1.0025;  // of v_max: what a start in the middle of a piece may still rise to

// Largest velocity during a primitive from (v, a > 0).
double peak_velocity(double v, double a, double a1, double tau) {
  if (a1 >= 0.0) return v + tau / 3 * (a + 2 * a1);
  const double s = 1.0 - std::sqrt(a1 / (a1 - a));  // where the acceleration is 0
  return v + tau * (a * s + (a1 - a) * (s * s - s * s * s / 3));
}

}  // namespace

double min_time_to_rest(double d, double v, double v_max, double a_max) {
  v = std::clamp(v, -v_max, v_max);
  // Mirror so that the motion first accelerates in the positive direction.
  if (d < v * std::abs(v) / (2 * a_max)) d = -d, v = -v;
  const double peak = std::sqrt(std::max(0.0, a_max * d + v * v / 2));
  if (peak <= v_max) return (peak - v + peak) / a_max;
  const double cruise = d - (2 * v_max * v_max - v * v) / (2 * a_max);
  return (2 * v_max - v) / a_max + cruise / v_max;
}

// One axis of the map: how far apart its voxels are in the map's words; along z they are bits of words.
SWARM_WIDE void KinodynamicSearch::place(const SampleWeights& weights, const AxisGrid& grid, double p, double v,
                                         double a, double a1, AxisSamples* out) {
  std::array<double, kSamples + 1> position;  // from the start on
  std::array<std::int32_t, kSamples> voxel;
  position[0] = p;
  for (std::size_t i = 0; i < kSamples; ++i)
    position[i + 1] = p + weights.v[i] * v + weights.a0[i] * a + weights.a1[i] * a1;
  for (std::size_t i = 0; i < kSamples; ++i) voxel[i] = floor_of(position[i + 1] * grid.per_m) - grid.origin;
  out->low = out->high = voxel[0];
  for (std::size_t i = 0; i < kSamples; ++i) {
    out->low = std::min(out->low, voxel[i]);
    out->high = std::max(out->high, voxel[i]);
  }
  for (std::size_t i = 0; i < kSamples; ++i) {
    const auto known = -static_cast<std::int32_t>((voxel[i] >= 0) & (voxel[i] < grid.size));  // all ones or 0
    out->offset[i] = ((voxel[i] & known) >> grid.shift) * grid.stride;
    const std::uint64_t bit = std::uint64_t{1} << (voxel[i] & 63);
    out->in_window[i] = (bit | grid.whole_words) & static_cast<std::uint64_t>(std::int64_t{known});
  }
  out->strays = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    const double before = position[i], at = position[i + 1];
    const bool strays = ((at < grid.space_min) & (at < before)) | ((at > grid.space_max) & (at > before));
    out->strays |= static_cast<unsigned>(strays) << i;
  }
}

KinodynamicSearch::AxisSamples KinodynamicSearch::sample_axis(int axis, double p, double v, double a, double a1) const {
  AxisSamples samples;
  place(weights_, axes_[static_cast<std::size_t>(axis)], p, v, a, a1, &samples);
  return samples;
}

// A start in the middle of a piece may rise above v_max before a primitive ends: the largest a1 <= `high` that prevents
// it, or the least there is. By bisection: the peak grows with a1.
double KinodynamicSearch::calm_down(double v, double a, double high) const {
  const double limit = kOverspeed * limits_.v_max;
  if (a <= 0.0 || peak_velocity(v, a, high, tau_) <= limit) return high;
  double low = -a_lim_;
  for (int i = 0; i < 12; ++i) {
    const double middle = (low + high) / 2;
    (peak_velocity(v, a, middle, tau_) <= limit ? low : high) = middle;
  }
  return low;
}

KinodynamicSearch::AxisOptions KinodynamicSearch::axis_options(int axis, const Node& node) const {
  const double p = node.state.position[axis], v = node.state.velocity[axis], a = node.state.acceleration[axis];
  const int step = goal_steps_[static_cast<std::size_t>(node.depth)];
  // The largest and smallest a1 after which the next primitive can still keep the speed limit: v1 + tau/3 a1 <= v_max.
  const double drift = v + tau_ / 3 * a;
  double high = std::clamp((limits_.v_max - drift) / tau_, -a_lim_, a_lim_);
  double low = std::clamp((-limits_.v_max - drift) / tau_, -a_lim_, a_lim_);
  if (drift > limits_.v_max) high = calm_down(v, a, high);
  if (drift < -limits_.v_max) low = -calm_down(-v, -a, -low);
  const double rest = std::clamp(-drift / tau_, low, high);  // at rest one primitive later, or as near as may be
  const double gentle = problem_.fine && std::abs(v) < 0.5 * options_.slow_mps ? 0.25 * a_lim_ : 0.0;
  AxisOptions options;
  for (double wanted : {a_lim_, -a_lim_, rest, 0.0, gentle, -gentle}) {
    const double a1 = std::clamp(wanted, low, high);
    bool is_new = true;
    for (int i = 0; i < options.count; ++i) {
      is_new = is_new && std::abs(options.option[i].acceleration - a1) > 0.05 * a_lim_;
    }
    if (!is_new) continue;
    AxisOption& option = options.option[static_cast<std::size_t>(options.count)];
    option.samples = sample_axis(axis, p, v, a, a1);
    if (option.samples.strays != 0) continue;
    ++options.count;
    option.position = p + weights_.v.back() * v + weights_.a0.back() * a + weights_.a1.back() * a1;
    option.velocity = v + tau_ / 3 * (a + 2 * a1);
    option.acceleration = a1;
    option.time_to_goal = axis_time(axis, option.position, option.velocity);
    option.effort = options_.effort_weight * (a1 / limits_.a_max) * (a1 / limits_.a_max);
    option.cell = problem_.cost_to_go != nullptr ? problem_.cost_to_go->cell_of(step, axis, option.position) : -1;
  }
  return options;
}

MotionState KinodynamicSearch::propagate(const MotionState& from, const Eigen::Vector3d& a1) const {
  MotionState to;
  to.position = from.position + weights_.v.back() * from.velocity + weights_.a0.back() * from.acceleration +
                weights_.a1.back() * a1;
  to.velocity = from.velocity + tau_ / 3 * (from.acceleration + 2 * a1);
  to.acceleration = a1;
  return to;
}

bool KinodynamicSearch::leaving(int depth, int sample) const {
  return problem_.emergency || (start_blocked_ && (depth + (sample + 1.0) / kSamples) * tau_ <= options_.leave_s);
}

void KinodynamicSearch::prepare(const Node& node, const AxisOptions& xs, const AxisOptions& ys) const {
  if (problem_.zones == nullptr) return;
  const auto& frames = frames_[static_cast<std::size_t>(node.depth)];
  const auto low = [](const AxisOptions& options) {
    int voxel = std::numeric_limits<int>::max();
    for (int i = 0; i < options.count; ++i)
      voxel = std::min(voxel, options.option[static_cast<std::size_t>(i)].samples.low);
    return voxel;
  };
  const auto high = [](const AxisOptions& options) {
    int voxel = std::numeric_limits<int>::min();
    for (int i = 0; i < options.count; ++i)
      voxel = std::max(voxel, options.option[static_cast<std::size_t>(i)].samples.high);
    return voxel;
  };
  const int words = problem_.blocked->geometry.words_per_frame();
  problem_.zones->prepare(frames.front() / words, frames.back() / words, {{low(xs), low(ys)}, {high(xs), high(ys)}});
}

KinodynamicSearch::SampleWords KinodynamicSearch::sample_words(const AxisSamples& x, const AxisSamples& y,
                                                               const AxisSamples& z, int depth) const {
  const auto& frames = frames_[static_cast<std::size_t>(depth)];
  SampleWords words;
  std::array<std::uint64_t, kSamples> inside;
  words.any_near = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    words.index[i] = static_cast<std::size_t>(frames[i] + x.offset[i] + y.offset[i] + z.offset[i]);
    inside[i] = x.in_window[i] & y.in_window[i];
    words.near[i] = problem_.near->words[words.index[i]] & inside[i];
    words.any_near |= words.near[i];
  }
  if (words.any_near == 0) return words;
  for (std::size_t i = 0; i < kSamples; ++i) {
    words.wake[i] = problem_.wake != nullptr ? problem_.wake->words[words.index[i]] & inside[i] : 0;
    words.blocked[i] = problem_.blocked->words[words.index[i]] & inside[i];
  }
  return words;
}

double KinodynamicSearch::zone_cost(const SampleWords& words, const AxisSamples& z, int depth) const {
  const auto any = [&](const std::array<std::uint64_t, kSamples>& zone) {
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < kSamples; ++i) bits |= zone[i] & z.in_window[i];
    return bits != 0;
  };
  if (words.any_near == 0 || !any(words.near)) return 0.0;  // the near zone holds the others
  double cost = 0.0;
  if (any(words.blocked)) {
    if (!start_blocked_ && !problem_.emergency) return -1.0;
    for (std::size_t i = 0; i < kSamples; ++i) {
      const std::uint64_t bit = words.blocked[i] & z.in_window[i];
      if (bit == 0) continue;
      if (!leaving(depth, static_cast<int>(i))) return -1.0;
      cost += blocked_weight((depth + (static_cast<double>(i) + 1.0) / kSamples) * tau_,
                             (problem_.tight->words[words.index[i]] & bit) != 0,
                             (problem_.contact->words[words.index[i]] & bit) != 0);
    }
  }
  int near = 0, wake = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    near += (words.near[i] & z.in_window[i]) != 0;
    wake += (words.wake[i] & z.in_window[i]) != 0;
  }
  cost += near * options_.near_weight + wake * options_.wake_weight;
  return cost * tau_ / kSamples;
}

double KinodynamicSearch::blocked_weight(double ahead_s, bool tight, bool contact) const {
  const double fade = std::max(kLeastFade, 1.0 - ahead_s / kFade_s);
  return options_.leave_weight * fade * (contact ? 100.0 : tight ? 10.0 : 1.0);
}

double KinodynamicSearch::axis_time(int axis, double position, double velocity) const {
  return min_time_to_rest(problem_.goal[axis] - position, velocity, limits_.v_max, a_lim_);
}

}  // namespace swarm
