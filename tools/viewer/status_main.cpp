// swarm_status: a line for each robot.
#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <cstdlib>
#include <deque>
#include <iostream>

#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/realtime_host.h"
#include "lcmtypes/bus/text.h"
#include "tools/viewer/robot_health.h"

namespace swarm {
namespace {

constexpr char kUsage[] =
    "Says of each robot whose daemons run on this computer, in a line, what it is about, where it is, and what is not "
    "as it "
    "should be. Without ROBOTs: of all that are heard on the swarm bus.\n"
    "Exit codes: 0 all is well, 1 it is not, 2 bad input.";

class Listener : public Node {
 public:
  Listener(SwarmPicture& picture, BusId bus) : picture_(picture), bus_(bus) {}
  std::vector<Subscription> subscriptions() const override {
    std::vector<Subscription> all;
    for (const char* name : channels_of(bus_)) all.push_back({bus_, name});
    return all;
  }
  void on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) override {
    (void)picture_.add(now, channel, bytes);
  }
  Utime step(Utime now, Outbox&) override { return now + 1s; }

 private:
  SwarmPicture& picture_;
  BusId bus_;
};

// What is said on these buses for a while.
SwarmPicture listen(BusId bus, const std::vector<std::string>& urls, double seconds) {
  SwarmPicture picture(-1);
  RealtimeHost host;
  std::deque<Listener> listeners;
  for (const std::string& url : urls) {
    const bool onboard = bus == BusId::kOnboard;
    host.add("swarm_status", listeners.emplace_back(picture, bus), onboard ? url : "", onboard ? "" : url);
  }
  boost::asio::steady_timer timer(host.io(), to_duration(seconds));
  timer.async_wait([&host](const boost::system::error_code&) { host.stop(); });
  host.run();
  return picture;
}

std::vector<std::string> row_of(int id, const RobotPicture* robot, Utime now, std::string* trouble) {
  const std::string name = "robot " + std::to_string(id);
  if (robot == nullptr) {
    *trouble = "nothing is heard of it";
    return {name, "?", "", ""};
  }
  *trouble = trouble_of(*robot, now);
  if (!robot->broadcast && trouble->empty()) *trouble = "broadcast daemon silent";
  if (!robot->planner && trouble->empty()) *trouble = "planner daemon silent";
  if (!robot->map && trouble->empty()) *trouble = "map daemon silent";
  const auto place = robot->position(now);
  const bool knows_battery = robot->vehicle && robot->vehicle->battery >= 0.0f;
  return {name, activity_of(*robot),
          place ? fmt::format("at [{:.2f},{:.2f},{:.2f}]", place->x(), place->y(), place->z()) : "",
          knows_battery ? fmt::format("battery {:.0f} %", 100.0f * robot->vehicle->battery) : ""};
}

int run(int argc, char** argv) {
  int base_port = kDefaultBasePort;
  double seconds = 1.5;
  std::string url;
  std::vector<std::string> words;
  OptionSet options("swarm_status", kUsage);
  options.add("base-port", &base_port, 1024, 60000, "",
              "port of the swarm bus; where robots share this computer, robot ID's onboard bus has this + 33 + ID");
  options.add("seconds", &seconds, 1.1, 600, "s", "how long to listen; daemons speak once a second");
  options.add("onboard-url", &url, "bus inside the one robot that is named, as on its own computer; empty: as above");
  options.add_positional("robot", &words, "ids");
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return EXIT_SUCCESS;
  std::vector<int> robots;
  for (const std::string& word : words) {
    for (const std::string& one : split(word, ',')) {
      int id = 0;
      if (!read_amount(one, &id) || id > 32767)
        throw OptionError("robot '" + one + "': must be an id within [0, 32767]");
      robots.push_back(id);
    }
  }
  if (!url.empty() && robots.size() != 1)
    throw OptionError("--onboard-url " + url + ": only for one robot, not " + std::to_string(robots.size()));
  spdlog::set_level(spdlog::level::off);  // the lines are all there is to say
  if (robots.empty()) {
    const SwarmPicture heard = listen(BusId::kSwarm, {swarm_bus_url(base_port)}, 1.1);
    for (const auto& [id, robot] : heard.robots()) robots.push_back(id);
    if (robots.empty()) {
      std::cout << "no robot is heard on " << swarm_bus_url(base_port) << std::endl;
      return EXIT_FAILURE;
    }
  }
  std::vector<std::string> urls;
  for (const int id : robots) urls.push_back(url.empty() ? onboard_bus_url(base_port, id) : url);
  const SwarmPicture picture = listen(BusId::kOnboard, urls, seconds);
  bool all_well = true;
  std::vector<std::vector<std::string>> rows;
  std::vector<std::string> troubles(robots.size());
  for (std::size_t i = 0; i < robots.size(); ++i) {
    const auto found = picture.robots().find(robots[i]);
    rows.push_back(
        row_of(robots[i], found == picture.robots().end() ? nullptr : &found->second, wall_utime(), &troubles[i]));
    all_well &= troubles[i].empty();
  }
  std::vector<std::size_t> widths(rows[0].size(), 0);
  for (const auto& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  for (std::size_t r = 0; r < rows.size(); ++r) {
    std::string line;
    for (std::size_t i = 0; i < rows[r].size(); ++i)
      if (widths[i] > 0) line += fmt::format("{:<{}}  ", rows[r][i], widths[i]);
    line += troubles[r].empty() ? "" : "! " + troubles[r];
    line.erase(line.find_last_not_of(' ') + 1);
    std::cout << line << std::endl;
  }
  return all_well ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  try {
    return swarm::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "swarm_status: " << error.what() << std::endl;
    return 2;
  }
}
