// oracle WORLD DIR: after `swarm_sim run WORLD --out DIR` ended in a collision, says for each robot that touched
// something how late it could still have escaped, had it known the future.
#include "tests/bench/oracle.h"

#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "swarm_sim/results/csv.h"
#include "swarm_sim/world/world_list.h"

namespace swarm {
namespace {

using Trace = std::map<int, std::vector<MotionState>>;  // by robot id, every 10 ms from t = 0

Trace read_trace(const std::filesystem::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  if (line != "t,robot,x,y,z,vx,vy,vz,ax,ay,az") throw std::runtime_error(path.string() + ": must be a trace.csv");
  Trace trace;
  while (std::getline(in, line)) {
    std::vector<double> values;
    for (const std::string& cell : csv_cells(line)) values.push_back(std::stod(cell));
    MotionState state;
    state.position = {values.at(2), values.at(3), values.at(4)};
    state.velocity = {values.at(5), values.at(6), values.at(7)};
    trace[static_cast<int>(values.at(1))].push_back(state);
  }
  return trace;
}

int judge_run(const std::string& world_file, const std::filesystem::path& directory) {
  const World world = read_listed_world(world_file);
  const Trace trace = read_trace(directory / "trace.csv");
  std::ifstream in(directory / "report.json");
  const auto report = nlohmann::json::parse(in);
  const auto state_of = [&](std::size_t index, double t_s) {
    const auto& states = trace.at(world.robots[index].id);
    const auto step = static_cast<std::size_t>(std::llround(std::max(0.0, t_s) / 0.01));
    return states[std::min(step, states.size() - 1)];
  };
  if (report["touches"].empty()) std::cout << "oracle: nothing touched\n";
  for (const auto& touch : report["touches"]) {
    const int id = touch["robot"];
    const double touch_s = touch["t"];
    std::size_t index = 0;
    while (world.robots[index].id != id) ++index;
    Oracle oracle(world, index, [&](std::size_t k, double t) { return state_of(k, t).position; });
    std::cout << "oracle: robot " << id << " touched " << touch["counterpart"].get<std::string>() << ' '
              << touch["other"] << " at " << touch_s << " s: ";
    double before_s = 0.1;
    while (before_s < touch_s &&
           !oracle.can_survive(touch_s - before_s, touch_s + 2.0, state_of(index, touch_s - before_s)))
      before_s += before_s < 1.0 ? 0.1 : 0.5;
    if (before_s < touch_s) {
      std::cout << "could have survived from " << before_s << " s before on\n";
    } else {
      std::cout << "could not have survived\n";
    }
  }
  return 0;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) try {
  if (argc != 3) {
    std::cerr << "Usage: oracle WORLD DIR   (DIR: what `swarm_sim run WORLD --out DIR` wrote)\n";
    return 2;
  }
  return swarm::judge_run(argv[1], argv[2]);
} catch (const std::exception& error) {
  std::cerr << "oracle: " << error.what() << '\n';
  return 2;
}
