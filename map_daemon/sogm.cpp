#include "map_daemon/sogm.h"

#include <algorithm>

namespace swarm {

void Sogm::reset(const GridGeometry& new_geometry, int frames, std::int64_t start, std::int64_t duration_us) {
  geometry = new_geometry;
  num_frames = frames;
  start_utime = start;
  frame_duration_us = duration_us;
  words.assign(static_cast<std::size_t>(frames) * static_cast<std::size_t>(geometry.words_per_frame()), 0);
}

int Sogm::frame_at(std::int64_t utime) const {
  if (utime <= start_utime || num_frames == 0) return 0;
  return static_cast<int>(std::min<std::int64_t>((utime - start_utime) / frame_duration_us, num_frames - 1));
}

}  // namespace swarm
