// swarm_map: see save_node.h, map_picture.h and map_comparison.h.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/realtime_host.h"
#include "lcmtypes/bus/text.h"
#include "map_daemon/octomap_file.h"
#include "tools/maps/map_comparison.h"
#include "tools/maps/map_picture.h"
#include "tools/maps/save_node.h"

namespace swarm {
namespace {

constexpr char kUsage[] =
    "Maps that robots keep. save ROBOT...: perception daemons on this computer write theirs now. show FILE: what is in "
    "an "
    "OctoMap, from above. diff FILE FILE: how far two agree about what stands.\n"
    "Exit codes: 0 done, 1 not saved, 2 bad input.";

struct MapOptions {
  std::string url;
  double patience_s = 5.0, within_m = 0.1;
  PictureOptions picture;
  std::vector<std::string> words;
};

int robot_of(const std::string& word) {
  const bool is_number = !word.empty() && word.size() <= 5 && word.find_first_not_of("0123456789") == std::string::npos;
  if (!is_number || std::stoi(word) > 32767) throw OptionError("robot '" + word + "': must be an id within [0, 32767]");
  return std::stoi(word);
}

std::string outcome_of(const SaveNode& node, const std::string& url) {
  switch (node.progress()) {
    case SaveNode::Progress::kSilent:
      return "no perception daemon was heard on " + url;
    case SaveNode::Progress::kKeepsNone:
      return "keeps no map: perception_daemon --map FILE";
    case SaveNode::Progress::kAsked:
      return "was asked, but did not say that its map is written";
    case SaveNode::Progress::kNotWritten:
      return "could not write its map; its log says why";
    default:
      return std::string("wrote its map") +
             (node.is_full() ? ", in which there was no room for all that was seen" : "");
  }
}

int save(const MapOptions& options) {
  if (options.words.size() < 2) throw OptionError("save: which robots? swarm_map save ROBOT...");
  if (!options.url.empty() && options.words.size() > 2)
    throw OptionError("--onboard-url " + options.url + ": only for one robot, not " +
                      std::to_string(options.words.size() - 1));
  spdlog::set_level(spdlog::level::warn);
  const auto url_of = [&](int robot) {
    return options.url.empty() ? onboard_bus_url(kDefaultBasePort, robot) : options.url;
  };
  std::vector<std::unique_ptr<SaveNode>> nodes;
  RealtimeHost host;
  for (std::size_t i = 1; i < options.words.size(); ++i) {
    nodes.push_back(std::make_unique<SaveNode>(robot_of(options.words[i]), new_boot()));
    host.add("swarm_map", *nodes.back(), url_of(nodes.back()->robot_id()), "");
  }
  constexpr Duration kPeriod = 100ms;
  const auto looks = std::ceil(options.patience_s / to_seconds(kPeriod));
  host.watch(kPeriod, [&, look = 0]() mutable {  // until each has answered, or time is up
    const auto waits = [](const auto& node) { return node->progress() <= SaveNode::Progress::kAsked; };
    return std::ranges::any_of(nodes, waits) && ++look < looks;
  });
  host.run();
  bool all = true;
  for (const auto& node : nodes) {
    std::cout << "robot " << node->robot_id() << ": " << outcome_of(*node, url_of(node->robot_id())) << std::endl;
    all = all && node->progress() == SaveNode::Progress::kWritten;
  }
  return all ? EXIT_SUCCESS : EXIT_FAILURE;
}

int show(const MapOptions& options) {
  if (options.words.size() != 2) throw OptionError("show: must be followed by one file");
  const auto tree = read_octomap(options.words[1]);
  std::int64_t occupied = 0, free = 0;
  for_each_voxel(*tree, true, [&](const octomap::point3d&) { ++occupied; });
  for_each_voxel(*tree, false, [&](const octomap::point3d&) { ++free; });
  const double edge_m = tree->getResolution(), voxel_m3 = edge_m * edge_m * edge_m;
  std::cout << options.words[1] << ": voxels of " << text_of(edge_m) << " m; " << occupied << " of them occupied, "
            << fixed(voxel_m3 * static_cast<double>(free), 1) << " m3 free\n";
  if (occupied + free > 0) {
    double low[3], high[3];
    tree->getMetricMin(low[0], low[1], low[2]);
    tree->getMetricMax(high[0], high[1], high[2]);
    for (int axis = 0; axis < 3; ++axis)
      std::cout << "xyz"[axis] << " from " << fixed(low[axis], 2) << " to " << fixed(high[axis], 2) << " m"
                << (axis < 2 ? ", " : "\n");
  }
  std::cout << picture_of(*tree, options.picture);
  return EXIT_SUCCESS;
}

int diff(const MapOptions& options) {
  if (options.words.size() != 3) throw OptionError("diff: must be followed by two files");
  const auto first = read_octomap(options.words[1]), second = read_octomap(options.words[2]);
  const auto tell = [&](const octomap::OcTree& map, const std::string& name, const octomap::OcTree& other,
                        const std::string& other_name) {
    const Agreement agreement = compare(map, other, options.within_m);
    std::cout << agreement.known() << " occupied voxels of " << name << " are known in " << other_name << ": "
              << fixed(100.0 * agreement.share(), 1) << " % stand there as well (within " << text_of(options.within_m)
              << " m), " << agreement.free << " are free; " << agreement.unknown << " more are not known there\n";
  };
  tell(*first, options.words[1], *second, options.words[2]);
  tell(*second, options.words[2], *first, options.words[1]);
  return EXIT_SUCCESS;
}

int run(int argc, char** argv) {
  MapOptions map;
  OptionSet options("swarm_map", kUsage);
  options.add("patience", &map.patience_s, 0.1, 86400, "s", "save: so long it is waited for perception daemons");
  options.add(
      "onboard-url", &map.url,
      "save: bus inside the one robot that is named, as on its own computer; empty: robots share this computer, "
      "and robot ID has port 7700 + ID");
  options.add("low", &map.picture.low_m, -1e9, 1e9, "m", "show: what lies lower is left out");
  options.add("high", &map.picture.high_m, -1e9, 1e9, "m", "show: what lies higher is left out");
  options.add("columns", &map.picture.columns, 10, 10'000, "", "show: letters in a line, at most");
  options.add("within", &map.within_m, 0, 10, "m", "diff: along each axis");
  options.add_positional("word", &map.words, "save, show or diff, and of what");
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return EXIT_SUCCESS;
  const std::string verb = map.words.empty() ? "" : map.words[0];
  if (verb == "save") return save(map);
  if (verb == "show") return show(map);
  if (verb == "diff") return diff(map);
  throw OptionError(verb.empty() ? "nothing to do: save ROBOT..., show FILE or diff FILE FILE"
                                 : "'" + verb + "': must be save, show or diff");
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  try {
    return swarm::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "swarm_map: " << error.what() << std::endl;
    return 2;
  }
}
