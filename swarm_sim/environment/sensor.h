// A robot's obstacle sensor: what it reports of the obstacles around it.
#pragma once

#include <vector>

#include "sogm_swarm/obstacles_t.hpp"
#include "swarm_sim/world/random.h"
#include "swarm_sim/world/world.h"

namespace swarm {

class Sensor {
 public:
  // `world` must outlive it. The same robot of the same world sees the same.
  Sensor(const World& world, int robot_id);

  // What it reports at world time `t_s`, without a header: obstacles within the world's sensing radius of `position`,
  // W. The robot takes itself to be `own_error` away from there, and what it sees, too. Before the start (t_s < 0)
  // obstacles stand where they will be at 0.
  sogm_swarm::obstacles_t look(double t_s, const Eigen::Vector3d& position, const Eigen::Vector3d& own_error);

 private:
  struct Sight {  // of one obstacle
    double hidden_until_s = 0.0;
  };
  bool is_missed(std::size_t index, double t_s);
  void add_false_alarms(const Eigen::Vector3d& position, sogm_swarm::obstacles_t* message);

  const World& world_;
  Random random_;
  std::vector<Sight> sights_;  // by obstacle
  std::int32_t next_false_id_;
};

}  // namespace swarm
