#include "swarm_sim/world_command.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <iostream>
#include <iterator>
#include <limits>
#include <numbers>
#include <string_view>
#include <utility>
#include <vector>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/text.h"
#include "swarm_sim/world/walkers.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"

namespace swarm {
namespace {

struct WorldOptions {
  std::string task = "cross", environment = "mixed", out, file;
  int obstacles = -1, seed = 0;
  bool describe = false;
  double walk_up_s = 0.0;
  Fleet fleet;
};

World seeded_world(const WorldOptions& options) {
  const Environment environment = environment_from(options.environment);
  const int usual = environment == Environment::kEmpty ? 0 : 20;
  return make_world(task_from(options.task), environment, options.obstacles < 0 ? usual : options.obstacles,
                    static_cast<std::uint64_t>(options.seed), options.fleet);
}

// So much of it lies within the world's space [m^3], as if it stood in the middle.
double volume_m3(const Shape& shape, const Space& space) {
  constexpr double kPi = std::numbers::pi;
  const Eigen::Vector3d room = space.max - space.min;
  switch (shape.kind) {
    case Shape::Kind::kColumn:
      return kPi / 4 * shape.size.x() * shape.size.x() * std::min(shape.size.y(), room.z());
    case Shape::Kind::kRing:
      return kPi * kPi / 2 * shape.size.x() * shape.size.y() * shape.size.y();
    case Shape::Kind::kBox:
      return shape.size.cwiseMin(room).prod();
    case Shape::Kind::kSphere:
      return kPi / 6 * std::pow(shape.size.x(), 3);
    case Shape::Kind::kVoxels:
      break;  // never in a world
  }
  return 0.0;
}

// What the world is like, in a few lines.
std::string description(const World& world) {
  static constexpr const char* kNames[] = {"columns", "rings", "boxes", "spheres"};
  const Eigen::Vector3d room = world.space.max - world.space.min;
  double obstacles_m3 = 0.0, walls_m3 = 0.0, fastest_mps = 0.0;
  std::array<int, std::size(kNames)> numbers{};
  for (const WorldObstacle& obstacle : world.obstacles) {
    ++numbers[static_cast<std::size_t>(obstacle.shape.kind)];
    obstacles_m3 += volume_m3(obstacle.shape, world.space);
    if (!obstacle.velocity_mps.isZero(0.0))
      fastest_mps = std::max(fastest_mps, obstacle.velocity_mps.norm() + obstacle.sway_speed_mps());
    for (std::size_t i = 1; i < obstacle.track.size(); ++i) {
      const TrackPoint &from = obstacle.track[i - 1], &to = obstacle.track[i];
      fastest_mps = std::max(fastest_mps, (to.position - from.position).norm() / (to.t_s - from.t_s));
    }
  }
  for (const Space& wall : world.walls)
    walls_m3 += (wall.max.cwiseMin(world.space.max) - wall.min.cwiseMax(world.space.min)).cwiseMax(0.0).prod();
  std::string shapes;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] == 0) continue;
    shapes.append(shapes.empty() ? "" : ", ").append(std::to_string(numbers[i])).append(" ").append(kNames[i]);
  }
  const auto percent = [&](double volume_m3) { return fixed(100.0 * volume_m3 / room.prod(), 2) + " %"; };
  return "world       " + world.name + "\nspace       " + text_of(room.x()) + " x " + text_of(room.y()) + " x " +
         text_of(room.z()) + " m\nrobots      " + std::to_string(world.robots.size()) + ", up to " +
         text_of(world.limits.v_max_mps) + " m/s and " + text_of(world.limits.axis_mps2().maxCoeff()) +
         " m/s^2 on each axis\nobstacles   " +
         (shapes.empty() ? "none" : shapes + ", up to " + fixed(fastest_mps, 2) + " m/s") + "\ndensity     " +
         percent(obstacles_m3) + " of the space\nwalls       " + std::to_string(world.walls.size()) + ", " +
         percent(walls_m3) + " of the space\nstatic map  " +
         (world.static_map.empty() ? "none" : world.static_map.string()) + "\n";
}

}  // namespace

int world_command(int argc, const char* const* argv) try {
  WorldOptions options;
  OptionSet set("swarm_sim world", "Writes a world file: a task of the paper among seeded obstacles.");
  set.add("task", &options.task, "cross, bilateral, unilateral, circle, random, hall or tour");
  set.add("env", &options.environment, "empty, pure (columns) or mixed (columns and rings)");
  set.add("obstacles", &options.obstacles, -1, 500, "", "number of obstacles; -1: 20, or none when env is empty");
  set.add("seed", &options.seed, 0, std::numeric_limits<int>::max(), "", "the same seed gives the same world");
  declare(set, options.fleet);
  set.add("out", &options.out, "file to write, also -o; -: standard output");
  set.add("describe", &options.describe, "says what the world is like, also how dense; --out is optional then");
  set.add("world", &options.file, "this world file instead of a seeded world, to describe it or to let people walk up");
  set.add("walk-up", &options.walk_up_s, 0, 60, "s",
          "whose track begins after the flight does is there so much earlier, and walks up to its first point");
  std::vector<const char*> arguments(argv, argv + argc);
  for (const char*& argument : arguments) {
    if (std::string_view(argument) == "-o") argument = "--out";
    if (std::string_view(argument) == "--describe") argument = "--describe=true";
  }
  if (set.parse(argc, arguments.data(), std::cout) == OptionSet::Parsed::kExit) return 0;
  if (options.out.empty() && !options.describe) throw OptionError("out: a file to write must be given (-o FILE)");
  World world = options.file.empty() ? seeded_world(options) : read_world(options.file);
  if (options.walk_up_s > 0.0) world.obstacles = walking_up(std::move(world.obstacles), options.walk_up_s);
  if (options.describe) std::cout << description(world) << std::flush;
  if (options.out.empty()) return 0;
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
