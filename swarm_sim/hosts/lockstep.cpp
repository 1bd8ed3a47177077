#include "swarm_sim/hosts/lockstep.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <map>
#include <memory>
#include <queue>
#include <tuple>

#include "lcmtypes/bus/channels.h"
#include "swarm_sim/results/commit_audit.h"
#include "swarm_sim/world/clocks.h"

namespace swarm {
namespace {

constexpr std::int64_t kEpoch_us = 1'000'000'000'000'000;  // simulated time of world time 0
constexpr std::int64_t kGoalPeriod_us = 1'000'000;

std::int64_t steady_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

using Bytes = std::shared_ptr<const std::vector<std::uint8_t>>;

// Runs nodes and simulation; the order of places (0: the simulation, then three per robot) breaks ties of time.
class LockstepHost {
 public:
  LockstepHost(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
               const LockstepDelays& delays, BusLog* logs, TraceWriter* trace)
      : world_(world),
        delays_(delays),
        link_(options.link, seed_of(world.name)),
        logs_(logs),
        clock_offsets_us_(clock_offsets_us(options.clock_offset_ms, world)),
        simulation_(world, static_map, options.time_limit_s, options.clock_offset_ms,
                    [trace](double t_s, const Simulation& simulation) {
                      if (trace != nullptr) trace->write(t_s, simulation);
                    }) {
    check_robots(world, options);
    for (const WorldRobot& robot : world.robots) robots_.emplace_back(world, robot, options);
    for (const Kill& kill : options.kills) kills_.push_back({kill, index_of_robot(world, kill.robot_id, "kill")});
    sensor_period_us_ = static_cast<std::int64_t>(1e6 / options.sensor_rate_hz);
  }

  RunReport run(const ProgressCallback& progress) {
    const std::int64_t began_ns = steady_ns();
    for (std::size_t r = 0; r < robots_.size(); ++r) {
      for (std::size_t n = 0; n < kDaemons.size(); ++n) {
        Place& place = places_.emplace_back(*this, r, &robots_[r].start(n, boot()));
        for (const Subscription& subscription : place.node->subscriptions()) {
          auto& listeners = subscription.bus == BusId::kSwarm ? swarm_listeners_ : onboard_listeners_[r];
          listeners[subscription.channel].push_back(places_.size() - 1);
        }
        schedule_wake(places_.size() - 1, kEpoch_us);
      }
    }
    bool flying = true;
    for (std::int64_t now = kEpoch_us; flying; now += Simulation::kTick_us) {
      run_until(now);
      flying = tick(now, progress);
    }
    return report(1e-9 * static_cast<double>(steady_ns() - began_ns));
  }

 private:
  struct RobotNodes {
    RobotNodes(const World& world_in, const WorldRobot& robot_in, const FlightOptions& options_in)
        : world(world_in), robot(robot_in), options(options_in) {}

    const World& world;
    const WorldRobot& robot;
    const FlightOptions& options;
    MemoryPromiseStore promises;
    std::unique_ptr<MapNode> map;  // null: dead
    std::unique_ptr<PlannerNode> planner;
    std::unique_ptr<BroadcastNode> broadcast;
    PlanningSamples step_ms;
    std::vector<double> map_ms;
    int plans_seen = 0, maps_seen = 0;
    RobotReport before;  // of nodes that were killed

    // By the order of kDaemons.
    Node& start(std::size_t daemon, std::int32_t boot) {
      if (daemon == 0)
        return *(map = std::make_unique<MapNode>(map_config(world, robot, options), boot, steady_ns, false));
      if (daemon == 1)
        return *(planner =
                     std::make_unique<PlannerNode>(planner_config(world, robot, options), boot, steady_ns, false));
      return *(broadcast = std::make_unique<BroadcastNode>(broadcast_config(world, robot, options), promises, boot));
    }
    void kill(std::size_t daemon) {
      count(daemon, &before);
      if (daemon == 0) map.reset(), maps_seen = 0;
      if (daemon == 1) planner.reset(), plans_seen = 0;
      if (daemon == 2) broadcast.reset();
    }
    // Adds what a daemon that lives has counted.
    void count(std::size_t daemon, RobotReport* sum) const {
      const RefusalCounts* refused = nullptr;
      if (daemon == 0 && map) refused = &map->refused();
      if (daemon == 1 && planner) {
        refused = &planner->refused();
        sum->plans += planner->plans();
        sum->missed += planner->missed();
      }
      if (daemon == 2 && broadcast) refused = &broadcast->refused();
      for (std::size_t i = 1; refused != nullptr && i < sum->refused.size(); ++i)
        sum->refused[i] += (*refused)[static_cast<Refusal>(i)];
    }
    RobotReport report() const {
      RobotReport sum = before;
      for (std::size_t daemon = 0; daemon < kDaemons.size(); ++daemon) count(daemon, &sum);
      return sum;
    }
  };

  // Where a node sits; its messages go out from here.
  struct Place : Outbox {
    Place(LockstepHost& host_in, std::size_t robot_in, Node* node_in) : host(host_in), robot(robot_in), node(node_in) {}
    void publish_bytes(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) override {
      host.send(robot, bus, channel, bytes);
    }
    LockstepHost& host;
    std::size_t robot;
    Node* node;                // null: killed
    std::int64_t wake_us = 0;  // the wake-up in force; earlier entries in the queue are void
  };

  struct Event {
    std::int64_t time_us;
    std::size_t place;
    std::int64_t sequence;
    BusId bus;
    std::string channel;  // empty: a wake-up
    Bytes bytes;

    bool operator>(const Event& other) const {
      return std::tie(time_us, place, sequence) > std::tie(other.time_us, other.place, other.sequence);
    }
  };

  void schedule_wake(std::size_t place, std::int64_t time_us) {
    places_[place].wake_us = time_us;
    events_.push({time_us, place, sequence_++, BusId::kOnboard, {}, nullptr});
  }

  // One message onto a bus: logged, counted and queued for everybody who listens.
  void send(std::size_t robot, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) {
    const bool swarm = bus == BusId::kSwarm;
    std::int64_t delay = swarm ? delays_.swarm_us : delays_.onboard_us;
    if (channel == channel::kSogm) delay += delays_.map_us;
    if (channel == channel::kCandidate) delay += delays_.plan_us;
    if (logs_ != nullptr) logs_->write(bus, world_.robots[robot].id, now_us_, channel, bytes);
    ChannelCount& count = channels_[std::string(channel)];
    ++count.messages;
    count.bytes += static_cast<std::int64_t>(bytes.size());
    if (swarm && channel == channel::kTrajectory) audit_.hear(bytes, clock_offsets_us_[robot]);
    if (!swarm && channel == channel::kSetpoint) simulation_.vehicle(robot).on_setpoint(bytes);
    if (!swarm && channel == channel::kOwnTrajectory) simulation_.vehicle(robot).on_own_trajectory(bytes);
    const auto& listeners = swarm ? swarm_listeners_ : onboard_listeners_[robot];
    const auto heard = listeners.find(channel);
    if (heard == listeners.end()) return;
    const auto shared = std::make_shared<const std::vector<std::uint8_t>>(bytes.begin(), bytes.end());
    const double t_s = 1e-6 * static_cast<double>(now_us_ - kEpoch_us);
    for (const std::size_t place : heard->second) {
      const auto arrive = [&](std::int64_t later_us) {
        events_.push({now_us_ + delay + later_us, place, sequence_++, bus, std::string(channel), shared});
      };
      const std::size_t receiver = places_[place].robot;
      if (!swarm || receiver == robot) {
        arrive(0);
      } else {
        for (const std::int64_t later_us : link_.deliveries(world_.robots[robot].id, world_.robots[receiver].id, t_s))
          arrive(later_us);
      }
    }
  }

  void run_until(std::int64_t end_us) {
    while (!events_.empty() && events_.top().time_us <= end_us) {
      const Event event = events_.top();
      events_.pop();
      Place& place = places_[event.place];
      now_us_ = event.time_us;
      if (place.node == nullptr) continue;
      const std::int64_t offset_us = clock_offsets_us_[place.robot];
      if (!event.channel.empty()) {
        place.node->on_message(now_us_ + offset_us, event.bus, event.channel, *event.bytes, place);
      } else if (event.time_us != place.wake_us) {
        continue;
      }
      const std::int64_t wake = place.node->step(now_us_ + offset_us, place) - offset_us;
      if (wake != place.wake_us || event.channel.empty()) schedule_wake(event.place, wake);
      note_work(robots_[place.robot]);
    }
    now_us_ = end_us;
  }

  void note_work(RobotNodes& robot) {
    if (robot.map && robot.map->maps() != robot.maps_seen) {
      robot.maps_seen = robot.map->maps();
      robot.map_ms.push_back(robot.map->build_ms());
    }
    if (!robot.planner || robot.planner->plans() == robot.plans_seen) return;
    robot.plans_seen = robot.planner->plans();
    const auto& step_ms = robot.planner->newest_plan().step_ms;
    double total = 0.0;
    for (std::size_t i = 0; i < step_ms.size(); ++i) {
      robot.step_ms[i].push_back(step_ms[i]);
      total += step_ms[i];
    }
    robot.step_ms[step_ms.size()].push_back(total);
  }

  // The simulation's turn; false when the run is over.
  bool tick(std::int64_t now_us, const ProgressCallback& progress) {
    const std::int64_t since = now_us - kEpoch_us;
    const double t_s = 1e-6 * static_cast<double>(since);
    simulation_.tick(t_s, now_us);
    kill_and_restart(t_s);
    for (std::size_t r = 0; r < robots_.size(); ++r) {
      // Sensors of different robots are not synchronised.
      const std::int64_t phase = since + static_cast<std::int64_t>(r) * Simulation::kTick_us;
      if (since == 0 || phase % sensor_period_us_ < Simulation::kTick_us) {
        send_message(r, channel::kObstacles, simulation_.obstacles_message(r, t_s, now_us));
      }
      send_message(r, channel::kRobotState, simulation_.state_message(r, now_us));
      if (since % kGoalPeriod_us == 0) send_message(r, channel::kGoal, simulation_.goal_message(r, now_us));
    }
    if (simulation_.judge().finished()) return false;
    return !progress || since % 100'000 != 0 || progress(t_s, simulation_);
  }

  void kill_and_restart(double t_s) {
    for (auto& [kill, robot, is_down] : kills_) {
      const std::size_t place = kDaemons.size() * robot + kill.daemon;
      if (!is_down && t_s >= kill.at_s && t_s < kill.back_s) {
        is_down = true;
        robots_[robot].kill(kill.daemon);
        places_[place].node = nullptr;
      } else if (is_down && t_s >= kill.back_s) {
        is_down = false;
        places_[place].node = &robots_[robot].start(kill.daemon, boot());
        schedule_wake(place, now_us_);
      }
    }
  }
  std::int32_t boot() const { return static_cast<std::int32_t>(now_us_ / 1'000'000); }

  template <class T>
  void send_message(std::size_t robot, const char* channel, const T& message) {
    encode(message, &buffer_);
    send(robot, BusId::kOnboard, channel, buffer_);
  }

  RunReport report(double wall_s) const {
    std::vector<PlanningSamples> planning;
    std::vector<double> map_ms;
    for (const RobotNodes& robot : robots_) {
      planning.push_back(robot.step_ms);
      map_ms.insert(map_ms.end(), robot.map_ms.begin(), robot.map_ms.end());
    }
    RunReport report = make_report(world_.name, "lockstep", simulation_.judge(),
                                   1e-6 * static_cast<double>(now_us_ - kEpoch_us), wall_s, planning);
    report.mapping = timing_stats(std::move(map_ms));
    report.count_commits(audit_);
    report.channels.insert(channels_.begin(), channels_.end());
    for (std::size_t r = 0; r < robots_.size(); ++r) {
      RobotReport robot = robots_[r].report();
      robot.verdict = simulation_.judge().robots()[r];
      robot.plan_rate_hz = static_cast<double>(robot.plans) / report.duration_s;
      report.robots.push_back(robot);
    }
    return report;
  }

  const World& world_;
  LockstepDelays delays_;
  LinkModel link_;
  BusLog* logs_;
  CommitAudit audit_;
  std::vector<std::int64_t> clock_offsets_us_;
  Simulation simulation_;
  std::int64_t sensor_period_us_ = 0;
  std::deque<RobotNodes> robots_;
  struct PlannedKill {
    Kill kill;
    std::size_t robot;
    bool is_down = false;
  };
  std::vector<PlannedKill> kills_;
  std::deque<Place> places_;
  std::map<std::string, std::vector<std::size_t>, std::less<>> swarm_listeners_;
  std::map<std::size_t, std::map<std::string, std::vector<std::size_t>, std::less<>>> onboard_listeners_;
  std::priority_queue<Event, std::vector<Event>, std::greater<>> events_;
  std::int64_t now_us_ = kEpoch_us;
  std::int64_t sequence_ = 0;
  std::map<std::string, ChannelCount> channels_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace

RunReport run_lockstep(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                       const LockstepDelays& delays, BusLog* logs, TraceWriter* trace,
                       const ProgressCallback& progress) {
  LockstepHost host(world, static_map, options, delays, logs, trace);
  return host.run(progress);
}

}  // namespace swarm
