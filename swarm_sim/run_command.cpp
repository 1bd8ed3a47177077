#include "swarm_sim/run_command.h"

#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <optional>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "swarm_sim/campaign/flight_arguments.h"
#include "swarm_sim/campaign/usable_cores.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/hosts/processes.h"
#include "swarm_sim/world/walls.h"
#include "swarm_sim/world/world_json.h"
#include "swarm_sim/world/world_list.h"

namespace swarm {
namespace {

struct RunOptions {
  std::string world, mode = "lockstep", out, keep_maps;
  bool log_buses = true;
  int jobs = 0;
  FlightArguments flight;
  ProcessOptions processes;
};

void declare(OptionSet& options, RunOptions& run) {
  options.add_positional("world", &run.world, "world file (JSON), or FILE.jsonl[.gz]:N for the world in line N");
  options.add(
      "mode", &run.mode,
      "lockstep: all nodes in this process, deterministic and faster than real time; processes: real daemons over "
      "real multicast",
      [](const std::string& mode) {
        if (mode != "lockstep" && mode != "processes") throw OptionError("must be lockstep or processes");
      });
  options.add("out", &run.out,
              "directory for world.json, trace.csv, report.json and the LCM logs; none: only the table is printed");
  options.add("log-buses", &run.log_buses,
              "where results go to a directory: also the LCM logs of all buses, some 0.7 MB a second for each robot");
  options.add("jobs", &run.jobs, 0, 1024, "",
              "lockstep: robots whose daemons are at work at a time; 0: as many as it may use cores, also by Slurm's "
              "count. The results are the same");
  options.add("keep-maps", &run.keep_maps,
              "directory in which robots with range sensors keep what they have seen to stand, from flight to flight: "
              "robotK.bt (OctoMap); none: only while they fly");
  declare(options, run.flight);
  options.add("base-port", &run.processes.base_port, 1024, 60000, "",
              "processes: port of the swarm bus is this, robot k's onboard bus this + 33 + k, its own "
              "swarm bus over a modelled link this + 133 + k");
  options.add("daemons", &run.processes.start_daemons,
              "processes: start the daemons; false: they run already, as services or on other computers, with robots "
              "and limits as in the world");
  options.add("mavlink", &run.processes.mavlink,
              "processes: robots fly through mavlink_bridge and a simulated flight controller, on UDP port base-port + "
              "66 + k, which is told position or attitude; none: they follow the setpoints on the bus",
              [](const std::string& targets) {
                if (!targets.empty() && targets != "position" && targets != "attitude")
                  throw OptionError("must be position or attitude");
              });
  options.add("on-ground", &run.processes.autopilot.on_ground,
              "mavlink: robots stand at their starts, disarmed, and take off when they are ordered to (swarm_goal)");
  options.add("battery-s", &run.processes.autopilot.battery_s, 0, 1e6, "s",
              "mavlink: so long a battery lasts while its robot is armed; 0: nothing is told of it");
  options.add(
      "netns", &run.processes.netns,
      "processes: robot k's daemons and buses are in the network namespace of this name and k (needs root); none: "
      "all are in this one");
}

// One line that renews itself on a terminal, and a line every ten simulated seconds elsewhere; and each touch at once.
class ProgressLine {
 public:
  void show(double t_s, const Judge& judge) {
    for (; touches_ < judge.touches().size(); ++touches_)
      std::fprintf(stderr, "%s%s\n", terminal_ ? "\r" : "", line_of(judge.touches()[touches_]).c_str());
    std::size_t arrived = 0;
    for (const RobotVerdict& robot : judge.robots()) arrived += robot.flight_time_s ? 1 : 0;
    if (!terminal_ && t_s < next_s_) return;
    next_s_ = t_s + 10.0;
    std::fprintf(stderr, "%st = %5.1f s  arrived %zu/%zu  touches %zu%s", terminal_ ? "\r" : "", t_s, arrived,
                 judge.robots().size(), judge.touches().size(), terminal_ ? "  " : "\n");
  }
  void done() {
    if (terminal_) std::fprintf(stderr, "\n");
  }

 private:
  bool terminal_ = ::isatty(STDERR_FILENO) != 0;
  double next_s_ = 0.0;
  std::size_t touches_ = 0;  // that were said
};

void verify(const RunOptions& run) {
  if (!run.processes.mavlink.empty() && run.mode != "processes")
    throw OptionError("mavlink: in lock-step there is no mavlink_bridge; --mode processes");
  if (run.processes.mavlink.empty() && (run.processes.autopilot.on_ground || run.processes.autopilot.battery_s > 0.0))
    throw OptionError("on-ground, battery-s: of a flight controller; --mavlink position or attitude");
}

volatile std::sig_atomic_t stopped = 0;

RunReport fly(const RunOptions& run, const FlightOptions& flight, const World& world, const OccupiedCubes* static_map,
              BusLog* logs, FlightTrace* trace) {
  ProgressLine line;
  const auto progress = [&](double t_s, const Simulation& simulation) {
    line.show(t_s, simulation.judge());
    return stopped == 0;
  };
  RunReport report;
  if (run.mode == "processes") {
    report = run_processes(world, static_map, flight, run.processes, logs, trace, progress);
  } else {
    for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { stopped = 1; });
    report = run_lockstep(world, static_map, flight, LockstepDelays(), logs, trace, progress,
                          run.jobs > 0 ? run.jobs : usable_cores());
    if (stopped != 0 && !world.is_endless()) throw Interrupted();
  }
  line.done();
  report.options = option_values(run.flight);
  return report;
}

}  // namespace

int run_command(int argc, const char* const* argv) try {
  RunOptions run;
  OptionSet options("swarm_sim run", "Flies a world to its end and judges the flight by exact geometry.");
  declare(options, run);
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  verify(run);
  FlightOptions flight = flight_options(run.flight);  // bad input is found before anything is made
  if (!run.keep_maps.empty()) flight.kept_maps = std::filesystem::absolute(run.keep_maps);

  const World read = read_listed_world(run.world);
  const TemporaryDirectory scratch("swarm_sim");
  const World world = flown_world(with_walls_in_file(read, scratch.path()), run.flight);
  std::optional<OccupiedCubes> static_map;
  if (!world.static_map.empty()) {
    static_map = OccupiedCubes::load(world.static_map);
    check_starts(world, *static_map);
  }
  check_robots(world, flight);
  if (!flight.kept_maps.empty()) std::filesystem::create_directories(flight.kept_maps);
  const std::filesystem::path out = run.out;
  std::optional<BusLog> logs;
  std::optional<FlightTrace> trace;
  if (!run.out.empty()) {
    std::filesystem::create_directories(out);
    if (run.mode == "lockstep") remove_results(out);  // processes: when nothing is in the way of the flight
    std::vector<int> ids;
    for (const WorldRobot& robot : world.robots) ids.push_back(robot.id);
    if (run.log_buses) logs.emplace(out, ids);
    trace.emplace(out, world.vehicle.kind == "perfect");
    run.processes.out = out;
  }
  const auto keep = [&] {
    if (run.out.empty()) return;
    trace->close();
    if (logs) logs->close();
    write_file(out / "world.json", to_json_text(read, std::filesystem::absolute(out)));
  };
  RunReport report;
  try {
    report = fly(run, flight, world, static_map ? &*static_map : nullptr, logs ? &*logs : nullptr,
                 trace ? &*trace : nullptr);
  } catch (const Interrupted&) {
    keep();
    std::cerr << "\nswarm_sim run: interrupted; "
              << (run.out.empty() ? "nothing was to be kept" : "what was flown is in " + run.out + ", without a report")
              << '\n';
    return 130;
  }
  keep();
  if (!run.out.empty()) write_report(report, out / "report.json");
  std::cout << summary_table(report) << std::flush;
  return report.outcome == Outcome::kSuccess && report.commit_conflicts == 0 ? 0 : 1;
} catch (const std::exception& error) {
  std::cerr << "swarm_sim run: " << error.what() << '\n';
  return 2;
}

}  // namespace swarm
