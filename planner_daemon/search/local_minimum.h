// Robots that do not come nearer to their goal, because the search sees no farther than its horizon and its budget:
// they stand before a corner that has to be flown around by a few steps sideways, or turn round and round where one
// heuristic hands over to another. Until they have come past it they follow the static way from place to place in
// sight.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>

#include "lcmtypes/bus/time.h"

namespace swarm {

class LocalMinimum {
 public:
  // Once a plan. `way_m`: the static way from where the robot is to its goal, where it may fly at `v_max_mps`; stands:
  // the robot rests, and a search that got stuck keeps it there. True: it shall follow the static way.
  bool leads(Utime utime, const Eigen::Vector3d& goal, double way_m, bool stands, double v_max_mps);
  // There is none to be followed: it tries again later.
  void give_up(Utime utime);

 private:
  struct Mark {
    Utime utime{};
    double way_m;
  };

  Eigen::Vector3d goal_ = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  std::optional<Mark> mark_;  // since then it came no nearer
  std::optional<Utime> stands_since_;
  std::optional<double> until_m_;                             // follows the static way until that is so short
  Utime until_{};                                             // and no longer
  int in_vain_ = 0;                                           // times in a row that it was led, but not as far
  double stuck_m_ = std::numeric_limits<double>::infinity();  // where it got stuck last
  double far_m_ = 0.0;                                        // so far it was led from there
};

}  // namespace swarm
