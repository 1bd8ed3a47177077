#include "tools/maps/map_picture.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "tools/maps/map_comparison.h"

namespace swarm {

std::string picture_of(const octomap::OcTree& map, const PictureOptions& options) {
  octomap::point3d low(1e9f, 1e9f, 0), high(-1e9f, -1e9f, 0);
  const auto for_each_shown = [&](bool occupied, const auto& visit) {
    for_each_voxel(map, occupied, [&](const octomap::point3d& place) {
      if (place.z() >= options.low_m && place.z() <= options.high_m) visit(place);
    });
  };
  for (const bool occupied : {true, false}) {
    for_each_shown(occupied, [&](const octomap::point3d& place) {
      for (unsigned axis = 0; axis < 2; ++axis) {
        low(axis) = std::min(low(axis), place(axis));
        high(axis) = std::max(high(axis), place(axis));
      }
    });
  }
  if (low.x() > high.x()) return "";
  // A letter is twice as high as wide.
  const double edge_m = map.getResolution();
  const double wide_m = edge_m * std::max(1.0, std::ceil((high.x() - low.x() + edge_m) / edge_m / options.columns));
  const double slack_m = 0.01 * edge_m;  // places are floats
  const auto column = [&](const octomap::point3d& place) {
    return static_cast<std::size_t>((place.x() - low.x() + slack_m) / wide_m);
  };
  const auto row = [&](const octomap::point3d& place) {
    return static_cast<std::size_t>((place.y() - low.y() + slack_m) / (2 * wide_m));
  };
  std::vector<std::string> rows(row(high) + 1, std::string(column(high) + 1, ' '));
  for_each_shown(false, [&](const octomap::point3d& place) { rows[row(place)][column(place)] = '.'; });
  for_each_shown(true, [&](const octomap::point3d& place) { rows[row(place)][column(place)] = '#'; });
  std::string picture;
  for (auto line = rows.rbegin(); line != rows.rend(); ++line)
    picture += line->substr(0, line->find_last_not_of(' ') + 1) + "\n";
  return picture;
}

}  // namespace swarm
