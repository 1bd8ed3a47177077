#include "swarm_sim/environment/pose_drift.h"

#include "swarm_sim/world/random.h"

namespace swarm {
namespace {

constexpr double kShort_s = 0.01;  // over which a rate is taken

}  // namespace

Pose operator*(const Pose& outer, const Pose& inner) {
  return {outer.position + outer.orientation * inner.position, outer.orientation * inner.orientation};
}

Pose inverse(const Pose& pose) {
  const Eigen::Quaterniond back = pose.orientation.conjugate();
  return {-(back * pose.position), back};
}

PoseDrift::PoseDrift(const std::string& file, std::uint64_t seed) : errors_(file) {
  Random random(seed);
  begin_s_ = errors_.begin_s() + random.uniform() * (errors_.end_s() - errors_.begin_s());
  const TimedPose first = errors_.at(begin_s_);
  first_ = inverse({first.position, first.orientation});
}

Pose PoseDrift::at(double t_s) const {
  if (t_s <= 0.0) return {};
  const TimedPose error = errors_.at(begin_s_ + t_s);
  return Pose{error.position, error.orientation} * first_;
}

MotionState PoseDrift::truth_of(const MotionState& believed, double t_s) const {
  const Pose now = inverse(at(t_s)), before = inverse(at(t_s - kShort_s));
  MotionState truth;
  truth.position = (now * Pose{believed.position}).position;
  const Eigen::Vector3d was = (before * Pose{believed.position}).position;
  truth.velocity = now.orientation * believed.velocity + (truth.position - was) / kShort_s;
  truth.acceleration = now.orientation * believed.acceleration;
  truth.jerk = now.orientation * believed.jerk;
  return truth;
}

}  // namespace swarm
