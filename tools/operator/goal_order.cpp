#include "tools/operator/goal_order.h"

#include <algorithm>
#include <set>

#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr double kFarthest_m = 1e5;  // goal_t
constexpr char kRule[] = "must be ROBOT X Y Z, or ROBOT X,Y,Z [X,Y,Z...] or ROBOT hold, for each robot";

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

std::vector<GoalOrder> read_orders(const std::vector<std::string>& words, const GoalOptions& options) {
  const bool is_one_place = words.size() == 4 && std::ranges::none_of(words, is_place) && words[1] != "hold";
  if (is_one_place) return read_orders({words[0], words[1] + "," + words[2] + "," + words[3]}, options);
  std::vector<GoalOrder> orders;
  std::set<int> robots;
  for (auto word = words.begin(); word != words.end();) {
    GoalOrder order{read_robot(*word), {}};
    if (!robots.insert(order.robot_id).second) throw OptionError("robot '" + *word + "': must be named once");
    const auto first = ++word;
    while (word != words.end() && is_place(*word))
      order.mission.push_back(waypoint_at(read_place(*word), options)), ++word;
    const bool holds = word == first && word != words.end() && *word == "hold";
    if (word == first && !holds) throw OptionError("robot '" + *(first - 1) + "' has no place: " + kRule);
    if (holds) ++word;
    const Mission once = order.mission;
    for (int time = 1; time < options.times; ++time)
      order.mission.insert(order.mission.end(), once.begin(), once.end());
    if (std::ssize(order.mission) > sogm_swarm::goal_t::kMaxWaypoints) {
      throw OptionError("robot '" + *(first - 1) + "': " + std::to_string(order.mission.size()) + " places; at most " +
                        std::to_string(sogm_swarm::goal_t::kMaxWaypoints));
    }
    orders.push_back(std::move(order));
  }
  if (orders.empty()) throw OptionError(std::string("nothing to do: ") + kRule);
  return orders;
}

}  // namespace swarm
