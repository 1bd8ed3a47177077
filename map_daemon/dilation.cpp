#include "map_daemon/dilation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

#include "lcmtypes/bus/wide.h"

namespace swarm {
namespace {

using Word = std::uint64_t;
constexpr std::size_t kCachedWords = 512;  // of a row of sources at work

// Four registers' worth of words.
struct Block {
  using Register = Word __attribute__((vector_size(32)));
  static constexpr std::size_t kEach = sizeof(Register) / sizeof(Word), kWords = 4 * kEach;
  Register a{}, b{}, c{}, d{};
  [[gnu::always_inline]] void add(const Word* from) {
    Register in;
    std::memcpy(&in, from, sizeof in), a |= in;
    std::memcpy(&in, from + kEach, sizeof in), b |= in;
    std::memcpy(&in, from + 2 * kEach, sizeof in), c |= in;
    std::memcpy(&in, from + 3 * kEach, sizeof in), d |= in;
  }
  [[gnu::always_inline]] void spread(Word inside) {
    a = (a | a << 1 | a >> 1) & inside;
    b = (b | b << 1 | b >> 1) & inside;
    c = (c | c << 1 | c >> 1) & inside;
    d = (d | d << 1 | d >> 1) & inside;
  }
  [[gnu::always_inline]] bool any() const {
    const Register all = a | b | c | d;
    return (all[0] | all[1] | all[2] | all[3]) != 0;
  }
  [[gnu::always_inline]] void store(Word* to) const {
    std::memcpy(to, &a, sizeof a);
    std::memcpy(to + kEach, &b, sizeof b);
    std::memcpy(to + 2 * kEach, &c, sizeof c);
    std::memcpy(to + 3 * kEach, &d, sizeof d);
  }
};
// One register's worth, or one word.
template <class Unit>
struct Single {
  static constexpr std::size_t kWords = sizeof(Unit) / sizeof(Word);
  Unit a{};
  [[gnu::always_inline]] void add(const Word* from) {
    Unit in;
    std::memcpy(&in, from, sizeof in), a |= in;
  }
  [[gnu::always_inline]] void spread(Word inside) { a = (a | a << 1 | a >> 1) & inside; }
  [[gnu::always_inline]] bool any() const {
    const Unit none{};
    return std::memcmp(&a, &none, sizeof a) != 0;
  }
  [[gnu::always_inline]] void store(Word* to) const { std::memcpy(to, &a, sizeof a); }
};

[[gnu::always_inline]] inline bool holds_any(const Word* in, std::size_t n) {
  Word bits = 0;
  if (n < Block::kEach) {
    for (std::size_t i = 0; i < n; ++i) bits |= in[i];
    return bits != 0;
  }
  Block::Register any{};
  for (std::size_t i = 0; i < n; i += Block::kEach) {
    Block::Register some;
    std::memcpy(&some, in + std::min(i, n - Block::kEach), sizeof some), any |= some;
  }
  for (std::size_t i = 0; i < Block::kEach; ++i) bits |= any[i];
  return bits != 0;
}

// work<Sum>(i) for n words from i = 0 on, in the largest sums that fit. The last one lies as far back as it must, so
// that some words are done a second time.
template <class Sum, class... Smaller, class Work>
[[gnu::always_inline]] inline void for_each_sum(std::size_t n, const Work& work) {
  if constexpr (sizeof...(Smaller) > 0) {
    if (n < Sum::kWords) return for_each_sum<Smaller...>(n, work);
  }
  for (std::size_t i = 0; i < n; i += Sum::kWords) work.template operator()<Sum>(std::min(i, n - Sum::kWords));
}

// Columns side by side along y, `width` of them in each of `count` rows along x that lie `pitch` words apart.
struct Rows {
  std::size_t count, pitch, width;
};

// work<Sum>(from, to) for these words and where they go, but only where `everything` holds something within `margin`:
// the others are set to 0 at once. (First which ones, then the work: a branch for each would be guessed wrong too
// often.)
template <class Sum, class... Smaller, class Work>
[[gnu::always_inline]] inline void for_each_sum_near(const Word* everything, std::size_t margin, const Rows& rows,
                                                     Word* out, std::size_t out_pitch, const Work& work) {
  if constexpr (sizeof...(Smaller) > 0) {
    if (rows.width < Sum::kWords) return for_each_sum_near<Smaller...>(everything, margin, rows, out, out_pitch, work);
  }
  struct Place {
    std::size_t from, to;
  };
  std::array<Place, 64> places;
  std::size_t count = 0;
  for (std::size_t x = 0; x < rows.count; ++x) {
    for_each_sum<Sum>(
        rows.width, [&]<class Zero>(std::size_t i)
                        __attribute__((always_inline)) { Zero().store(out + x * out_pitch + i); });
    for (std::size_t i = 0; i < rows.width; i += Sum::kWords) {
      const std::size_t y = std::min(i, rows.width - Sum::kWords);
      places[count] = {x * rows.pitch + y, x * out_pitch + y};
      count += holds_any(everything + places[count].from - margin, Sum::kWords + 2 * margin) ? 1u : 0u;
      if (count < places.size() && (x + 1 < rows.count || i + Sum::kWords < rows.width)) continue;
      for (std::size_t k = 0; k < count; ++k) work.template operator()<Sum>(places[k].from, places[k].to);
      count = 0;
    }
  }
}

// Level by level: what there is so far spreads by one voxel along z, as far as `inside` goes, and the level's sources
// join. What joins a word lies within `margin` of that word of `everything`.
SWARM_WIDE void add_levels(const Word* const* sources, const std::size_t* counts, std::size_t levels, Word inside,
                           const Rows& rows, const Word* everything, std::size_t margin, Word* out,
                           std::size_t out_pitch) {
  for_each_sum_near<Block, Single<Block::Register>, Single<Word>>(
      everything, margin, rows, out,
      out_pitch, [&]<class Sum>(std::size_t from, std::size_t to) __attribute__((always_inline)) {
        Sum sum;
        const Word* const* source = sources;
        for (std::size_t level = 0; level < levels; ++level) {
          if (level > 0) sum.spread(inside);
          for (const Word* const* end = source + counts[level]; source != end; ++source) sum.add(*source + from);
        }
        sum.store(out + to);
      });
}

// Nothing in these words.
SWARM_WIDE void clear(const Rows& rows, Word* out) {
  for (std::size_t x = 0; x < rows.count; ++x) {
    for_each_sum<Block, Single<Block::Register>, Single<Word>>(
        rows.width, [&]<class Sum>(std::size_t i)
                        __attribute__((always_inline)) { Sum().store(out + x * rows.pitch + i); });
  }
}

// Unions of the row at `in` with those up to r away, to both sides, for r from 1 to `reach`: `n` words each.
SWARM_WIDE void add_rows(const Word* in, std::size_t row, std::size_t reach, std::size_t n, Word* out) {
  for_each_sum<Block, Single<Block::Register>, Single<Word>>(
      n, [&]<class Sum>(std::size_t i) __attribute__((always_inline)) {
        Sum sum;
        sum.add(in + i);
        for (std::size_t r = 1; r <= reach; ++r) {
          sum.add(in + i - r * row);
          sum.add(in + i + r * row);
          sum.store(out + (r - 1) * n + i);
        }
      });
}

// out = in, and its neighbours along z, as far as `inside` goes; `below` and `above` are the adjacent words of the same
// columns.
SWARM_WIDE void spread_words(const Word* __restrict in, const Word* __restrict below, const Word* __restrict above,
                             Word inside, std::size_t n, Word* __restrict out) {
  for (std::size_t i = 0; i < n; ++i)
    out[i] = (in[i] | in[i] << 1 | in[i] >> 1 | below[i] >> 63 | above[i] << 63) & inside;
}

// out = the union of the sources, `n` words each from `begin` on. Whether there is anything.
SWARM_WIDE bool unite(const Word* const* sources, std::size_t count, std::size_t begin, std::size_t n, Word* out) {
  bool any = false;
  for_each_sum<Block, Single<Block::Register>, Single<Word>>(
      n, [&]<class Sum>(std::size_t i) __attribute__((always_inline)) {
        Sum sum;
        for (std::size_t k = 0; k < count; ++k) sum.add(sources[k] + begin + i);
        sum.store(out + i);
        any |= sum.any();
      });
  return any;
}

}  // namespace

Layer layer_of(const Sogm& sogm, int frame) {
  const GridGeometry& grid = sogm.geometry;
  return {all_columns(grid), sogm.column(frame, 0, 0),
          static_cast<std::size_t>(grid.size.y()) * static_cast<std::size_t>(grid.words_per_column())};
}

void Dilator::set(const GridGeometry& geometry, double radius_m) {
  if (!(std::isfinite(radius_m) && radius_m >= 0.0)) {
    throw std::invalid_argument("dilation radius " + std::to_string(radius_m) + " m: must be finite and >= 0");
  }
  const double ratio = radius_m / geometry.resolution_m, squared = std::floor(ratio * ratio + 1e-9);
  if (squared == squared_ && size_ == geometry.size) return;
  squared_ = squared;
  size_ = geometry.size;
  words_ = geometry.words_per_column();
  shape_ball();
}

void Dilator::shape_ball() {
  const auto half_width = [this](int d2, int extent) {  // clipped to the window; -1 outside the ball
    return d2 > squared_ ? -1 : static_cast<int>(std::min<double>(std::floor(std::sqrt(squared_ - d2)), extent - 1));
  };
  radius_x_ = half_width(0, size_.x());
  radius_y_ = half_width(0, size_.y());
  radius_z_ = half_width(0, size_.z());
  // Half-widths fall with both offsets. So at a distance j along y, the rows in which the ball is at least h high are
  // those up to some distance along x: their union is one source of the level. What the level before has is left out.
  const auto farthest = [&](int h, int j) {
    int i = radius_x_;
    while (i >= 0 && half_width(i * i + j * j, size_.z()) < h) --i;
    return i;
  };
  levels_.clear();
  level_sizes_.clear();
  for (int h = radius_z_; h >= 0; --h) {
    Level& level = levels_.emplace_back();
    for (int j = -radius_y_; j <= radius_y_; ++j) {
      const int i = farthest(h, j);
      if (i > (h == radius_z_ ? -1 : farthest(h + 1, j))) level.push_back({static_cast<std::size_t>(i), j});
    }
    level_sizes_.push_back(level.size());
  }
}

// The words of the first of these columns where there is nothing to gather: in a single layer that holds all that the
// ball reaches. Null elsewhere.
const std::uint64_t* Dilator::in_place(std::span<const Layer> layers, const Columns& columns) const {
  if (layers.size() != 1 || words_ != 1) return nullptr;
  const Layer& layer = layers.front();
  const Eigen::Vector2i first = columns.first - layer.columns.first, last = layer.columns.last - columns.last;
  if (std::min(first.x(), last.x()) < radius_x_ || std::min(first.y(), last.y()) < radius_y_) return nullptr;
  return layer.words + static_cast<std::size_t>(first.x()) * layer.row + static_cast<std::size_t>(first.y());
}

bool Dilator::gather(std::span<const Layer> layers, const Columns& columns) {
  const Eigen::Vector2i low(columns.first.x() - radius_x_, columns.first.y() - radius_y_);
  const Eigen::Vector2i high(columns.last.x() + radius_x_, columns.last.y() + radius_y_);
  const Eigen::Vector2i from = low.cwiseMax(0), to = high.cwiseMin(size_.head<2>() - Eigen::Vector2i::Ones());
  const auto num_rows = static_cast<std::size_t>(high.x() - low.x() + 1);
  row_ = static_cast<std::size_t>(high.y() - low.y() + 1);
  plane_size_ = row_ * num_rows;
  const std::size_t needed = static_cast<std::size_t>(words_) * plane_size_;
  if (planes_.size() < needed) planes_.resize(needed);
  const auto words = static_cast<std::size_t>(words_);
  bool any = false;
  for (int w = 0; w < words_; ++w) {
    // Layers that hold all there is in the window and lie alike are taken together.
    sources_.clear();
    std::size_t stride = 0;
    const auto is_whole = [&](const Layer& layer) {
      return words_ == 1 && (stride == 0 || layer.row == stride) &&
             (layer.columns.first.array() <= from.array()).all() && (layer.columns.last.array() >= to.array()).all();
    };
    for (const Layer& layer : layers) {
      if (!is_whole(layer)) continue;
      stride = layer.row;
      const Eigen::Vector2i skip = from - layer.columns.first;
      sources_.push_back(layer.words + static_cast<std::size_t>(skip.x()) * stride +
                         static_cast<std::size_t>(skip.y()));
    }
    if (from != low || to != high) std::fill_n(plane(w), plane_size_, 0);
    const auto rows = static_cast<std::size_t>(to.x() - from.x() + 1),
               n = static_cast<std::size_t>(to.y() - from.y() + 1);
    Word* out = plane(w) + static_cast<std::size_t>(from.x() - low.x()) * row_ + (from.y() - low.y());
    for (std::size_t x = 0; x < rows; ++x)
      any |= unite(sources_.data(), sources_.size(), x * stride, n, out + x * row_);
    for (const Layer& layer : layers) {
      if (is_whole(layer)) continue;
      const Eigen::Vector2i first = layer.columns.first.cwiseMax(from), last = layer.columns.last.cwiseMin(to);
      for (int x = first.x(); x <= last.x() && first.y() <= last.y(); ++x) {
        const std::uint64_t* in = layer.words + static_cast<std::size_t>(x - layer.columns.first.x()) * layer.row +
                                  static_cast<std::size_t>(first.y() - layer.columns.first.y()) * words +
                                  static_cast<std::size_t>(w);
        std::uint64_t* sum = plane(w) + static_cast<std::size_t>(x - low.x()) * row_ + (first.y() - low.y());
        for (int y = first.y(); y <= last.y(); ++y, in += words) any |= (*sum++ |= *in) != 0;
      }
    }
  }
  return any;
}

// From the widest level on; what it has so far, each further level spreads and adds to.
void Dilator::cover(const std::uint64_t* in, std::size_t pitch, std::size_t num_rows, std::size_t width,
                    std::uint64_t* out, std::size_t out_pitch) {
  const auto words = static_cast<std::size_t>(words_), reach = static_cast<std::size_t>(radius_x_);
  const auto margin = static_cast<std::size_t>(radius_y_);
  const std::size_t n = (num_rows - 1) * pitch + width, wide = n + 2 * margin;
  if (unions_.size() < reach * words * wide) unions_.resize(reach * words * wide);
  for (std::size_t w = 0; w < words; ++w)
    add_rows(in + w * plane_size_ - margin, pitch, reach, wide, unions_.data() + w * reach * wide);
  const auto rows_within = [&](std::size_t rows, std::size_t w) {
    return rows == 0 ? in + w * plane_size_ : unions_.data() + (w * reach + rows - 1) * wide + margin;
  };
  const auto add_sources = [&](const Level& level, std::size_t w) {
    for (const Source source : level) sources_.push_back(rows_within(source.rows, w) + source.shift);
  };
  const int tail = size_.z() % 64;
  const Word all = ~Word{0}, top = tail != 0 ? (Word{1} << tail) - 1 : all;
  if (words == 1) {
    sources_.clear();
    for (const Level& level : levels_) add_sources(level, 0);
    return add_levels(sources_.data(), level_sizes_.data(), levels_.size(), top, {num_rows, pitch, width},
                      rows_within(reach, 0), margin, out, out_pitch);
  }
  const std::size_t padded = (words + 2) * n;
  if (sums_.size() < 2 * padded) sums_.resize(2 * padded);
  Word *sum = sums_.data() + n, *spread = sum + padded;
  for (Word* columns : {sum, spread}) {  // end in zeros
    std::fill_n(columns - n, n, 0);
    std::fill_n(columns + words * n, n, 0);
  }
  for (const Level& level : levels_) {
    const bool first = &level == levels_.data();
    for (std::size_t w = 0; w < words && !first; ++w) {
      const Word* from = sum + w * n;
      spread_words(from, from - n, from + n, w + 1 == words ? top : all, n, spread + w * n);
    }
    if (!first) std::swap(sum, spread);
    for (std::size_t w = 0; w < words; ++w) {
      sources_.clear();
      if (!first) sources_.push_back(sum + w * n);
      add_sources(level, w);
      (void)unite(sources_.data(), sources_.size(), 0, n, sum + w * n);
    }
  }
  for (std::size_t x = 0; x < num_rows; ++x) {
    for (std::size_t y = 0; y < width; ++y) {
      for (std::size_t w = 0; w < words; ++w) out[x * out_pitch + y * words + w] = sum[w * n + x * pitch + y];
    }
  }
}

void Dilator::sample(std::span<const Layer> layers, int stride, const Columns& cells, std::uint64_t* out,
                     std::size_t out_row) {
  const Eigen::Vector2i middle = Eigen::Vector2i::Constant(stride / 2);
  const Columns columns{stride * cells.first + middle, stride * cells.last + middle};
  const auto words = static_cast<std::size_t>(words_);
  const auto num_x = static_cast<std::size_t>(cells.last.x() - cells.first.x() + 1);
  const auto num_y = static_cast<std::size_t>(cells.width());
  const std::uint64_t* in = stride > 1 ? in_place(layers, columns) : nullptr;
  std::size_t in_row = in != nullptr ? layers.front().row : 0;
  if (in == nullptr) {
    if (!gather(layers, columns)) {
      clear({num_x, out_row, num_y * words}, out);
      return;
    }
    in = planes_.data() + static_cast<std::size_t>(radius_x_) * row_ + radius_y_;
    in_row = row_;
  }
  const auto width = static_cast<std::size_t>(columns.width()), step = static_cast<std::size_t>(stride);
  if (step == 1) {  // rows side by side, as gathered, are taken together, as many as the cache holds
    const std::size_t at_once = std::max<std::size_t>(1, kCachedWords / in_row);
    for (std::size_t x = 0; x < num_x; x += at_once)
      cover(in + x * in_row, in_row, std::min(at_once, num_x - x), width, out + x * out_row, out_row);
    return;
  }
  covered_.resize(width * words);
  for (std::size_t x = 0; x < num_x; ++x, out += out_row) {
    cover(in + x * step * in_row, in_row, 1, width, covered_.data(), width * words);
    for (std::size_t y = 0; y < num_y; ++y) {
      for (std::size_t w = 0; w < words; ++w) out[y * words + w] = covered_[y * step * words + w];
    }
  }
}

void Dilator::dilate(std::span<const Layer> layers, const Columns& columns, std::uint64_t* out, std::size_t out_row) {
  sample(layers, 1, columns, out, out_row);
}

void Dilator::dilate(const Sogm& in, double radius_m, Sogm* out) {
  set(in.geometry, radius_m);
  if (out->geometry.size != in.geometry.size || out->num_frames != in.num_frames ||
      out->words().size() != in.words().size())
    out->reset(in.geometry, in.num_frames, in.start_utime, in.frame_duration);
  out->geometry = in.geometry;
  out->start_utime = in.start_utime;
  out->frame_duration = in.frame_duration;
  for (int frame = 0; frame < in.num_frames && !in.words().empty(); ++frame) {
    const Layer layer = layer_of(in, frame);
    dilate({&layer, 1}, layer.columns, out->columns(frame, layer.columns), layer.row);
  }
}

void dilate(const Sogm& in, double radius_m, Sogm* out) {
  Dilator().dilate(in, radius_m, out);
}

}  // namespace swarm
