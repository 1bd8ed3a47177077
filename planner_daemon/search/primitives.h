// The motion primitives of the search (paper section IV-A): double integrators with continuous acceleration.
//
// A primitive lasts one trajectory piece (duration tau) and changes the acceleration from a0 to a1 as
// a(s) = a0 + (a1 - a0)(2 s - s^2), s in [0, 1]: monotone, so within the bounds when its ends are. A chain of
// primitives is a C2 quartic spline, hence exactly a `Trajectory` and a feasible point of the optimisation that
// follows. The axes are independent, so what one axis may do is worked out once for all children of a node.
#pragma once

#include <array>
#include <cstdint>

#include "planner_daemon/search/search_types.h"

namespace swarm {

// A primitive is checked for collisions at so many samples that nothing moves farther than a voxel along an axis
// between two of them; in blocks, of which there are few. Above 16 m/s (at 0.1 m and 0.2 s) they lie farther apart, and
// only the check of the whole trajectory looks closely enough.
inline constexpr int kBlockSamples = 8, kMaxBlocks = 4, kMaxSamples = kBlockSamples * kMaxBlocks;

// Where the samples of a primitive lie along one axis of a map.
struct AxisSamples {
  std::int32_t low, high;  // voxels, all on the way
  std::uint32_t strays;    // bit i: sample i leaves the flight space; a robot outside may only come back
  // x, y: what sample i adds to the index of a word of the map; z: its word
  std::array<std::int32_t, kMaxSamples> offset;
  std::array<std::int32_t, kMaxSamples> half;  // index along the axis of W, in halves of voxels
  // x, y: all ones inside the window, else 0; z: the sample's bit, or 0
  std::array<std::uint64_t, kMaxSamples> in_window;
};

// What one axis does during a primitive.
struct AxisOption {
  double position, velocity, acceleration;  // at the end of the primitive
  double effort;                            // cost of the acceleration
  AxisSamples samples;
};
struct AxisOptions {
  std::array<AxisOption, 6> option;
  int count = 0;
};

class Primitives {
 public:
  // Throws std::invalid_argument when braking does not fit the horizon (num_pieces too small, or jerk or thrust).
  Primitives(const SearchLimits& limits, const SearchOptions& options);

  // Primitives in which any reachable state comes to rest.
  static int brake_pieces(const SearchLimits& limits, Duration piece);

  double tau_s() const { return tau_s_; }
  // Largest acceleration per axis: a little of what the limits say is left for rounding.
  const Eigen::Vector3d& a_usable_mps2() const { return a_usable_mps2_; }
  // So many until the strongest acceleration has ended: more than one where jerk is limited.
  int ramp_pieces() const { return ramp_pieces_; }
  // The most that an acceleration changes during a primitive; infinite where jerk is not limited.
  double step_mps2() const { return step_mps2_; }
  int brake_pieces() const { return brake_pieces_; }
  int max_depth() const { return max_depth_; }  // primitives before braking

  // From now on samples are placed in maps of this window: kBlockSamples or a multiple of it in each primitive. None
  // leaves `space`, W [m], none of a node that is no faster than `v_max_mps` exceeds that, and a faster one brakes.
  void lay_out(const GridGeometry& grid, const Eigen::AlignedBox3d& space, double v_max_mps);
  int num_samples() const { return num_samples_; }

  // What an axis may do from a node on: the strongest accelerations either way that leave the speed limit within reach,
  // the one that stops, none, and, where steps are `fine`, gentle ones at low speed; nearly equal ones once, none that
  // leaves the flight space.
  void axis_options(int axis, const MotionState& from, bool fine, AxisOptions* options) const;
  // Whether thrust may have this direction: what the axes' options say together.
  bool can_tilt(double x_mps2, double y_mps2, double z_mps2) const {
    const double most = tilt_slope_ * (MotionLimits::kGravity_mps2 + z_mps2);
    return tilt_slope_ == 0.0 || x_mps2 * x_mps2 + y_mps2 * y_mps2 <= most * most;
  }
  // How a state is brought to rest in brake_pieces() primitives: the acceleration that is held in between, which takes
  // some primitives to get to where jerk is limited; and the one after the k-th of them, 1 <= k.
  Eigen::Vector3d brake_level(const MotionState& from) const;
  Eigen::Vector3d brake_acceleration(int k, const MotionState& from, const Eigen::Vector3d& level) const;
  // Samples of a primitive of one axis from (p, v, a) to the acceleration a1.
  AxisSamples axis_samples(int axis, double p, double v, double a, double a1) const;
  // Next knot of a primitive towards acceleration `a1`.
  MotionState propagate(const MotionState& from, const Eigen::Vector3d& a1) const;

 private:
  struct SampleWeights {  // position after each sample's time: p + v * .. + a0 * .. + a1 * ..
    std::array<double, kMaxSamples> v, a0, a1;
  };
  struct AxisGrid {       // an axis of the maps and of the flight space
    double halves_per_m;  // halves of voxels
    std::int32_t origin, size;
    int shift, stride;          // voxels to words of the map; along z voxels are bits of words
    std::uint64_t whole_words;  // x, y: all ones; z: 0, for voxels are bits
    double space_min, space_max;
  };
  static void place(const SampleWeights& weights, int num_samples, const AxisGrid& grid, double p, double v, double a,
                    double a1, AxisSamples* out);
  double end_position(double p, double v, double a, double a1) const;
  double calm_down(double v, double a, double high, double a_usable_mps2) const;

  SearchLimits limits_;
  SearchOptions options_;
  double tau_s_;
  Eigen::Vector3d axis_mps2_, a_usable_mps2_;
  double step_mps2_;
  double tilt_slope_;  // 0: thrust is not limited
  int ramp_pieces_;
  int brake_pieces_;
  int max_depth_;
  double v_max_mps_;
  int num_samples_ = 0;  // weights_ are for
  SampleWeights weights_;
  std::array<AxisGrid, 3> axes_;
};

// Time-optimal one-axis motion from (0, v) to rest at `d` under |v| <= v_max, |a| <= a_max [s] (Pontryagin): lower
// bound of the axis' flight time.
double min_time_to_rest(double d, double v, double v_max_mps, double a_max_mps2);

}  // namespace swarm
