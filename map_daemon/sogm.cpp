#include "map_daemon/sogm.h"

#include <algorithm>

namespace swarm {
void Sogm::reset(const GridGeometry& new_geometry, int frames, Utime start, Duration duration) {
  geometry = new_geometry;
  num_frames = frames;
  start_utime = start;
  frame_duration = duration;
  const auto frame_words = static_cast<std::size_t>(geometry.words_per_frame());
  const std::size_t num_words = static_cast<std::size_t>(frames) * frame_words;
  if (frame_words == frame_words_ && num_words == words_.size()) {
    clear_used();
  } else {
    words_.assign(num_words, 0);
    frame_words_ = frame_words;
  }
  used_.assign((frame_words + 64 * kLine - 1) / (64 * kLine), 0);
}

// A map is made ten times a second, so its words are in no cache: they are fetched while other frames are cleared.
void Sogm::clear_used() {
  for (std::size_t frame = 0; frame < words_.size(); frame += frame_words_) {
    const std::size_t coming = std::min(frame + 2 * frame_words_, words_.size() - frame_words_);
    for_each_used_run([&](std::size_t first, std::size_t end) {
      for (std::size_t i = first; i < end; i += kLine) __builtin_prefetch(&words_[coming + i], 1);
      std::fill_n(&words_[frame + first], end - first, 0);
    });
  }
}

void Sogm::use(std::size_t first_word, std::size_t last_word) {
  const std::size_t first = first_word / kLine, last = last_word / kLine;
  for (std::size_t i = first / 64; i <= last / 64; ++i) {
    const std::size_t from = std::max(first, 64 * i) % 64, to = std::min(last, 64 * i + 63) % 64;
    used_[i] |= ~std::uint64_t{0} >> (63 - (to - from)) << from;
  }
}

std::span<std::uint64_t> Sogm::words_to_write() {
  if (frame_words_ > 0) use(0, frame_words_ - 1);
  return words_;
}

std::uint64_t* Sogm::columns(int frame, const Columns& box) {
  use(index_of(0, box.first.x(), box.first.y()), index_of(0, box.last.x(), box.last.y() + 1) - 1);
  return words_.data() + index_of(frame, box.first.x(), box.first.y());
}

std::uint64_t* Sogm::word(int frame, std::size_t index) {
  use(index, index);
  return words_.data() + static_cast<std::size_t>(frame) * frame_words_ + index;
}

void Sogm::repeat_before(int frame) {
  std::uint64_t* const words = words_.data() + static_cast<std::size_t>(frame) * frame_words_;
  const std::uint64_t* const before = words - frame_words_;
  for_each_used_run(
      [=](std::size_t first, std::size_t end) { std::copy(before + first, before + end, words + first); });
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
  const std::span<std::uint64_t> rest = out->words_to_write();
  for (std::size_t i = 0; i < rest.size(); ++i)
    rest[i] = ~in[i] & (static_cast<int>(i % static_cast<std::size_t>(words)) == words - 1 ? top : ~std::uint64_t{0});
}

}  // namespace swarm
