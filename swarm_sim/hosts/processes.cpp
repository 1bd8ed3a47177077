#include "swarm_sim/hosts/processes.h"

#include <spdlog/spdlog.h>

#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <sstream>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/realtime_host.h"
#include "swarm_sim/hosts/relay.h"
#include "swarm_sim/hosts/supervisor.h"
#include "swarm_sim/results/commit_audit.h"

namespace swarm {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kGoalPeriod_us = 1'000'000;
constexpr std::int64_t kReadyTimeout_us = 20'000'000;

// Removes itself and what it holds.
class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string pattern = (std::filesystem::temp_directory_path() / "swarm_sim.XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) throw std::runtime_error(pattern + ": cannot be made");
    path_ = pattern;
  }
  ~TemporaryDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// The clock of the run and the simulation behind it, shared by the robots' nodes: whoever comes first moves it on.
struct World4D {
  Simulation& simulation;
  const std::function<void(double, const Simulation&)>& progress;
  RealtimeHost& host;
  std::int64_t now_us;                   // last tick that was simulated
  std::optional<std::int64_t> start_us;  // world time 0

  double t_s(std::int64_t utime) const { return start_us ? 1e-6 * static_cast<double>(utime - *start_us) : -1.0; }

  void advance(std::int64_t until_us) {
    while (now_us + Simulation::kTick_us <= until_us) {
      now_us += Simulation::kTick_us;
      if (!start_us || now_us < *start_us) {
        simulation.settle(now_us);
        continue;
      }
      simulation.tick(t_s(now_us), now_us);
      if (progress && (now_us - *start_us) % 100'000 == 0) progress(t_s(now_us), simulation);
      if (simulation.judge().finished()) {
        host.stop();
        return;
      }
    }
  }
};

// What surrounds one robot: its sensors and its flight controller, on its onboard bus; and the recorder of that bus.
class RobotEnvironment : public Node {
 public:
  RobotEnvironment(World4D& world, std::size_t index, int id, std::int64_t sensor_period_us, bool hears_swarm,
                   bool own_swarm_bus, CommitAudit& audit, BusLog* logs)
      : world_(world),
        index_(index),
        id_(id),
        sensor_period_us_(sensor_period_us),
        hears_swarm_(hears_swarm),
        own_swarm_bus_(own_swarm_bus),
        logs_(logs),
        audit_(audit) {}

  std::vector<Subscription> subscriptions() const override {
    std::vector<Subscription> all;
    for (const char* channel : channels_of(BusId::kOnboard)) all.push_back({BusId::kOnboard, channel});
    if (hears_swarm_) all.push_back({BusId::kSwarm, channel::kTrajectory});
    return all;
  }

  void on_message(std::int64_t now_us, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox&) override {
    if (bus == BusId::kSwarm && own_swarm_bus_ && !is_own(bytes)) return;  // relayed: once is enough
    if (logs_ != nullptr) logs_->write(bus, id_, now_us, channel, bytes);
    ChannelCount& count = channels_[std::string(channel)];
    ++count.messages;
    count.bytes += static_cast<std::int64_t>(bytes.size());
    if (bus == BusId::kSwarm) return audit_.collect(bytes);
    if (channel == channel::kSetpoint)
      world_.simulation.on_setpoint(index_, bytes);
    else if (channel == channel::kOwnTrajectory)
      world_.simulation.on_own_trajectory(index_, bytes);
    else if (channel == channel::kMapStatus)
      read(bytes, &map_status_);
    else if (channel == channel::kBroadcastStatus)
      read(bytes, &broadcast_status_);
    else if (channel == channel::kPlannerStatus)
      note_plan(now_us, bytes);
  }

  std::int64_t step(std::int64_t now_us, Outbox& outbox) override {
    world_.advance(now_us);
    if (world_.now_us == last_tick_us_) return last_tick_us_ + Simulation::kTick_us;
    last_tick_us_ = world_.now_us;
    // Sensors of different robots are not synchronised.
    const std::int64_t phase = last_tick_us_ + static_cast<std::int64_t>(index_) * Simulation::kTick_us;
    const double t_s = world_.t_s(last_tick_us_);
    if (phase / sensor_period_us_ != last_detection_) {
      last_detection_ = phase / sensor_period_us_;
      outbox.publish(BusId::kOnboard, channel::kObstacles,
                     world_.simulation.obstacles_message(index_, t_s, last_tick_us_));
    }
    outbox.publish(BusId::kOnboard, channel::kRobotState, world_.simulation.state_message(index_, last_tick_us_));
    if (t_s >= 0.0 && last_tick_us_ >= next_goal_us_) {
      outbox.publish(BusId::kOnboard, channel::kGoal, world_.simulation.goal_message(index_, last_tick_us_));
      next_goal_us_ = last_tick_us_ + kGoalPeriod_us;
    }
    return last_tick_us_ + Simulation::kTick_us;
  }

  // What keeps the robot from flying; empty: nothing.
  std::string missing() const {
    using namespace sogm_swarm;
    if (broadcast_status_.header.utime == 0) return "broadcast_daemon: no status";
    if (broadcast_status_.state == broadcast_status_t::kClock)
      return "broadcast_daemon: a peer's clock differs too much";
    if (broadcast_status_.state != broadcast_status_t::kFlying)
      return "broadcast_daemon: waits for the robot's state or for peers";
    if (map_status_.header.utime == 0) return "map_daemon: no status";
    if (planner_status_.plans == 0) return "planner_daemon: no plan";
    return "";
  }

  int id() const { return id_; }
  const std::map<std::string, ChannelCount, std::less<>>& channels() const { return channels_; }
  const PlanningSamples& step_ms() const { return step_ms_; }
  // Whatever the daemons counted before the start of the world is not the flight's.
  void mark_start() { plans_before_ = planner_status_.plans, missed_before_ = planner_status_.missed; }

  RobotReport report(double duration_s) const {
    RobotReport robot;
    robot.verdict = world_.simulation.judge().robots()[index_];
    robot.plans = planner_status_.plans - plans_before_;
    robot.plan_rate_hz = static_cast<double>(robot.plans) / duration_s;
    robot.missed = planner_status_.missed - missed_before_;
    for (std::size_t i = 1; i < robot.refused.size(); ++i) {
      robot.refused[i] = map_status_.refused[i] + planner_status_.refused[i] + broadcast_status_.refused[i];
    }
    return robot;
  }
  std::int32_t lost() const { return broadcast_status_.lost; }

 private:
  bool is_own(std::span<const std::uint8_t> bytes) const {
    sogm_swarm::announcement_t message;
    return decode(bytes, &message) == Refusal::kNone && message.header.robot_id == id_;
  }

  template <class Status>
  bool read(std::span<const std::uint8_t> bytes, Status* status) {
    Status newest{};
    if (decode(bytes, &newest) != Refusal::kNone || newest.header.robot_id != id_) return false;
    *status = newest;
    return true;
  }

  void note_plan(std::int64_t now_us, std::span<const std::uint8_t> bytes) {
    const sogm_swarm::planner_status_t before = planner_status_;
    if (!read(bytes, &planner_status_)) return;
    if (planner_status_.header.boot != before.header.boot) {  // it counts from 0 again
      plans_before_ -= before.plans;
      missed_before_ -= before.missed;
    }
    if (world_.t_s(now_us) < 0.0 || planner_status_.plans == plans_seen_) return;
    plans_seen_ = planner_status_.plans;
    const sogm_swarm::planner_status_t& s = planner_status_;
    const double ms[] = {s.compose_ms, s.search_ms, s.corridor_ms, s.optimize_ms, s.check_ms, s.total_ms};
    for (std::size_t i = 0; i < step_ms_.size(); ++i) step_ms_[i].push_back(ms[i]);
  }

  World4D& world_;
  std::size_t index_;
  int id_;
  std::int64_t sensor_period_us_;
  bool hears_swarm_, own_swarm_bus_;
  BusLog* logs_;
  CommitAudit& audit_;
  std::int64_t last_tick_us_ = 0, last_detection_ = -1, next_goal_us_ = 0;
  sogm_swarm::map_status_t map_status_{};
  sogm_swarm::planner_status_t planner_status_{};
  sogm_swarm::broadcast_status_t broadcast_status_{};
  std::int32_t plans_seen_ = 0, plans_before_ = 0, missed_before_ = 0;
  PlanningSamples step_ms_;
  std::map<std::string, ChannelCount, std::less<>> channels_;
};

// A daemon's config file: what its --print-config would print.
template <class Config>
void write_config(Config config, std::int64_t clock_offset_us, const std::string& onboard_url,
                  const std::string* swarm_url, const std::filesystem::path& file) {
  OptionSet options("", "");
  declare(options, config);
  std::ostringstream text;
  const char* arguments[] = {"", "--print-config"};
  (void)options.parse(2, arguments, text);
  text << "clock-offset-ms = " << 1e-3 * static_cast<double>(clock_offset_us) << '\n';
  text << "onboard-url = " << onboard_url << '\n';
  if (swarm_url != nullptr) text << "swarm-url = " << *swarm_url << '\n';
  write_file(file, text.str());
}

// Where the radio between robots is modelled, each has a swarm bus of its own.
std::string own_swarm_url(int port) {
  return "udpm://239.255.76.69:" + std::to_string(port) + "?ttl=0";
}

// Two swarms on the same ports would fly each other's trajectories.
void refuse_used_bus(const std::string& url) {
  LcmBus bus(url);
  bool used = false;
  for (const char* channel : {channel::kTrajectory, channel::kSetpoint, channel::kRobotState}) {
    bus.subscribe(channel, [&used](std::string_view, std::span<const std::uint8_t>) { used = true; });
  }
  const auto deadline = std::chrono::steady_clock::now() + 150ms;
  boost::asio::io_context io;
  while (std::chrono::steady_clock::now() < deadline && !used) {
    boost::asio::steady_timer(io, 10ms).wait();
    bus.drain();
  }
  if (used) throw std::runtime_error(url + ": another swarm is on this bus; end it or choose another --base-port");
}

}  // namespace

RunReport run_processes(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                        const ProcessOptions& processes, BusLog* logs, TraceWriter* trace,
                        const std::function<void(double t_s, const Simulation&)>& progress) {
  const auto began = std::chrono::steady_clock::now();
  const TemporaryDirectory temporary;
  const std::filesystem::path out = processes.out.empty() ? temporary.path() : processes.out;
  const std::filesystem::path programs =
      processes.programs.empty() ? std::filesystem::read_symlink("/proc/self/exe").parent_path() : processes.programs;
  const std::string swarm = swarm_bus_url(processes.base_port);
  if (processes.netns.empty() && processes.start_daemons) refuse_used_bus(swarm);
  spdlog::set_level(spdlog::level::warn);

  Simulation simulation(world, static_map, options, trace);
  const bool relayed = !options.link.perfect(), apart = !processes.netns.empty();
  if (!processes.start_daemons && !options.kills.empty())
    throw OptionError("kill: daemons that were not started here cannot be killed either");
  if (relayed && apart) throw OptionError("netns: between namespaces the network is what it is; no --link-... with it");
  RealtimeHost host;
  const std::int64_t now = wall_utime();
  World4D clock{simulation, progress, host, now - now % Simulation::kTick_us, std::nullopt};
  Relay relay(options.link, seed_of(world.name), [&clock](std::int64_t utime) { return clock.t_s(utime); });
  CommitAudit audit;
  std::vector<std::unique_ptr<RobotEnvironment>> robots;
  std::vector<DaemonProgram> daemons;
  ChildProcesses children;
  for (std::size_t i = 0; i < world.robots.size(); ++i) {
    const WorldRobot& robot = world.robots[i];
    const std::string onboard = onboard_bus_url(processes.base_port, robot.id);
    const std::string netns = apart ? processes.netns + std::to_string(robot.id) : "";
    const InNamespace there(netns);
    const std::string robots_swarm = apart     ? swarm_bus_url(processes.base_port, 1)
                                     : relayed ? own_swarm_url(processes.base_port + 33 + 100 + robot.id)
                                               : swarm;
    const bool hears_swarm = relayed || apart || i == 0;
    robots.push_back(std::make_unique<RobotEnvironment>(clock, i, robot.id, std::llround(1e6 / options.sensor_rate_hz),
                                                        hears_swarm, relayed || apart, audit, logs));
    host.add("robot " + std::to_string(robot.id), *robots.back(), onboard, hears_swarm ? robots_swarm : "");
    if (relayed) host.add("relay of robot " + std::to_string(robot.id), relay.add_robot(robot.id), "", robots_swarm);
    if (!processes.start_daemons) continue;

    const auto file = [&](const char* daemon, const char* ending) {
      return out / ("robot" + std::to_string(robot.id) + "-" + daemon + ending);
    };
    const std::int64_t clock_us = simulation.clock_offset_us(i);
    write_config(map_config(world, robot, options), clock_us, onboard, nullptr, file("map", ".cfg"));
    write_config(planner_config(world, robot, options), clock_us, onboard, nullptr, file("planner", ".cfg"));
    BroadcastConfig broadcast = broadcast_config(world, robot, options);
    broadcast.state_dir = temporary.path().string();
    write_config(broadcast, clock_us, onboard, &robots_swarm, file("broadcast", ".cfg"));
    for (const char* daemon : kDaemons) {
      const std::string program = std::string(daemon) + "_daemon";
      daemons.push_back({"robot " + std::to_string(robot.id) + "'s " + program,
                         programs / program,
                         {"--config", file(daemon, ".cfg").string()},
                         file(daemon, ".log"),
                         netns});
      std::filesystem::remove(daemons.back().log);  // of an earlier flight
      daemons.back().start(children);
    }
  }
  std::vector<Supervised> kills;
  for (const Kill& kill : options.kills) {
    const std::size_t place = index_of_robot(world, kill.robot_id, "kill");
    kills.emplace_back(kill, daemons[kDaemons.size() * place + kill.daemon]);
  }

  // Are all children alive, and is everybody ready? Daemons that shall crash do.
  std::optional<std::string> failure;
  boost::asio::steady_timer timer(host.io());
  std::function<void(const boost::system::error_code&)> watch = [&](const boost::system::error_code& error) {
    if (error) return;
    failure = children.find_ended();
    if (clock.start_us) {
      for (Supervised& kill : kills) kill.follow(clock.t_s(clock.now_us), children);
    }
    std::string missing;
    for (const auto& robot : robots) {
      if (missing.empty() && !robot->missing().empty())
        missing = "robot " + std::to_string(robot->id()) + "'s " + robot->missing();
    }
    if (!clock.start_us && missing.empty()) {
      clock.start_us = clock.now_us + 2 * Simulation::kTick_us;
      for (const auto& robot : robots) robot->mark_start();
    } else if (!clock.start_us && wall_utime() > now + kReadyTimeout_us) {
      failure = missing + " within " + std::to_string(kReadyTimeout_us / 1'000'000) + " s";
    }
    if (failure) {
      host.stop();
      return;
    }
    timer.expires_after(20ms);
    timer.async_wait(watch);
  };
  watch({});
  host.run();
  if (failure) throw std::runtime_error(*failure);
  if (!simulation.judge().finished()) throw Interrupted();

  std::vector<PlanningSamples> planning;
  for (const auto& robot : robots) planning.push_back(robot->step_ms());
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - began;
  RunReport report =
      make_report(world.name, "processes", simulation.judge(), clock.t_s(clock.now_us), wall.count(), planning);
  for (const auto& robot : robots) {
    report.robots.push_back(robot->report(report.duration_s));
    for (const auto& [name, count] : robot->channels()) {
      report.channels[name].messages += count.messages;
      report.channels[name].bytes += count.bytes;
    }
    report.channels[channel::kTrajectory].lost += robot->lost();
  }
  audit.finish(options.clock_offset_ms);
  report.count_commits(audit);
  return report;
}

}  // namespace swarm
