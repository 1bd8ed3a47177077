#include "tools/logs/sogm_surface.h"

#include <bit>

namespace swarm {
namespace {

using Words = std::vector<std::uint64_t>;

// What is occupied in any frame of [first, last], in the layout of one frame.
Words union_of(const Sogm& sogm, int first, int last) {
  const auto size = static_cast<std::size_t>(sogm.geometry.words_per_frame());
  Words words(size, 0);
  for (int frame = first; frame <= last; ++frame) {
    const std::uint64_t* const more = sogm.words().data() + static_cast<std::size_t>(frame) * size;
    for (std::size_t i = 0; i < size; ++i) words[i] |= more[i];
  }
  return words;
}

void append(std::uint64_t bits, int x, int y, int word, int frame, std::vector<SurfaceVoxel>* surface) {
  for (; bits != 0; bits &= bits - 1) {
    const int z = 64 * word + std::countr_zero(bits);
    surface->push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y), static_cast<std::int16_t>(z),
                        static_cast<std::int16_t>(frame)});
  }
}

}  // namespace

void sogm_surface(const Sogm& sogm, int frame, std::vector<SurfaceVoxel>* surface) {
  surface->clear();
  const bool all = frame == kAllFrames;
  if (!all && (frame < 0 || frame >= sogm.num_frames)) return;
  const int first = all ? 0 : frame, last = all ? sogm.num_frames - 1 : frame;
  const Words occupied = union_of(sogm, first, last);
  const int wpc = sogm.geometry.words_per_column(), size_x = sogm.geometry.size.x(), size_y = sogm.geometry.size.y();
  const Words none(static_cast<std::size_t>(wpc), 0);
  const auto column = [&](int x, int y) {
    if (x < 0 || x >= size_x || y < 0 || y >= size_y) return none.data();
    return occupied.data() + (static_cast<std::size_t>(x) * size_y + y) * wpc;
  };
  for (int x = 0; x < size_x; ++x) {
    for (int y = 0; y < size_y; ++y) {
      const std::uint64_t* const here = column(x, y);
      const std::uint64_t* const beside[] = {column(x - 1, y), column(x + 1, y), column(x, y - 1), column(x, y + 1)};
      for (int w = 0; w < wpc; ++w) {
        if (here[w] == 0) continue;
        const std::uint64_t below = here[w] << 1 | (w > 0 ? here[w - 1] >> 63 : 0);
        const std::uint64_t above = here[w] >> 1 | (w + 1 < wpc ? here[w + 1] << 63 : 0);
        const std::uint64_t enclosed = below & above & beside[0][w] & beside[1][w] & beside[2][w] & beside[3][w];
        std::uint64_t left = here[w] & ~enclosed;
        for (int i = first; left != 0; ++i) {
          const std::uint64_t begins = left & sogm.column(i, x, y)[w];
          append(begins, x, y, w, i, surface);
          left &= ~begins;
        }
      }
    }
  }
}

}  // namespace swarm
