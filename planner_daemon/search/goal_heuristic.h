// The heuristic of the search (paper section IV-A): time-optimal motion of each axis to rest at the goal (Pontryagin),
// and the delay that detours and waits among what moves add.
#pragma once

#include <algorithm>

#include "planner_daemon/search/primitives.h"
#include "planner_daemon/search/search_types.h"

namespace swarm {

class GoalHeuristic {
 public:
  // One axis' part of it.
  struct AxisTerm {
    double time_s;  // to rest at the target
    int cell;       // of the space-time heuristic; -1: none
  };

  void set(const SearchProblem& problem, double v_max_mps, const Eigen::Vector3d& a_max_mps2) {
    delays_ = problem.heuristic;
    target_ = delays_ != nullptr ? delays_->target() : problem.goal;
    rest_s_ = delays_ != nullptr ? delays_->rest_s() : 0.0;
    v_max_mps_ = v_max_mps;
    a_max_mps2_ = a_max_mps2;
  }

  // Step of the space-time heuristic at a time; 0 where there is none.
  int step_at(Utime utime) const { return delays_ != nullptr ? delays_->step_at(utime) : 0; }
  AxisTerm axis_term(int step, int axis, double position, double velocity) const {
    return {axis_time(axis, position, velocity), delays_ != nullptr ? delays_->cell_of(step, axis, position) : -1};
  }
  double time_to_goal(int step, const AxisTerm& x, const AxisTerm& y, const AxisTerm& z) const {
    return straight(x.time_s, y.time_s, z.time_s) +
           (delays_ != nullptr ? delays_->delay_s(step, x.cell, y.cell, z.cell) : 0.0);
  }
  // Of a robot at rest after the last step.
  double time_to_goal_at_rest(const Eigen::Vector3d& position) const {
    const int end = delays_ != nullptr ? delays_->num_steps() : 0;
    return time_to_goal(end, axis_term(end, 0, position.x(), 0.0), axis_term(end, 1, position.y(), 0.0),
                        axis_term(end, 2, position.z(), 0.0));
  }

 private:
  double axis_time(int axis, double position, double velocity) const {
    return min_time_to_rest(target_[axis] - position, velocity, v_max_mps_, a_max_mps2_[axis]);
  }
  // The slowest axis decides, the others break ties.
  double straight(double x_s, double y_s, double z_s) const {
    const double longest = std::max({x_s, y_s, z_s});
    return rest_s_ + longest + 0.1 * (x_s + y_s + z_s - longest);
  }

  Eigen::Vector3d target_ = Eigen::Vector3d::Zero();
  double rest_s_ = 0.0;
  const SpaceTimeHeuristic* delays_ = nullptr;
  double v_max_mps_ = 1.0;
  Eigen::Vector3d a_max_mps2_ = Eigen::Vector3d::Ones();
};

}  // namespace swarm
