// The live view: a page in the browser that shows what the buses carry, or a log of them.
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <fstream>
#include <iostream>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <utility>

#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "swarm_sim/world/walls.h"
#include "swarm_sim/world/world_json.h"
#include "tools/viewer/live_source.h"
#include "tools/viewer/log_player.h"
#include "tools/viewer/page.h"
#include "tools/viewer/viewer.h"
#include "tools/viewer/web_server.h"

namespace swarm {
namespace {

constexpr const char* kUsage =
    "Shows a swarm in the browser: robots, committed trajectories, goals and obstacles, the SOGM and the corridors of "
    "one\n"
    "of the robots, and how its daemons are doing. Live from the buses, or with LOGs what they recorded, with a "
    "slider.";

struct ViewOptions {
  std::vector<std::string> logs;
  LiveSource::Options live;
  std::string address = "127.0.0.1", world, static_map, three = "/usr/share/javascript/three";
  int port = 8080;
};

void declare(OptionSet& options, ViewOptions& view) {
  options.add_positional("LOG", &view.logs, "LCM log, as of swarm_sim run --out, tools/record or lcm-logger");
  options.add("onboard", &view.live.onboard, 0, 32767, "robots whose onboard buses are on this computer; may be empty");
  options.add("base-port", &view.live.base_port, 1024, 60'000, "",
              "port of the swarm bus; robot k's onboard bus is this + 33 + k");
  options.add("replay", &view.live.replay, "take the time from the messages: for logs that are played onto the buses");
  options.add("allow-goals", &view.live.allow_goals,
              "whoever opens the page may send goals to the robots of --onboard");
  options.add("world", &view.world, "world file: its robots instead of --onboard, its static map; none: none");
  options.add("static-map", &view.static_map, "OctoMap file to show (.bt or .ot); none: none");
  options.add("address", &view.address, "IP address to serve the page at; 0.0.0.0: all of this computer's");
  options.add("port", &view.port, 0, 65'535, "", "port to serve the page at; 0: any that is free");
  options.add("three", &view.three, "directory of three.js, as Debian's package libjs-three has it");
}

WebFile three_script(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error(path + ": cannot be read; install libjs-three (tools/setup --view) or set --three");
  return {{std::istreambuf_iterator<char>(in), {}}, "text/javascript; charset=utf-8"};
}

WebServer::Files page(const std::string& three) {
  WebServer::Files files = {{"/", {kPageHtml, "text/html; charset=utf-8"}}};
  for (const PageScript& script : kPageScripts) files[script.path] = {script.text, "text/javascript; charset=utf-8"};
  files["/three.js"] = three_script(three + "/build/three.min.js");
  for (const char* name : {"controls/OrbitControls", "lines/LineSegmentsGeometry", "lines/LineGeometry",
                           "lines/LineMaterial", "lines/LineSegments2", "lines/Line2"}) {
    const std::string path = std::string("/examples/js/") + name + ".js";
    files[path] = three_script(three + path);
  }
  return files;
}

int view(int argc, const char* const* argv) {
  ViewOptions view;
  OptionSet options("swarm_view", kUsage);
  declare(options, view);
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  spdlog::set_default_logger(
      std::make_shared<spdlog::logger>("swarm_view", std::make_shared<spdlog::sinks::stderr_color_sink_mt>()));
  spdlog::set_pattern("%Y-%m-%d %H:%M:%S.%e %^%l%$ %v");

  std::optional<OccupiedCubes> static_map;
  if (!view.world.empty()) {
    const TemporaryDirectory scratch("swarm_view");
    const World world = with_walls_in_file(read_world(view.world), scratch.path());
    view.live.onboard.clear();
    for (const WorldRobot& robot : world.robots) view.live.onboard.push_back(robot.id);
    if (view.static_map.empty() && !world.static_map.empty()) static_map = OccupiedCubes::load(world.static_map);
  }
  if (!view.static_map.empty()) static_map = OccupiedCubes::load(view.static_map);
  std::optional<LogIndex> index;
  if (!view.logs.empty()) {
    index.emplace(view.logs);
    if (index->skipped() > 0) spdlog::warn("damaged: {} bytes of the logs are no events", index->skipped());
  }
  RealtimeHost host;
  std::optional<LiveSource> live;
  if (!index) live.emplace(view.live, &host);
  bool is_first = true;
  const auto make_viewer = [&]() -> std::unique_ptr<WebClient> {
    if (std::exchange(is_first, false)) std::cout << "view: a browser watches" << std::endl;
    std::unique_ptr<PictureSource> source = index ? std::make_unique<LogPlayer>(*index) : live->view();
    return std::make_unique<Viewer>(std::move(source), static_map ? &*static_map : nullptr);
  };
  const WebServer server(host.io(), view.address, view.port, page(view.three), make_viewer);
  const bool everybody = view.address == "0.0.0.0" || view.address == "::";
  std::cout << "view: http://" << (everybody ? "localhost" : view.address) << ":" << server.port()
            << "/ (Ctrl-C ends it)" << std::endl;
  if (view.live.allow_goals && view.address != "127.0.0.1")
    spdlog::warn("whoever reaches {} can send goals to the robots", view.address);
  host.run();
  return 0;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) try { return swarm::view(argc, argv); } catch (const std::exception& error) {
  std::cerr << "swarm_view: " << error.what() << std::endl;
  return 2;
}
