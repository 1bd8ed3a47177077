#include "swarm_sim/hosts/lockstep.h"

#include <array>
#include <chrono>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>

#include "swarm_sim/environment/environment_node.h"
#include "swarm_sim/hosts/lockstep_host.h"
#include "swarm_sim/results/bus_recorder.h"
#include "swarm_sim/world/clocks.h"

namespace swarm {
namespace {

constexpr std::int64_t kEpoch_us = 1'000'000'000'000'000;  // simulated time of world time 0

std::int64_t steady_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t utime_of(double t_s) {
  return kEpoch_us + std::llround(1e6 * t_s);
}

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
    const auto& newest_ms = planner.newest_plan().step_ms;
    double total = 0.0;
    for (std::size_t i = 0; i < newest_ms.size(); ++i) {
      step_ms[i].push_back(newest_ms[i]);
      total += newest_ms[i];
    }
    step_ms[newest_ms.size()].push_back(total);
  }
  void note_step(const BroadcastNode&, int*) {}

  void note_end(const MapNode& map) { count(map.refused()); }
  void note_end(const PlannerNode& planner) {
    count(planner.refused());
    counts.plans += planner.plans();
    counts.missed += planner.missed();
  }
  void note_end(const BroadcastNode& broadcast) { count(broadcast.refused()); }
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
  void on_message(std::int64_t now_us, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override {
    node_.on_message(now_us, bus, channel, bytes, outbox);
  }
  std::int64_t step(std::int64_t now_us, Outbox& outbox) override {
    const std::int64_t wake_us = node_.step(now_us, outbox);
    work_.note_step(node_, &done_);
    return wake_us;
  }

 private:
  RobotWork& work_;
  NodeType node_;
  int done_ = 0;
};

// In the order of kDaemons; each start of a daemon has a higher boot than the one before. What is referred to must
// outlive the nodes.
std::array<LockstepHost::NodeFactory, kDaemons.size()> daemons_of(const World& world, const WorldRobot& robot,
                                                                  const FlightOptions& options, PromiseStore& promises,
                                                                  RobotWork& work) {
  return {[&, config = map_config(world, robot, options), boot = 0](std::int64_t) mutable {
            return std::make_unique<Daemon<MapNode>>(work, config, ++boot, steady_ns, false);
          },
          [&, config = planner_config(world, robot, options), boot = 0](std::int64_t) mutable {
            return std::make_unique<Daemon<PlannerNode>>(work, config, ++boot, steady_ns, false);
          },
          [&, config = broadcast_config(world, robot, options), boot = 0](std::int64_t) mutable {
            return std::make_unique<Daemon<BroadcastNode>>(work, config, promises, ++boot);
          }};
}

RunReport report_of(const World& world, const Simulation& simulation, const std::vector<RobotWork>& work,
                    double wall_s) {
  std::vector<PlanningSamples> planning;
  std::vector<double> map_ms;
  for (const RobotWork& robot : work) {
    planning.push_back(robot.step_ms);
    map_ms.insert(map_ms.end(), robot.map_ms.begin(), robot.map_ms.end());
  }
  RunReport report =
      make_report(world.name, "lockstep", simulation.judge(), simulation.t_s(simulation.now_us()), wall_s, planning);
  report.mapping = timing_stats(std::move(map_ms));
  for (std::size_t r = 0; r < work.size(); ++r) {
    RobotReport robot = work[r].counts;
    robot.verdict = simulation.judge().robots()[r];
    robot.plan_rate_hz = static_cast<double>(robot.plans) / report.duration_s;
    report.robots.push_back(robot);
  }
  return report;
}

}  // namespace

RunReport run_lockstep(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                       const LockstepDelays& delays, BusLog* logs, TraceWriter* trace,
                       const ProgressCallback& progress) {
  const std::int64_t began_ns = steady_ns();
  check_robots(world, options);
  const std::vector<std::int64_t> clocks_us = clock_offsets_us(options.clock_offset_ms, world);
  const std::array<std::int64_t, kDaemons.size()> work_us = {delays.map_us, delays.plan_us, 0};
  std::deque<MemoryPromiseStore> promises(world.robots.size());
  std::vector<RobotWork> work(world.robots.size());
  LinkModel link(options.link, seed_of(world.name));
  BusRecorder recorder(logs);
  std::optional<LockstepHost> host(kEpoch_us);
  Simulation simulation(world, static_map, {options.time_limit_s, options.clock_offset_ms},
                        kEpoch_us - Simulation::kTick_us, follow_flight(trace, progress, [&host] { host->stop(); }));
  simulation.start(kEpoch_us);

  host->listen([&](std::int64_t now_us, BusId bus, int robot_id, std::string_view channel,
                   std::span<const std::uint8_t> bytes) { recorder.hear(now_us, bus, robot_id, channel, bytes); });
  host->add_bus("swarm", delays.swarm_us, [&](int from_robot, int to_robot, std::int64_t now_us) {
    return link.deliveries(from_robot, to_robot, simulation.t_s(now_us));
  });
  const auto onboard = [](const WorldRobot& robot) { return "robot " + std::to_string(robot.id); };
  for (std::size_t r = 0; r < world.robots.size(); ++r) {
    const WorldRobot& robot = world.robots[r];
    host->add_bus(onboard(robot), delays.onboard_us);
    const auto daemons = daemons_of(world, robot, options, promises[r], work[r]);
    for (std::size_t d = 0; d < daemons.size(); ++d)
      host->add({robot.id, onboard(robot), "swarm", work_us[d], clocks_us[r]}, daemons[d]);
  }
  for (std::size_t r = 0; r < world.robots.size(); ++r) {
    host->add({world.robots[r].id, onboard(world.robots[r]), ""}, [&simulation, &options, r](std::int64_t) {
      return std::make_unique<EnvironmentNode>(simulation, r, options.sensor_rate_hz);
    });
  }
  for (const Kill& kill : options.kills) {
    const std::size_t robot = index_of_robot(world, kill.robot_id, "kill");
    host->crash(kDaemons.size() * robot + kill.daemon, utime_of(kill.at_s), utime_of(kill.back_s));
  }
  host->run();
  host.reset();  // the nodes say what they have counted

  RunReport report = report_of(world, simulation, work, 1e-9 * static_cast<double>(steady_ns() - began_ns));
  recorder.finish(options.clock_offset_ms, &report);
  return report;
}

}  // namespace swarm
