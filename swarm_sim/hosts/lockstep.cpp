#include "swarm_sim/hosts/lockstep.h"

#include <array>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>

#include "lcmtypes/bus/node_clock.h"
#include "swarm_sim/environment/environment_node.h"
#include "swarm_sim/hosts/lockstep_host.h"
#include "swarm_sim/results/bus_recorder.h"
#include "swarm_sim/world/clocks.h"

namespace swarm {
namespace {

constexpr int kKeeper = -1;                      // among the robots' ids: of all cells
constexpr Utime kEpoch = Utime(1'000'000'000s);  // simulated time of world time 0

// What the nodes of one robot have done, over all their lives.
struct RobotWork {
  RobotReport counts;
  PlanningSamples step_ms;
  std::vector<double> map_ms;

  void note_step(const MapNode& map, int* maps) {
    if (map.maps() == *maps) return;
    *maps = map.maps();
    map_ms.push_back(map.build_ms());
  }
  void note_step(const PlannerNode& planner, int* plans) {
    if (planner.plans() == *plans) return;
    *plans = planner.plans();
    counts.is_unreachable = planner.newest_plan().is_unreachable;
    const PlanResult& plan = planner.newest_plan();
    auto samples = step_ms.begin();
    for (const double ms : plan.step_ms) (samples++)->push_back(ms);
    (samples++)->push_back(plan.total_ms());
    samples->push_back(plan.prepare_ms);
  }
  void note_step(const BroadcastNode&, int*) {}
  void note_step(const PerceptionNode&, int*) {}

  void note_end(const MapNode& map) { count(map.refused()); }
  void note_end(const PlannerNode& planner) {
    count(planner.refused());
    counts.plans += planner.plans();
    counts.missed += planner.missed();
  }
  void note_end(const BroadcastNode& broadcast) { count(broadcast.refused()); }
  void note_end(const PerceptionNode& perception) { count(perception.refused()); }
  void count(const RefusalCounts& refused) {
    for (std::size_t i = 1; i < counts.refused.size(); ++i) counts.refused[i] += refused[static_cast<Refusal>(i)];
  }
};

// A daemon's node. Leaves notes of its work after each step, and of its counts when it ends.
template <class NodeType>
class Daemon : public Node {
 public:
  template <class... Arguments>
  explicit Daemon(RobotWork& work, Arguments&&... arguments)
      : work_(work), node_(std::forward<Arguments>(arguments)...) {}
  ~Daemon() override { work_.note_end(node_); }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  std::vector<Subscription> subscriptions() const override { return node_.subscriptions(); }
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override {
    node_.on_message(now, bus, channel, bytes, outbox);
  }
  bool on_clock_step(Utime now, Duration step) override { return node_.on_clock_step(now, step); }
  Utime step(Utime now, Outbox& outbox) override {
    const Utime wake = node_.step(now, outbox);
    work_.note_step(node_, &done_);
    return wake;
  }

 private:
  RobotWork& work_;
  NodeType node_;
  int done_ = 0;
};

// In the order of kDaemons; each start of a daemon has a higher boot than the one before. What is referred to must
// outlive the nodes.
std::vector<LockstepHost::NodeFactory> daemons_of(const World& world, const WorldRobot& robot,
                                                  const FlightOptions& options, PromiseStore& promises,
                                                  RobotWork& work) {
  std::vector<LockstepHost::NodeFactory> daemons = {
      [&, config = map_config(world, robot, options), boot = 0]() mutable {
        return std::make_unique<Daemon<MapNode>>(work, config, ++boot, &stopwatch, false);
      },
      [&, config = planner_config(world, robot, options), boot = 0]() mutable {
        return std::make_unique<Daemon<PlannerNode>>(work, config, ++boot, &stopwatch, false);
      },
      [&, config = broadcast_config(world, robot, options), boot = 0]() mutable {
        return std::make_unique<Daemon<BroadcastNode>>(work, config, promises, ++boot);
      },
      [&, config = perception_config(world, robot, options), boot = 0]() mutable {
        return std::make_unique<Daemon<PerceptionNode>>(work, config, ++boot, &stopwatch, false);
      }};
  daemons.resize(daemons_in(world).size());
  return daemons;
}

RunReport report_of(const Simulation& simulation, const std::vector<RobotWork>& work, double wall_s) {
  std::vector<PlanningSamples> planning;
  std::vector<double> map_ms;
  std::vector<RobotReport> robots;
  for (const RobotWork& robot : work) {
    planning.push_back(robot.step_ms);
    robots.push_back(robot.counts);
    map_ms.insert(map_ms.end(), robot.map_ms.begin(), robot.map_ms.end());
  }
  RunReport report = make_report("lockstep", simulation, wall_s, planning, std::move(robots));
  report.mapping = timing_stats(std::move(map_ms));
  return report;
}

}  // namespace

RunReport run_lockstep(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                       const LockstepDelays& delays, BusLog* logs, FlightTrace* trace, const ProgressCallback& progress,
                       int threads) {
  const std::chrono::nanoseconds began = stopwatch();
  check_robots(world, options);
  const std::vector<Duration> clocks = clock_offsets(options.clock_offset_ms, world);
  const std::array<Duration, kDaemons.size()> work_times = {delays.map, delays.plan, 0us, delays.look};
  const std::size_t num_daemons = daemons_in(world).size();
  std::deque<MemoryPromiseStore> promises(world.robots.size());
  MemoryBookStore books;
  std::vector<RobotWork> work(world.robots.size());
  LinkModel link(options.link, seed_of(world.name));
  std::optional<RadioChannel> radio;
  if (options.link.rate_mbps > 0.0) radio.emplace(options.link.rate_mbps, seed_of(world.name + " radio"));
  std::optional<LockstepHost> host(std::in_place, kEpoch, threads);
  Simulation simulation(world, static_map,
                        {options.time_limit_s, options.clock_offset_ms, options.clock_steps, options.state_outages},
                        kEpoch - Simulation::kTick, follow_flight(trace, progress, [&host] { host->stop(); }));
  simulation.start(kEpoch);
  BusRecorder recorder(logs, !options.clock_steps.empty(), options.clock_offset_ms,
                       [&](Utime utime) { return simulation.t_s(utime); });

  host->listen([&](Utime now, BusId bus, int robot_id, std::string_view channel, std::span<const std::uint8_t> bytes) {
    recorder.hear(now, bus, robot_id, channel, bytes);
  });
  const auto deliveries = [&](int from_robot, int to_robot, Utime now) {
    const std::span<const Duration> copies = link.deliveries(from_robot, to_robot, simulation.t_s(now));
    recorder.receive(to_robot, copies.size());
    return copies;
  };
  host->add_bus("swarm", delays.swarm, deliveries, radio ? &*radio : nullptr);
  const auto onboard = [](const WorldRobot& robot) { return "robot " + std::to_string(robot.id); };
  for (std::size_t r = 0; r < world.robots.size(); ++r) {
    const WorldRobot& robot = world.robots[r];
    host->add_bus(onboard(robot), delays.onboard);
    const auto daemons = daemons_of(world, robot, options, promises[r], work[r]);
    for (std::size_t d = 0; d < daemons.size(); ++d)
      host->add({robot.id, onboard(robot), "swarm", work_times[d], clocks[r]}, daemons[d]);
  }
  for (std::size_t r = 0; r < world.robots.size(); ++r) {
    host->add({.robot_id = world.robots[r].id, .onboard = onboard(world.robots[r]), .is_alone = true},
              [&simulation, r] { return std::make_unique<EnvironmentNode>(simulation, r); });
  }
  std::size_t keeper = 0;  // its seat
  if (options.cells_m > 0.0) {
    keeper = host->add({kKeeper, "", "swarm"}, [&, config = keeper_config(world, options), boot = 0]() mutable {
      config.listen_s = boot == 0 ? 0.0 : KeeperConfig().listen_s;  // it was there before the flight began
      return std::make_unique<KeeperNode>(config, books, ++boot);
    });
  }
  for (const Kill& kill : options.kills) {
    const std::size_t seat = kill.daemon == Kill::kKeeper
                                 ? keeper
                                 : num_daemons * index_of_robot(world, kill.robot_id, "kill") + kill.daemon;
    host->crash(seat, kEpoch + to_duration(kill.at_s), kEpoch + to_duration(kill.back_s));
  }
  for (const ClockStep& step : options.clock_steps) {
    const std::size_t robot = index_of_robot(world, step.robot_id, "clock-step");
    for (std::size_t d = 0; d < num_daemons; ++d)
      host->step_clock(num_daemons * robot + d, kEpoch + to_duration(step.at_s), step.by);
  }
  host->run();
  host.reset();  // the nodes say what they have counted

  const std::chrono::duration<double> wall = stopwatch() - began;
  RunReport report = report_of(simulation, work, wall.count());
  recorder.finish(&report);
  if (radio) report.air.radio = radio->counts();
  return report;
}

}  // namespace swarm
