#include "swarm_sim/environment/wander.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace swarm {
namespace {

constexpr double kFastError_s = 0.5, kSlowError_s = 20.0;
constexpr double kAlong_m = 15.0, kUp_m = 2.0;  // lengths of gusts, two metres above the ground

}  // namespace

Wander::Wander(double time_s, Random* random)
    : frequency_(2.0 / time_s), value_(random->normal3()), rate_(frequency_ * random->normal3()) {}

void Wander::step(double dt_s, Random* random) {
  const double noise = std::sqrt(4.0 * frequency_ * frequency_ * frequency_ * dt_s);
  rate_ += -dt_s * frequency_ * (2.0 * rate_ + frequency_ * value_) + noise * random->normal3();
  value_ += dt_s * rate_;
}

EstimateError::EstimateError(Random* random) : fast_(kFastError_s, random), slow_(kSlowError_s, random) {}

void EstimateError::step(double dt_s, Random* random) {
  fast_.step(dt_s, random);
  slow_.step(dt_s, random);
}

Gusts::Gusts(double speed_mps, Random* random) : first_(random->normal3()), second_(Eigen::Vector3d::Zero()) {
  const double speed = std::max(speed_mps, 1.0);
  rate_ << speed / kAlong_m, speed / kAlong_m, speed / kUp_m;
}

void Gusts::step(double dt_s, Random* random) {
  const Eigen::Array3d forgets = (dt_s * rate_.array()).min(1.0);
  second_.array() += forgets * (first_ - second_).array();
  first_ = ((1.0 - forgets) * first_.array() + (1.0 - (1.0 - forgets).square()).sqrt() * random->normal3().array());
}

// Along the wind 1 / (1 + T s), across it (1 + sqrt(3) T s) / (1 + T s)^2, which has twice the variance.
Eigen::Vector3d Gusts::value() const {
  using std::numbers::sqrt3, std::numbers::sqrt2;
  const Eigen::Vector3d across = (sqrt3 * first_ + (1.0 - sqrt3) * second_) / sqrt2;
  return {first_.x(), across.y(), across.z()};
}

}  // namespace swarm
