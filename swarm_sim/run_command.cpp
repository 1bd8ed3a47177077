#include "swarm_sim/run_command.h"

#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "swarm_sim/lockstep.h"
#include "swarm_sim/processes.h"
#include "swarm_sim/world_json.h"

namespace swarm {
namespace {

struct RunOptions {
  std::string world, mode = "lockstep", out;
  std::string map_config, planner_config, broadcast_config;
  FlightOptions flight;
  ProcessOptions processes;
};

// Overlays a daemon's config file, in the format its --print-config prints, on its defaults.
template <class Config>
void overlay(const std::string& file, Config* config) {
  if (file.empty()) return;
  OptionSet options("swarm_sim run", "");
  declare(options, *config);
  const char* arguments[] = {"run", "--config", file.c_str()};
  (void)options.parse(3, arguments, std::cout);
  verify(*config);
}

void declare(OptionSet& options, RunOptions& run) {
  options.add_positional("world", &run.world, "world file (JSON)");
  options.add(
      "mode", &run.mode,
      "lockstep: all nodes in this process, deterministic and faster than real time; processes: real daemons over "
      "real multicast",
      [](const std::string& mode) {
        if (mode != "lockstep" && mode != "processes") throw OptionError("must be lockstep or processes");
      });
  options.add("out", &run.out,
              "directory for trace.csv, report.json and the LCM logs; none: only the table is printed");
  options.add("time-limit", &run.flight.time_limit_s, 0.1, 3600, "s", "of simulated time");
  options.add("sensor-rate", &run.flight.sensor_rate_hz, 1, 100, "Hz", "of obstacle detections");
  options.add("map-config", &run.map_config,
              "config file for every map_daemon; identity and map file come from the world");
  options.add("planner-config", &run.planner_config,
              "config file for every planner_daemon; identity, limits and space come from the world");
  options.add("broadcast-config", &run.broadcast_config,
              "config file for every broadcast_daemon; identity, limits and roster come from the world");
  options.add("base-port", &run.processes.base_port, 1024, 60000, "",
              "processes: port of the swarm bus is this, robot k's onboard bus this + 33 + k");
}

std::string option_text(double value) {
  std::string text = std::to_string(value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

// One line that renews itself on a terminal, and a line every ten simulated seconds elsewhere.
class ProgressLine {
 public:
  void show(double t_s, const Judge& judge) {
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
};

volatile std::sig_atomic_t interrupted = 0;

RunReport fly(const RunOptions& run, const World& world, const OccupiedCubes* static_map, BusLog* logs,
              TraceWriter* trace) {
  ProgressLine line;
  RunReport report;
  if (run.mode == "processes") {
    report = run_processes(world, static_map, run.flight, run.processes, logs, trace,
                           [&](double t_s, const Simulation& simulation) { line.show(t_s, simulation.judge()); });
  } else {
    std::signal(SIGINT, [](int) { interrupted = 1; });
    report = run_lockstep(world, static_map, run.flight, LockstepDelays(), logs, trace,
                          [&](double t_s, const Simulation& simulation) {
                            line.show(t_s, simulation.judge());
                            return interrupted == 0;
                          });
    if (interrupted != 0) throw Interrupted();
  }
  line.done();
  report.options = {{"time-limit", option_text(run.flight.time_limit_s)},
                    {"sensor-rate", option_text(run.flight.sensor_rate_hz)}};
  return report;
}

}  // namespace

int run_command(int argc, const char* const* argv) try {
  RunOptions run;
  OptionSet options("swarm_sim run", "Flies a world to its end and judges the flight by exact geometry.");
  declare(options, run);
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  overlay(run.map_config, &run.flight.map);
  overlay(run.planner_config, &run.flight.planner);
  overlay(run.broadcast_config, &run.flight.broadcast);

  const World world = read_world(run.world);
  std::optional<OccupiedCubes> static_map;
  if (!world.static_map.empty()) {
    static_map = OccupiedCubes::load(world.static_map);
    check_starts(world, *static_map);
  }
  const std::filesystem::path out = run.out;
  std::optional<BusLog> logs;
  std::optional<TraceWriter> trace;
  if (!run.out.empty()) {
    std::filesystem::create_directories(out);
    std::vector<int> ids;
    for (const WorldRobot& robot : world.robots) ids.push_back(robot.id);
    logs.emplace(out, ids);
    trace.emplace(out / "trace.csv");
    run.processes.out = out;
  }
  const RunReport report =
      fly(run, world, static_map ? &*static_map : nullptr, logs ? &*logs : nullptr, trace ? &*trace : nullptr);
  if (!run.out.empty()) {
    trace->close();
    logs->close();
    write_report(report, out / "report.json");
  }
  std::cout << summary_table(report) << std::flush;
  return report.outcome == Outcome::kSuccess ? 0 : 1;
} catch (const Interrupted&) {
  std::cerr << "\nswarm_sim run: interrupted; nothing was written\n";
  return 130;
} catch (const std::exception& error) {
  std::cerr << "swarm_sim run: " << error.what() << '\n';
  return 2;
}

}  // namespace swarm
