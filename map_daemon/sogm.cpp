#include "map_daemon/sogm.h"

#include <algorithm>

namespace swarm {

void Sogm::reset(const GridGeometry& new_geometry, int frames, Utime start, Duration duration) {
  geometry = new_geometry;
  num_frames = frames;
  start_utime = start;
  frame_duration = duration;
  words.assign(static_cast<std::size_t>(frames) * static_cast<std::size_t>(geometry.words_per_frame()), 0);
}

int Sogm::frame_at(Utime utime) const {
  if (utime <= start_utime || num_frames == 0) return 0;
  return static_cast<int>(std::min<std::int64_t>((utime - start_utime) / frame_duration, num_frames - 1));
}

Columns Columns::grown(int margin, const GridGeometry& geometry) const {
  if (empty()) return {};
  const Columns all = all_columns(geometry);
  return {(first.array() - margin).max(all.first.array()), (last.array() + margin).min(all.last.array())};
}

Columns all_columns(const GridGeometry& geometry) {
  return {Eigen::Vector2i::Zero(), geometry.size.head<2>() - Eigen::Vector2i::Ones()};
}

}  // namespace swarm
