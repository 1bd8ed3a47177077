// Errors that wander: processes with a memory, driven by noise, smooth enough to be flown.
#pragma once

#include <Eigen/Core>

#include "swarm_sim/world/random.h"

namespace swarm {

// Robots err about where they are: half of it stays much the same for so long, half for so long.
inline constexpr double kFastError_s = 0.5, kSlowError_s = 20.0;

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
