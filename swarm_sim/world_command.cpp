#include "swarm_sim/world_command.h"

#include <exception>
#include <iostream>
#include <limits>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/option_set.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"

namespace swarm {
namespace {

struct WorldOptions {
  std::string task = "cross", environment = "mixed", out;
  int obstacles = -1, seed = 0;
  Fleet fleet;
};

World make_world(const WorldOptions& options) {
  const Environment environment = environment_from(options.environment);
  const int usual = environment == Environment::kEmpty ? 0 : 20;
  return make_world(task_from(options.task), environment, options.obstacles < 0 ? usual : options.obstacles,
                    static_cast<std::uint64_t>(options.seed), options.fleet);
}

}  // namespace

int world_command(int argc, const char* const* argv) try {
  WorldOptions options;
  OptionSet set("swarm_sim world", "Writes a world file: a task of the paper among seeded obstacles.");
  set.add("task", &options.task, "cross, bilateral, unilateral, circle, random or hall");
  set.add("env", &options.environment, "empty, pure (columns) or mixed (columns and rings)");
  set.add("obstacles", &options.obstacles, -1, 500, "", "number of obstacles; -1: 20, or none when env is empty");
  set.add("seed", &options.seed, 0, std::numeric_limits<int>::max(), "", "the same seed gives the same world");
  declare(set, options.fleet);
  set.add("out", &options.out, "file to write, also -o; -: standard output");
  std::vector<const char*> arguments(argv, argv + argc);
  for (const char*& argument : arguments) {
    if (std::string_view(argument) == "-o") argument = "--out";
  }
  if (set.parse(argc, arguments.data(), std::cout) == OptionSet::Parsed::kExit) return 0;
  if (options.out.empty()) throw OptionError("out: a file to write must be given (-o FILE)");
  const World world = make_world(options);
  if (options.out == "-") {
    std::cout << to_json_text(world, "") << std::flush;
  } else {
    write_file(options.out, to_json_text(world, std::filesystem::path(options.out).parent_path()));
  }
  return 0;
} catch (const std::exception& error) {
  std::cerr << "swarm_sim world: " << error.what() << '\n';
  return 2;
}

}  // namespace swarm
