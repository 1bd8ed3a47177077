// swarm_goal: see goal_order.h and goal_node.h.
#include <spdlog/spdlog.h>

#include <cstdlib>
#include <iostream>
#include <memory>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/realtime_host.h"
#include "lcmtypes/bus/text.h"
#include "planner_daemon/coordination/flight_state.h"
#include "tools/operator/goal_node.h"

namespace swarm {
namespace {

using Progress = GoalNode::Progress;
using sogm_swarm::flight_status_t;
using sogm_swarm::planner_status_t;

constexpr char kUsage[] =
    "Tells robots where to go: ROBOT X Y Z, or for several robots or places ROBOT X,Y,Z [X,Y,Z...], in W [m]; or what "
    "to do: ROBOT[,ROBOT...] take-off, hold, fly (to its goal again), home (and land there), land, emergency (stop and "
    "come down without the planner), or without OTHER (which has left: nobody is to wait for it). Ends when every "
    "robot "
    "has said that it knows. A planner that starts anew later waits for a goal again.\n"
    "Exit codes: 0 told (with --arrive: there), 1 not, 2 bad input.";

std::string what_for(std::int16_t planner_state) {
  switch (planner_state) {
    case planner_status_t::kNoMap:
    case planner_status_t::kStaleMap:
      return "a map";
    case planner_status_t::kNoCommitted:
      return "the broadcaster";
    default:
      return "this goal";
  }
}

std::string why_not(const flight_status_t& flight, const std::string& order) {
  switch (flight.verdict) {
    case flight_status_t::kNotNow:
      return "is " + std::string(name_of_flight_state(flight.state)) + ", no " + order + " now";
    case flight_status_t::kNotReady:
      return "is not ready for " + order +
             ": the log of its broadcast_daemon says what it waits for, or its battery is low";
    case flight_status_t::kNoVehicle:
      return "does not hear its vehicle, no " + order + ": mavlink_bridge does not run, or hears no flight controller";
    default:
      return "is on the ground: the vehicle did not arm, or did not rise; the log of mavlink_bridge says more";
  }
}

std::string line_of_order(const GoalNode& node) {
  const flight_status_t& flight = *node.flight();
  if (node.order().order == sogm_swarm::order_t::kWithout) {
    const std::string other = "robot " + std::to_string(node.order().other_id);
    return node.progress() == Progress::kRefused
               ? other + " is not in its roster, or it cannot give " + other + " up yet"
               : "waits no more for " + other;
  }
  if (node.progress() == Progress::kRefused) return why_not(flight, name_of_order(*node.order().order));
  return std::string("is ") + name_of_flight_state(flight.state);
}

// The bus that is named, or the robot's own where several share this computer.
struct Buses {
  std::string url;
  int base_port = kDefaultBasePort;

  std::string of(int robot_id) const { return url.empty() ? onboard_bus_url(base_port, robot_id) : url; }
};

std::string line_of(const GoalNode& node, const Buses& buses) {
  const GoalOrder& order = node.order();
  const std::string robot = "robot " + std::to_string(order.robot_id) + ": ";
  if (node.progress() == Progress::kSilent) return robot + "nothing was heard of it on " + buses.of(order.robot_id);
  if (order.order) return robot + line_of_order(node);
  if (node.progress() == Progress::kOnGround) return robot + "knows, but is on the ground: take-off comes first";
  const auto at = static_cast<std::size_t>(std::clamp<std::int64_t>(node.waypoint(), 0, std::ssize(order.mission) - 1));
  std::string place = text_of(order.mission[at].position);
  if (order.mission.size() > 1)
    place += " (" + std::to_string(at + 1) + " of " + std::to_string(order.mission.size()) + ")";
  switch (node.progress()) {
    case Progress::kWaits:
      return robot + "knows, but its planner waits for " + what_for(node.planner_state());
    case Progress::kUnreachable:
      return robot + "no way leads to " + place;
    case Progress::kArrived:
      return robot + "is at " + place;
    default:
      return robot + "flies to " + place;
  }
}

// Looks at all of them, and says what has changed.
class Watch {
 public:
  static constexpr Duration kPeriod = 100ms;

  Watch(const std::vector<std::unique_ptr<GoalNode>>& nodes, const Buses& buses, bool until_arrival, double patience_s)
      : nodes_(nodes), buses_(buses), until_arrival_(until_arrival), patience_s_(patience_s) {
    said_.resize(nodes.size());
  }
  bool failed() const { return failed_; }

  // Once each kPeriod. False: it is over.
  bool look() {
    const bool is_over = waited_s_ >= patience_s_;
    bool all_done = true, all_known = true, any_refused = false;
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      const GoalNode& node = *nodes_[i];
      const Progress progress = node.progress();
      all_done &= is_done(node);
      const bool is_known = progress == Progress::kFlies || progress == Progress::kArrived;
      all_known &= is_known;
      any_refused |= progress == Progress::kRefused;
      if (is_known || progress == Progress::kRefused || is_over) say(i, line_of(node, buses_));
    }
    failed_ = any_refused || (is_over && !all_known && !all_done);
    waited_s_ = all_known ? 0.0 : waited_s_ + to_seconds(kPeriod);
    return !all_done && !failed_;
  }

 private:
  // Whether it has come as far as is asked for.
  bool is_done(const GoalNode& node) const {
    return node.progress() == Progress::kArrived || (!until_arrival_ && node.progress() == Progress::kFlies);
  }

  void say(std::size_t robot, const std::string& line) {
    if (said_[robot] == line) return;
    said_[robot] = line;
    std::cout << line << std::endl;
  }

  const std::vector<std::unique_ptr<GoalNode>>& nodes_;
  Buses buses_;
  bool until_arrival_, failed_ = false;
  double patience_s_, waited_s_ = 0.0;  // for what is not known to fly
  std::vector<std::string> said_;
};

int run(int argc, char** argv) {
  GoalOptions goal;
  bool until_arrival = false;
  double patience_s = 3.0;
  Buses buses;
  std::vector<std::string> words;
  OptionSet options("swarm_goal", kUsage);
  options.add("arrive", &until_arrival, "wait until all have arrived, and say where they are on their way");
  options.add("tolerance", &goal.tolerance_m, 0.001, 1000, "m", "so near a place counts as reached");
  options.add("speed", &goal.speed_mps, 0, 100, "m/s", "limit per axis; 0: the robot's");
  options.add("wait", &goal.wait_s, 0, 86400, "s", "at each place, before the next");
  options.add("times", &goal.times, 1, 1000, "", "all places, one after the other, so often");
  options.add("height", &goal.height_m, kLeastClimb_m, kMaxClimb_m, "m", "of take-off, above the ground");
  options.add("patience", &patience_s, 0.1, 86400, "s", "so long it is waited for planners, maps and ways");
  options.add("base-port", &buses.base_port, 1024, 60000, "",
              "where robots share this computer, robot ID has this port + 33 + ID");
  options.add("onboard-url", &buses.url,
              "bus inside the one robot that is named, as on its own computer; empty: robots share this "
              "computer");
  options.add_positional("word", &words, "robots, places and orders");
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return EXIT_SUCCESS;
  if (goal.speed_mps > 0.0 && goal.speed_mps < 0.05)
    throw OptionError("--speed " + text_of(goal.speed_mps) + ": must be 0 or at least 0.05 m/s");
  const std::vector<GoalOrder> orders = read_orders(words, goal);
  if (!buses.url.empty() && orders.size() > 1)
    throw OptionError("--onboard-url " + buses.url + ": only for one robot, not " + std::to_string(orders.size()));
  spdlog::set_level(spdlog::level::warn);
  std::vector<std::unique_ptr<GoalNode>> nodes;
  RealtimeHost host;
  for (const GoalOrder& order : orders) {
    nodes.push_back(std::make_unique<GoalNode>(order, new_boot()));
    host.add("swarm_goal", *nodes.back(), buses.of(order.robot_id), "");
  }
  Watch watch(nodes, buses, until_arrival, patience_s);
  host.watch(Watch::kPeriod, [&watch] { return watch.look(); });
  host.run();
  return watch.failed() ? EXIT_FAILURE : EXIT_SUCCESS;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  try {
    return swarm::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "swarm_goal: " << error.what() << std::endl;
    return 2;
  }
}
