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

void add_first_frame(const Sogm& other, Sogm* sogm) {
  const GridGeometry &from = other.geometry, &to = sogm->geometry;
  if (sogm->num_frames == 0 || other.num_frames == 0) return;
  const Eigen::Vector3i shift = to.origin - from.origin;  // index in the one + shift = index in the other
  const int tail = to.size.z() % 64, words = to.words_per_column();
  const std::uint64_t top_mask = tail == 0 ? ~std::uint64_t{0} : (std::uint64_t{1} << tail) - 1;
  const int y_end = std::min(to.size.y(), from.size.y() - shift.y());
  for (int x = std::max(0, -shift.x()); x < std::min(to.size.x(), from.size.x() - shift.x()); ++x) {
    for (int y = std::max(0, -shift.y()); y < y_end; ++y) {
      const std::uint64_t* source = other.column(0, x + shift.x(), y + shift.y());
      for (int w = 0; w < words; ++w) {
        std::uint64_t bits = word_of_column(source, from.words_per_column(), w, shift.z());
        if (w == words - 1) bits &= top_mask;
        if (bits == 0) continue;
        for (int frame = 0; frame < sogm->num_frames; ++frame) sogm->column(frame, x, y)[w] |= bits;
      }
    }
  }
}

void complement(const Sogm& sogm, int frame, Sogm* out) {
  const GridGeometry& window = sogm.geometry;
  out->reset(window, 1, sogm.start_utime, sogm.frame_duration);
  const int words = window.words_per_column(), left = window.size.z() % 64;
  const std::uint64_t top = left == 0 ? ~std::uint64_t{0} : (std::uint64_t{1} << left) - 1;
  const std::uint64_t* in = sogm.column(frame, 0, 0);
  for (std::size_t i = 0; i < out->words.size(); ++i)
    out->words[i] =
        ~in[i] & (static_cast<int>(i % static_cast<std::size_t>(words)) == words - 1 ? top : ~std::uint64_t{0});
}

}  // namespace swarm
