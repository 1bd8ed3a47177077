#include "tools/operator/goal_order.h"

#include <algorithm>
#include <iterator>
#include <set>

#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr double kFarthest_m = 1e5;  // goal_t
constexpr char kRule[] =
    "must be ROBOT X Y Z, or for each robot ROBOT X,Y,Z [X,Y,Z...] or ROBOT[,ROBOT...] ORDER, which is take-off, hold, "
    "fly, home, land, emergency or without OTHER";
// In the order of order_t's numbers.
constexpr const char* kOrders[] = {"fly", "hold", "take-off", "home", "land", "emergency", "without"};

bool is_place(const std::string& word) {
  return word.find(',') != std::string::npos;
}

Eigen::Vector3d read_place(const std::string& word) {
  const std::vector<std::string> coordinates = split(word, ',');
  Eigen::Vector3d place;
  bool is_good = coordinates.size() == 3;
  for (std::size_t axis = 0; is_good && axis < 3; ++axis) {
    const bool is_negative = coordinates[axis].starts_with('-');
    double amount = 0.0;
    is_good = read_amount(coordinates[axis].substr(is_negative ? 1 : 0), &amount) && amount <= kFarthest_m;
    place[static_cast<Eigen::Index>(axis)] = is_negative ? -amount : amount;
  }
  if (!is_good) throw OptionError("place '" + word + "': must be X,Y,Z, each within [-100000, 100000] m");
  return place;
}

int read_robot(const std::string& word) {
  int id = 0;
  if (!read_amount(word, &id) || id > 32767) throw OptionError("robot '" + word + "': must be an id within [0, 32767]");
  return id;
}

Waypoint waypoint_at(const Eigen::Vector3d& position, const GoalOptions& options) {
  Waypoint waypoint{.position = position, .tolerance_m = options.tolerance_m, .wait = to_duration(options.wait_s)};
  if (options.speed_mps > 0.0) waypoint.speed_mps = options.speed_mps;
  return waypoint;
}

}  // namespace

const char* name_of_order(std::int16_t order) {
  return order >= 0 && order < std::ssize(kOrders) ? kOrders[order] : "?";
}

std::optional<std::int16_t> find_order(const std::string& name) {
  const auto* const found = std::ranges::find(kOrders, name);
  if (found == std::end(kOrders)) return std::nullopt;
  return static_cast<std::int16_t>(found - kOrders);
}

std::vector<GoalOrder> read_orders(const std::vector<std::string>& words, const GoalOptions& options) {
  const bool is_one_place = words.size() == 4 && std::ranges::none_of(words, is_place) && !find_order(words[1]);
  if (is_one_place) return read_orders({words[0], words[1] + "," + words[2] + "," + words[3]}, options);
  std::vector<GoalOrder> orders;
  std::set<int> named;
  for (auto word = words.begin(); word != words.end();) {
    std::vector<int> robots;
    for (const std::string& one : split(*word, ',')) {
      robots.push_back(read_robot(one));
      if (!named.insert(robots.back()).second) throw OptionError("robot '" + one + "': must be named once");
    }
    const std::string first = *word++;
    GoalOrder order;
    if (word != words.end()) order.order = find_order(*word);
    if (order.order) {
      if (order.order == sogm_swarm::order_t::kTakeOff) order.height_m = options.height_m;
      ++word;
      if (order.order == sogm_swarm::order_t::kWithout) {
        if (word == words.end()) throw OptionError("robots '" + first + "' without whom: " + kRule);
        order.other_id = read_robot(*word++);
        if (std::ranges::find(robots, order.other_id) != robots.end())
          throw OptionError("robot '" + std::to_string(order.other_id) + "': cannot go on without itself");
      }
    } else {
      // Commas may also name the next robots, which an order follows.
      const auto names_robots = [&](auto at) { return std::next(at) != words.end() && find_order(*std::next(at)); };
      while (word != words.end() && is_place(*word) && !names_robots(word))
        order.mission.push_back(waypoint_at(read_place(*word), options)), ++word;
      if (order.mission.empty()) throw OptionError("robot '" + first + "' has no place: " + kRule);
      if (robots.size() > 1) throw OptionError("robots '" + first + "': must not go to the same place");
    }
    const Mission once = order.mission;
    for (int time = 1; time < options.times; ++time)
      order.mission.insert(order.mission.end(), once.begin(), once.end());
    if (std::ssize(order.mission) > sogm_swarm::goal_t::kMaxWaypoints) {
      throw OptionError("robot '" + first + "': " + std::to_string(order.mission.size()) + " places; at most " +
                        std::to_string(sogm_swarm::goal_t::kMaxWaypoints));
    }
    for (const int robot : robots) {
      orders.push_back(order);
      orders.back().robot_id = robot;
    }
  }
  if (orders.empty()) throw OptionError(std::string("nothing to do: ") + kRule);
  return orders;
}

}  // namespace swarm
