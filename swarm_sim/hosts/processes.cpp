#include "swarm_sim/hosts/processes.h"

#include <spdlog/spdlog.h>

#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <deque>
#include <optional>
#include <set>
#include <sstream>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/cell_channels.h"
#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/realtime_host.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "lcmtypes/bus/text.h"
#include "swarm_sim/environment/environment_node.h"
#include "swarm_sim/hosts/relay.h"
#include "swarm_sim/hosts/robot_watch.h"
#include "swarm_sim/hosts/supervisor.h"
#include "swarm_sim/results/bus_recorder.h"
#include "swarm_sim/world/clocks.h"

namespace swarm {
namespace {

constexpr int kMaxProcessId = 99;  // of a robot: ports are counted by ids
constexpr Duration kReadyTimeout = 20s;

// A daemon's config file: what its --print-config would print.
template <class Config>
void write_config(Config config, const std::string& more, const std::filesystem::path& file) {
  OptionSet options("", "");
  declare(options, config);
  std::ostringstream text;
  const char* arguments[] = {"", "--print-config"};
  (void)options.parse(2, arguments, text);
  text << more;
  write_file(file, text.str());
}

// Where the radio between robots is modelled, each has a swarm bus of its own.
std::string own_swarm_url(int port) {
  return "udpm://239.255.76.69:" + std::to_string(port) + "?ttl=0";
}

// On which robots and keepers speak in the cells of this world.
std::set<std::string> cell_channels(const World& world, const FlightOptions& options) {
  if (options.cells_m == 0.0) return {};
  return heard_on(cells_kept(keeper_config(world, options)));
}

// Two swarms on the same ports would fly each other's trajectories.
void refuse_used_bus(const std::string& url, std::set<std::string> channels) {
  LcmBus bus(url);
  bool used = false;
  for (const char* channel : {channel::kAnnouncement, channel::kSetpoint, channel::kRobotState})
    channels.insert(channel);
  for (const std::string& channel : channels)
    bus.subscribe(channel, [&used](std::string_view, std::span<const std::uint8_t>) { used = true; });
  const auto deadline = std::chrono::steady_clock::now() + 150ms;
  boost::asio::io_context io;
  while (std::chrono::steady_clock::now() < deadline && !used) {
    boost::asio::steady_timer(io, 10ms).wait();
    bus.drain();
  }
  if (used) throw std::runtime_error(url + ": another swarm is on this bus; end it or choose another --base-port");
}

// Where a robot's daemons are.
struct RobotPlace {
  std::string onboard_url, swarm_url;
  std::string netns;  // empty: this one
  SwarmShare share = SwarmShare::kAll;
};

std::vector<RobotPlace> places_of(const World& world, const ProcessOptions& processes, bool relayed) {
  std::vector<RobotPlace> places;
  for (const WorldRobot& robot : world.robots) {
    RobotPlace& place = places.emplace_back();
    place.onboard_url = onboard_bus_url(processes.base_port, robot.id);
    if (!processes.netns.empty()) {
      place.netns = processes.netns + std::to_string(robot.id);
      place.swarm_url = swarm_bus_url(processes.base_port, 1);
      place.share = SwarmShare::kOwn;
    } else if (relayed) {
      place.swarm_url = own_swarm_url(processes.base_port + 33 + 100 + robot.id);
      place.share = SwarmShare::kOwn;
    } else {
      place.swarm_url = swarm_bus_url(processes.base_port);
      place.share = places.size() == 1 ? SwarmShare::kAll : SwarmShare::kNone;
    }
  }
  return places;
}

// Where daemons come from and where they put things.
struct DaemonDirectories {
  std::filesystem::path programs, out, promises, key_file;
};

SwarmKeys make_keys(const std::filesystem::path& file) {
  const std::string key = SwarmKeys::fresh();
  write_file(file, key);
  std::filesystem::permissions(file, std::filesystem::perms::owner_read);
  return SwarmKeys(key);
}

// A robot's daemons in the order of kDaemons, with their config files written.
std::vector<DaemonProgram> daemons_of(const World& world, const WorldRobot& robot, const FlightOptions& options,
                                      const RobotPlace& place, Duration clock, const DaemonDirectories& directories) {
  const auto file = [&](const std::string& daemon, const char* ending) {
    return directories.out / ("robot" + std::to_string(robot.id) + "-" + daemon + ending);
  };
  const std::string bus = "clock-offset-ms = " + text_of(to_ms(clock)) + "\nonboard-url = " + place.onboard_url + "\n";
  write_config(map_config(world, robot, options), bus, file("map", ".cfg"));
  write_config(planner_config(world, robot, options), bus, file("planner", ".cfg"));
  BroadcastConfig broadcast = broadcast_config(world, robot, options);
  broadcast.state_dir = directories.promises.string();
  write_config(broadcast,
               bus + "swarm-url = " + place.swarm_url + "\nkey-file = " + directories.key_file.string() + "\n",
               file("broadcast", ".cfg"));
  std::vector<DaemonProgram> daemons;
  if (world.sensor.is_ranging())
    write_config(perception_config(world, robot, options), bus, file("perception", ".cfg"));
  for (const char* daemon : daemons_in(world)) {
    const std::string program = std::string(daemon) + "_daemon";
    daemons.push_back({"robot " + std::to_string(robot.id) + "'s " + program,
                       directories.programs / program,
                       {"--config", file(daemon, ".cfg").string()},
                       file(daemon, ".log"),
                       place.netns});
  }
  return daemons;
}

// Of all cells, with its config file written and its books begun.
DaemonProgram keeper_of(const World& world, const FlightOptions& options, const std::string& swarm_url,
                        const DaemonDirectories& directories) {
  KeeperConfig config = keeper_config(world, options);
  config.state_dir = directories.promises / "keeper";
  FileBookStore::begin(config.state_dir, config.cell_m);
  const std::filesystem::path file = directories.out / "keeper.cfg";
  write_config(config, "swarm-url = " + swarm_url + "\nkey-file = " + directories.key_file.string() + "\n", file);
  return {"the keeper_daemon",
          directories.programs / "keeper_daemon",
          {"--config", file.string()},
          directories.out / "keeper.log",
          ""};
}

// With what the setpoints are to be given on their way; the rest as on a robot.
void start_bridge(const World& world, const WorldRobot& robot, const RobotPlace& place, const std::string& targets,
                  int port, const DaemonDirectories& directories, ChildProcesses& children) {
  const std::filesystem::path log = directories.out / ("robot" + std::to_string(robot.id) + "-bridge.log");
  children.start(
      "robot " + std::to_string(robot.id) + "'s mavlink_bridge", directories.programs / "mavlink_bridge",
      {"--robot-id", std::to_string(robot.id), "--onboard-url", place.onboard_url, "--link",
       "udp:" + std::to_string(port), "--lead", text_of(1e-3 * world.vehicle.lead_ms), "--lag",
       text_of(1e-3 * world.vehicle.lag_ms), "--drag", text_of(world.vehicle.drag_per_s), "--targets", targets},
      log);
}

// Its vehicles are told what they are told by bridges.
World bridged(World world) {
  world.vehicle.lead_ms = world.vehicle.lag_ms = world.vehicle.drag_per_s = 0.0;
  return world;
}

// Sees every 20 ms to it that the daemons live, but for those that shall crash, and starts the world when all robots
// are ready.
class Overseer {
 public:
  Overseer(RealtimeHost& host, ChildProcesses& children, Simulation& simulation, std::deque<RobotWatch>& robots,
           std::vector<Supervised> crashing)
      : host_(host),
        children_(children),
        simulation_(simulation),
        robots_(robots),
        crashing_(std::move(crashing)),
        timer_(host.io()),
        give_up_(wall_utime() + kReadyTimeout) {
    look();
  }

  // What ended the run, if anything went wrong.
  const std::optional<std::string>& failure() const { return failure_; }

 private:
  void look() {
    failure_ = children_.find_ended();
    if (simulation_.started()) {
      for (Supervised& daemon : crashing_) daemon.follow(simulation_.t_s(simulation_.now()), children_);
    } else if (!failure_) {
      start_when_ready();
    }
    if (failure_) return host_.stop();
    timer_.expires_after(20ms);
    timer_.async_wait([this](const boost::system::error_code& error) {
      if (!error) look();
    });
  }

  void start_when_ready() {
    std::string missing;
    for (std::size_t i = 0; i < robots_.size() && missing.empty(); ++i) {
      missing = robots_[i].missing();
      if (!missing.empty()) missing = "robot " + std::to_string(simulation_.world().robots[i].id) + "'s " + missing;
    }
    if (missing.empty()) {
      simulation_.start(simulation_.now() + 2 * Simulation::kTick);
      for (RobotWatch& robot : robots_) robot.mark_start();
      children_.begin_processor_time();
    } else if (wall_utime() > give_up_) {
      failure_ = missing + " within " + std::to_string(kReadyTimeout / 1s) + " s";
    }
  }

  RealtimeHost& host_;
  ChildProcesses& children_;
  Simulation& simulation_;
  std::deque<RobotWatch>& robots_;
  std::vector<Supervised> crashing_;
  boost::asio::steady_timer timer_;
  Utime give_up_;
  std::optional<std::string> failure_;
};

RunReport report_of(const Simulation& simulation, const std::deque<RobotWatch>& robots, double wall_s) {
  std::vector<PlanningSamples> planning;
  std::vector<RobotReport> counts;
  for (const RobotWatch& robot : robots) {
    planning.push_back(robot.step_ms());
    counts.push_back(robot.counts());
  }
  RunReport report = make_report("processes", simulation, wall_s, planning, std::move(counts));
  for (const RobotWatch& robot : robots) report.channels[channel::kAnnouncement].lost += robot.lost();
  return report;
}

}  // namespace

RunReport run_processes(const World& world, const OccupiedCubes* static_map, const FlightOptions& options,
                        const ProcessOptions& processes, BusLog* logs, FlightTrace* trace,
                        const ProgressCallback& progress) {
  const std::chrono::nanoseconds began = stopwatch();
  const std::filesystem::path memory = "/dev/shm";  // as on robots: promises do not wait for a disk
  const TemporaryDirectory temporary(
      "swarm_sim", std::filesystem::is_directory(memory) ? memory : std::filesystem::temp_directory_path());
  const DaemonDirectories directories = {
      processes.programs.empty() ? std::filesystem::read_symlink("/proc/self/exe").parent_path() : processes.programs,
      processes.out.empty() ? temporary.path() : processes.out, temporary.path(), temporary.path() / "swarm.key"};
  // This flight's own: other swarms on the bus are not heard.
  const SwarmKeys keys = processes.start_daemons ? make_keys(directories.key_file) : SwarmKeys();
  const std::set<std::string> cells = cell_channels(world, options);
  if (processes.netns.empty() && processes.start_daemons) refuse_used_bus(swarm_bus_url(processes.base_port), cells);
  spdlog::set_level(spdlog::level::warn);
  check_robots(world, options);
  for (const WorldRobot& robot : world.robots) {
    if (robot.id > kMaxProcessId) {
      throw OptionError("robot " + std::to_string(robot.id) + ": processes have ports for ids up to " +
                        std::to_string(kMaxProcessId) + "; --mode lockstep");
    }
  }
  const bool relayed = !options.link.perfect();
  if (!processes.start_daemons && !options.kills.empty())
    throw OptionError("kill: daemons that were not started here cannot be killed either");
  if (processes.start_daemons && !options.clock_steps.empty())
    throw OptionError("clock-step: of daemons that were started here, only in lock-step; no clock is set for them");
  if (!processes.mavlink.empty() &&
      (!processes.start_daemons || !processes.netns.empty() || options.clock_offset_ms != 0.0))
    throw OptionError("mavlink: with daemons that are started here, by one clock, in one network namespace");
  if (processes.mavlink == "attitude" && world.vehicle.kind != "quadrotor")
    throw OptionError("mavlink: attitude is for --vehicle quadrotor; '" + world.vehicle.kind + "' has none");
  if (options.link.rate_mbps > 0.0)
    throw OptionError("link-rate-mbps: only in lock-step; between processes no channel is modelled");
  if (!cells.empty() && (relayed || !processes.netns.empty()))
    throw OptionError("cells: between processes on one bus; no --link-... or --netns with it");
  if (relayed && !processes.netns.empty())
    throw OptionError("netns: between namespaces the network is what it is; no --link-... with it");

  if (!processes.out.empty()) remove_results(processes.out);
  RealtimeHost host;
  const World simulated = !processes.mavlink.empty() ? bridged(world) : world;
  Simulation simulation(simulated, static_map,
                        {options.time_limit_s, options.clock_offset_ms, options.clock_steps, options.state_outages},
                        wall_utime(), follow_flight(trace, progress, [&host] { host.stop(); }));
  const auto world_time = [&](Utime utime) { return simulation.t_s(utime); };
  Relay relay(options.link, seed_of(world.name), world_time);
  BusRecorder recorder(logs, !options.clock_steps.empty(), options.clock_offset_ms, world_time);
  const std::vector<RobotPlace> places = places_of(world, processes, relayed);
  const std::vector<Duration> clocks = clock_offsets(options.clock_offset_ms, world);
  const std::int32_t boot = new_boot();
  std::deque<EnvironmentNode> environments;
  std::deque<Autopilot> autopilots;
  std::deque<RobotWatch> watches;
  std::vector<DaemonProgram> daemons;
  ChildProcesses children;
  for (std::size_t i = 0; i < world.robots.size(); ++i) {
    const WorldRobot& robot = world.robots[i];
    const RobotPlace& place = places[i];
    const std::string name = "robot " + std::to_string(robot.id);
    const InNamespace there(place.netns);
    host.add(name, watches.emplace_back(robot.id, place.share, recorder, cells), place.onboard_url,
             place.share == SwarmShare::kNone ? "" : place.swarm_url, {}, keys);
    host.add("environment of " + name, environments.emplace_back(simulation, i, boot, processes.mavlink.empty()),
             place.onboard_url, "");
    if (relayed) host.add("relay of " + name, relay.add_robot(robot.id), "", place.swarm_url, {}, keys);
    if (!processes.start_daemons) continue;
    if (!processes.mavlink.empty()) {
      const int port = processes.base_port + 66 + robot.id;
      start_bridge(world, robot, place, processes.mavlink, port, directories, children);
      autopilots.emplace_back(host.io(), port, simulation, i, processes.autopilot);
    }
    for (DaemonProgram& daemon : daemons_of(world, robot, options, place, clocks[i], directories)) {
      daemon.start(children);
      daemons.push_back(std::move(daemon));
    }
  }
  std::optional<DaemonProgram> keeper;
  if (!cells.empty() && processes.start_daemons) {
    keeper = keeper_of(world, options, swarm_bus_url(processes.base_port), directories);
    keeper->start(children);
  }
  std::vector<Supervised> crashing;
  for (const Kill& kill : options.kills) {
    if (kill.daemon == Kill::kKeeper) {
      crashing.emplace_back(kill, *keeper);
      continue;
    }
    const std::size_t robot = index_of_robot(world, kill.robot_id, "kill");
    crashing.emplace_back(kill, daemons[daemons_in(world).size() * robot + kill.daemon]);
  }
  Overseer overseer(host, children, simulation, watches, std::move(crashing));
  host.run();
  if (overseer.failure()) throw std::runtime_error(*overseer.failure());
  const bool has_flown = simulation.started() && simulation.t_s(simulation.now()) > 0.0;
  if (!simulation.judge().finished() && !(world.is_endless() && has_flown)) throw Interrupted();

  const std::chrono::duration<double> wall = stopwatch() - began;
  RunReport report = report_of(simulation, watches, wall.count());
  for (std::size_t i = 0; i < daemons.size(); ++i) {
    const std::size_t num_daemons = daemons_in(world).size();
    report.robots[i / num_daemons].processor.emplace_back(daemons_in(world)[i % num_daemons],
                                                          children.processor_s(daemons[i].name) / report.duration_s);
  }
  recorder.finish(&report);
  return report;
}

}  // namespace swarm
