// swarm_scan_player: see scan_player.h.
#include <spdlog/spdlog.h>

#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/realtime_host.h"
#include "tools/scans/scan_player.h"

namespace swarm {
namespace {

constexpr char kUsage[] =
    "Plays the recorded scans of a directory (files .pcd or .bin) onto a robot's onboard bus, as LIDAR_SCAN, with "
    "where "
    "the sensor was (seconds x y z qx qy qz qw a line).\n"
    "Exit codes: 0 played, 2 bad input.";

int run(int argc, char** argv) {
  ScanPlayerConfig config;
  std::string poses, times, url;
  std::vector<std::string> words;
  OptionSet options("swarm_scan_player", kUsage);
  options.add("poses", &poses, "where the sensor was: TUM's format, W");
  options.add("times", &times, "when scans were taken, a time a line; empty: their names say so, in seconds");
  options.add("robot-id", &config.robot_id, 0, 32767, "", "whose bus it is");
  options.add("sensor", &config.sensor, 0, 7, "", "which of the robot's");
  options.add("speed", &config.speed, 0.01, 100, "", "so many times as fast as recorded");
  options.add("state", &config.state, "also says, 50 times a second, that the robot is where the sensor is");
  options.add("onboard-url", &url, "bus inside the robot; empty: robot ID on this computer has port 7700 + ID");
  options.add_positional("directory", &words, "of the scans");
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return EXIT_SUCCESS;
  if (words.size() != 1) throw OptionError("which scans? swarm_scan_player DIRECTORY --poses FILE");
  if (poses.empty()) throw OptionError("where was the sensor? --poses FILE");
  spdlog::set_level(spdlog::level::warn);
  ScanPlayer player(config, list_scans(words[0], times), PoseTrack(poses), new_boot());
  RealtimeHost host;
  host.add("swarm_scan_player", player, url.empty() ? onboard_bus_url(kDefaultBasePort, config.robot_id) : url, "");
  host.watch(20ms, [&player] { return !player.is_over(); });
  host.run();
  std::cout << "played " << player.played() << " scans, " << player.points() << " points";
  if (player.thinned() > 0) std::cout << "; " << player.thinned() << " had more than a message takes and were thinned";
  if (player.late() > 0) std::cout << "; " << player.late() << " came late: read from a slow disk?";
  std::cout << std::endl;
  return EXIT_SUCCESS;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  try {
    return swarm::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "swarm_scan_player: " << error.what() << std::endl;
    return 2;
  }
}
