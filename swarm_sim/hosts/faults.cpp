#include "swarm_sim/hosts/faults.h"

#include <algorithm>

#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/text.h"

namespace swarm {

std::vector<Kill> parse_kills(const std::string& text) {
  std::vector<Kill> kills;
  if (text.empty()) return kills;
  for (const std::string& item : split(text, ',')) {
    const std::vector<std::string> halves = split(item, '@');
    const std::vector<std::string> who = split(halves[0], ':');
    const std::vector<std::string> when = split(halves.size() == 2 ? halves[1] : "", '-');
    const auto daemon = std::ranges::find(kDaemons, who[0], [](const char* name) { return std::string(name); });
    Kill kill;
    kill.daemon = static_cast<std::size_t>(daemon - kDaemons.begin());
    const bool is_keeper = halves[0] == "keeper";  // one that is no robot's daemon
    const bool is_daemon = who.size() == 2 && daemon != kDaemons.end() && read_amount(who[1], &kill.robot_id);
    const bool good =
        halves.size() == 2 && when.size() <= 2 && (is_keeper || is_daemon) && read_amount(when[0], &kill.at_s);
    kill.back_s = kill.at_s + kRestart_s;
    if (!good || (when.size() == 2 && (!read_amount(when[1], &kill.back_s) || kill.back_s <= kill.at_s)))
      throw OptionError("'" + item +
                        "' must be DAEMON:ROBOT@AT_S or DAEMON:ROBOT@AT_S-BACK_S, DAEMON one of map, planner, "
                        "broadcast, perception, or keeper instead of both, AT_S below BACK_S");
    for (const Kill& other : kills) {
      const bool is_same = other.daemon == kill.daemon && other.robot_id == kill.robot_id;
      if (is_same && other.at_s <= kill.back_s && kill.at_s <= other.back_s)
        throw OptionError("'" + item + "' must not overlap another crash of the same daemon");
    }
    kills.push_back(kill);
  }
  return kills;
}

std::vector<int> parse_robots(const std::string& text) {
  std::vector<int> robots;
  if (text.empty()) return robots;
  for (const std::string& item : split(text, ',')) {
    int id = 0;
    if (!read_amount(item, &id)) throw OptionError("'" + item + "' must be a robot's id");
    if (std::ranges::find(robots, id) != robots.end()) throw OptionError("robot " + item + " must be named once");
    robots.push_back(id);
  }
  return robots;
}

std::vector<ClockStep> parse_clock_steps(const std::string& text) {
  constexpr double kLongest_s = 1e6;
  std::vector<ClockStep> steps;
  if (text.empty()) return steps;
  for (const std::string& item : split(text, ',')) {
    const std::vector<std::string> parts = split(item, ':');
    const bool is_back = parts.size() == 3 && parts[2].starts_with('-');
    ClockStep step;
    double by_s = 0.0;
    if (parts.size() != 3 || !read_amount(parts[0], &step.robot_id) || !read_amount(parts[1], &step.at_s) ||
        !read_amount(is_back ? parts[2].substr(1) : parts[2], &by_s) || by_s > kLongest_s)
      throw OptionError("'" + item + "' must be ROBOT:AT_S:BY_S with AT_S of at least 0 and BY_S within +-1e6");
    step.by = to_duration(is_back ? -by_s : by_s);
    steps.push_back(step);
  }
  return steps;
}

}  // namespace swarm
