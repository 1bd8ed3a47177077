// What surrounds one robot, on its onboard bus: its sensors, its flight controller, and whoever tells it its goal. Runs
// in every host as the daemons do.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/recurring.h"
#include "swarm_sim/environment/range_sensor.h"
#include "swarm_sim/environment/sensor.h"
#include "swarm_sim/environment/simulation.h"

namespace swarm {

class EnvironmentNode : public Node {
 public:
  // So long after a tick it takes place: setpoints of that very moment need a while to arrive.
  static constexpr Duration kLatency = 2ms;

  // Of robot `index` in the world's order. `simulation` is shared by all robots and must outlive the node. The node's
  // clock is the simulation's; what it sends carries the robot's. `boot` grows at every start, where others have heard
  // an earlier one (see HeaderSource). `tells_state`: false where somebody else tells the robot where it is.
  EnvironmentNode(Simulation& simulation, std::size_t index, std::int32_t boot = 0, bool tells_state = true);

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;

 private:
  const Vehicle& vehicle() const { return simulation_.vehicles()[index_]; }
  // What the robot knows as of the newest tick: itself, what its sensor detects, its goal.
  sogm_swarm::robot_state_t state(Utime own_time);
  sogm_swarm::obstacles_t obstacles(Utime own_time, double t_s);
  sogm_swarm::goal_t goal(Utime own_time);
  // Takes a scan; it is sent when its latency is over.
  void look(Utime tick);

  Simulation& simulation_;
  std::size_t index_;
  bool tells_state_;
  Sensor sensor_;
  RangeSensors range_sensors_;
  RayCaster caster_;
  struct Scan {
    Utime due;
    std::vector<sogm_swarm::lidar_scan_t> parts;
    std::vector<sogm_swarm::depth_image_t> images;
  };
  std::deque<Scan> scans_;  // not sent yet
  Duration sensor_period_;
  Utime last_tick_;
  Recurring detection_, goal_;
  HeaderSource state_headers_, obstacle_headers_, goal_headers_, scan_headers_;
};

}  // namespace swarm
