#include "swarm_sim/world/walkers.h"

#include <algorithm>
#include <optional>

#include "swarm_sim/world/world_json.h"

namespace swarm {
namespace {

constexpr double kOffWalls_m = 0.05;
constexpr double kEnd_m = 1.5;    // so near to an end of the hall somebody may come in
constexpr double kBegin_s = 0.5;  // and so soon anywhere
constexpr double kAside_m = 6.0, kStep_m = 0.5;

// The part of the track between the ends of the hall; none: it leaves the hall through its sides, comes back, or begins
// in its midst.
std::optional<WorldObstacle> within(const Rectangle& hall, WorldObstacle walker) {
  const double off_m = walker.shape.size.x() / 2 + kOffWalls_m;
  const Rectangle free{hall.min.array() + off_m, hall.max.array() - off_m};
  const auto is_between_ends = [&](const TrackPoint& point) {
    return point.position.x() > free.min.x() && point.position.x() < free.max.x();
  };
  auto& track = walker.track;
  const auto begin = std::ranges::find_if(track, is_between_ends);
  const auto end = std::find_if_not(begin, track.end(), is_between_ends);
  if (std::any_of(end, track.end(), is_between_ends) || end - begin < 2) return {};
  track = {begin, end};
  const auto leaves = [&](const TrackPoint& point) {
    return point.position.y() <= free.min.y() || point.position.y() >= free.max.y();
  };
  if (std::ranges::any_of(track, leaves)) return {};
  const double in_m = track[0].position.x();
  if (track[0].t_s > kBegin_s && in_m > free.min.x() + kEnd_m && in_m < free.max.x() - kEnd_m) return {};
  walker.center.head<2>() = track[0].position;
  return walker;
}

}  // namespace

std::vector<WorldObstacle> walkers_in(const std::filesystem::path& file, const Rectangle& hall) {
  std::vector<WorldObstacle> people = read_world(file).obstacles;
  std::erase_if(people, [](const WorldObstacle& obstacle) {
    return obstacle.track.empty() || obstacle.shape.kind != Shape::Kind::kColumn;
  });
  Eigen::Vector2d walked = Eigen::Vector2d::Zero();  // along x and along y
  for (const WorldObstacle& walker : people)
    for (std::size_t i = 1; i < walker.track.size(); ++i)
      walked += (walker.track[i].position - walker.track[i - 1].position).cwiseAbs();
  if (walked.y() > walked.x())
    for (WorldObstacle& walker : people)
      for (TrackPoint& point : walker.track) point.position = {point.position.y(), -point.position.x()};
  std::vector<WorldObstacle> most;
  for (double aside_m = -kAside_m; aside_m <= kAside_m; aside_m += kStep_m) {
    std::vector<WorldObstacle> there;
    for (WorldObstacle walker : people) {
      for (TrackPoint& point : walker.track) point.position.y() += aside_m;
      if (const auto inside = within(hall, std::move(walker))) there.push_back(*inside);
    }
    if (there.size() > most.size()) most = std::move(there);
  }
  if (most.empty()) throw WorldError(file.string() + ": holds nobody who walks along a hall");
  return most;
}

std::vector<WorldObstacle> walking_up(std::vector<WorldObstacle> obstacles, double lead_s) {
  for (WorldObstacle& obstacle : obstacles) {
    auto& track = obstacle.track;
    if (track.empty() || track[0].t_s <= 0.0) continue;
    const TrackPoint first = track[0], second = track[1];
    const Eigen::Vector2d velocity = (second.position - first.position) / (second.t_s - first.t_s);
    track.insert(track.begin(), {first.t_s - lead_s, first.position - velocity * lead_s});
    obstacle.center.head<2>() = track[0].position;
  }
  return obstacles;
}

}  // namespace swarm
