// The environment of the robots, the same in every mode: the world moves on, vehicles track their setpoints, the judge
// watches. Each robot meets it through a node of its own (environment_node.h); this is what these nodes share, and
// whoever comes first moves it on.
//
// The room environment/ stands on world/ and knows nothing of hosts, recordings or reports: whoever wants to know is
// told of each tick.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "lcmtypes/bus/time.h"
#include "swarm_sim/environment/judge.h"
#include "swarm_sim/environment/vehicle.h"
#include "swarm_sim/world/clocks.h"
#include "swarm_sim/world/outage.h"
#include "swarm_sim/world/world.h"

namespace swarm {

struct SimulationOptions {
  double time_limit_s = 60.0;
  double clock_offset_ms = 0.0;  // of the robots' clocks, see clocks.h
  std::vector<ClockStep> clock_steps{};
  std::vector<Outage> state_outages{};
};

class Simulation {
 public:
  static constexpr Duration kTick = 10ms;  // ticks are at its multiples since the epoch
  // The newest one at `utime`.
  static Utime tick_at(Utime utime) { return utime - utime.time_since_epoch() % kTick; }

  // Called after each tick of the flight with the world time [s].
  using TickObserver = std::function<void(double t_s, const Simulation&)>;

  // `world` and `static_map` must outlive the simulation; `static_map` and `on_tick` may be null. The first tick is the
  // first one after `utime`, which is not of a robot's clock, as all times here.
  Simulation(const World& world, const OccupiedCubes* static_map, const SimulationOptions& options, Utime utime,
             TickObserver on_tick);

  const World& world() const { return world_; }
  const OccupiedCubes* static_map() const { return static_map_; }  // null: none
  const Judge& judge() const { return judge_; }
  // In the world's order.
  const std::vector<Vehicle>& vehicles() const { return vehicles_; }
  Vehicle& vehicle(std::size_t index) { return vehicles_[index]; }
  // Whether robot `index` is told where it is.
  bool tells_state(std::size_t index) const;
  // How far each was from where it was told to be [m], at all ticks of the flight.
  const std::vector<std::vector<double>>& tracking_m() const { return tracking_m_; }

  // World time 0. Until then vehicles follow their setpoints, but obstacles stand and nothing is judged. Throws
  // std::invalid_argument unless it is a tick to come.
  void start(Utime utime);
  bool started() const { return start_.has_value(); }
  // World time [s]; negative before the start.
  double t_s(Utime utime) const { return start_ ? to_seconds(utime - *start_) : -1.0; }

  // Moves on, tick by tick, to the last one that is not after `utime`, unless somebody has done so; no further than the
  // end of the flight.
  void advance(Utime utime);
  Utime now() const { return now_; }  // newest tick

 private:
  void tick();

  const World& world_;
  const OccupiedCubes* static_map_;
  std::vector<ClockStep> clock_steps_;  // to come
  std::vector<Outage> state_outages_;
  Judge judge_;
  TickObserver on_tick_;
  Utime now_;
  std::optional<Utime> start_;
  std::vector<Vehicle> vehicles_;
  std::vector<MotionState> states_;  // of the vehicles, as the judge takes them
  std::vector<std::vector<double>> tracking_m_;
};

}  // namespace swarm
