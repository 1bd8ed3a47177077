// Errors that wander: processes with a memory, driven by noise, smooth enough to be flown.
#pragma once

#include <Eigen/Core>
#include <numbers>

#include "swarm_sim/world/random.h"

namespace swarm {

// Three axes, each a critically damped oscillator that white noise drives: mean 0, variance 1, continuous with its
// rate.
class Wander {
 public:
  // Correlated over about `time_s`; drawn as it is at any time.
  Wander(double time_s, Random* random);

  void step(double dt_s, Random* random);
  const Eigen::Vector3d& value() const { return value_; }
  const Eigen::Vector3d& rate_per_s() const { return rate_; }

 private:
  double frequency_;  // [1/s]
  Eigen::Vector3d value_, rate_;
};

// How far somebody errs about where it is: half of the variance wanders within half a second, half within twenty.
class EstimateError {
 public:
  explicit EstimateError(Random* random);

  void step(double dt_s, Random* random);
  // Of this standard deviation of an axis, and how fast it changes [1/s].
  Eigen::Vector3d value(double sigma) const { return share(sigma) * fast_.value() + share(sigma) * slow_.value(); }
  Eigen::Vector3d rate_per_s(double sigma) const {
    return share(sigma) * fast_.rate_per_s() + share(sigma) * slow_.rate_per_s();
  }

 private:
  static double share(double sigma) { return sigma * std::numbers::sqrt2 / 2; }

  Wander fast_, slow_;
};

// Gusts after Dryden (MIL-F-8785C), at low height: mean 0, variance 1. Axis x is along the wind.
class Gusts {
 public:
  // They pass at `speed_mps`, which is taken as 1 m/s at least.
  Gusts(double speed_mps, Random* random);

  void step(double dt_s, Random* random);
  Eigen::Vector3d value() const;

 private:
  Eigen::Vector3d rate_;            // at which each axis forgets [1/s]
  Eigen::Vector3d first_, second_;  // low-pass filters in a row, the first of variance 1
};

}  // namespace swarm
