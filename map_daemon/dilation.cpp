#include "map_daemon/dilation.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "map_daemon/wide.h"

namespace swarm {
namespace {

// out = in, and its neighbours along z, as far as `inside` goes; `below` and `above` are the adjacent words of the same
// columns.
SWARM_WIDE void spread_words(const std::uint64_t* __restrict in, const std::uint64_t* __restrict below,
                             const std::uint64_t* __restrict above, std::uint64_t inside, std::size_t n,
                             std::uint64_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i)
    out[i] = (in[i] | in[i] << 1 | in[i] >> 1 | below[i] >> 63 | above[i] << 63) & inside;
}

// For columns of one word.
SWARM_WIDE void spread_words(const std::uint64_t* __restrict in, std::uint64_t inside, std::size_t n,
                             std::uint64_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = (in[i] | in[i] << 1 | in[i] >> 1) & inside;
}

SWARM_WIDE std::uint64_t or_all(const std::uint64_t* in, std::size_t n) {
  std::uint64_t any = 0;
  for (std::size_t i = 0; i < n; ++i) any |= in[i];
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
  sort_offsets();
}

// Half-widths of the ball, clipped to the window.
void Dilator::shape_ball() {
  const auto half = [this](int d2, int extent) {
    return d2 > squared_ ? -1 : static_cast<int>(std::min<double>(std::floor(std::sqrt(squared_ - d2)), extent - 1));
  };
  reach_x_ = half(0, size_.x());
  reach_y_ = half(0, size_.y());
  reach_z_ = half(0, size_.z());
  half_widths_.clear();
  for (int i = 0; i <= reach_x_; ++i) {
    for (int j = 0; j <= reach_y_; ++j) half_widths_.push_back(half(i * i + j * j, size_.z()));
  }
}

void Dilator::sort_offsets() {
  offsets_.assign(static_cast<std::size_t>(reach_z_) + 1, {});
  for (int i = -reach_x_; i <= reach_x_; ++i) {
    for (int j = -reach_y_; j <= reach_y_; ++j) {
      if (half_width(i, j) >= 0) offsets_[static_cast<std::size_t>(half_width(i, j))].push_back({i, j});
    }
  }
}

// The words of the first of these columns where there is nothing to gather: in a single layer that holds all that the
// ball reaches. Null elsewhere.
const std::uint64_t* Dilator::in_place(std::span<const Layer> layers, const Columns& columns) const {
  if (layers.size() != 1 || words_ != 1) return nullptr;
  const Layer& layer = layers.front();
  const Eigen::Vector2i first = columns.first - layer.columns.first, last = layer.columns.last - columns.last;
  if (std::min(first.x(), last.x()) < reach_x_ || std::min(first.y(), last.y()) < reach_y_) return nullptr;
  return layer.words + static_cast<std::size_t>(first.x()) * layer.row + static_cast<std::size_t>(first.y());
}

bool Dilator::gather(std::span<const Layer> layers, const Columns& columns) {
  const Eigen::Vector2i low(columns.first.x() - reach_x_, columns.first.y() - reach_y_);
  const Eigen::Vector2i high(columns.last.x() + reach_x_, columns.last.y() + reach_y_);
  const Eigen::Vector2i from = low.cwiseMax(0), to = high.cwiseMin(size_.head<2>() - Eigen::Vector2i::Ones());
  const auto num_rows = static_cast<std::size_t>(high.x() - low.x() + 1);
  row_ = static_cast<std::size_t>(high.y() - low.y() + 1);
  plane_size_ = row_ * num_rows;
  const std::size_t needed = static_cast<std::size_t>(reach_z_ + 1) * (words_ + 2) * plane_size_;
  if (planes_.size() < needed) planes_.resize(needed);
  const auto words = static_cast<std::size_t>(words_);
  std::uint64_t any = 0;
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
    if (from != low || to != high) std::fill_n(plane(0, w), plane_size_, 0);
    const auto rows = static_cast<std::size_t>(to.x() - from.x() + 1),
               n = static_cast<std::size_t>(to.y() - from.y() + 1);
    or_words(sources_, {rows, n, stride, row_},
             plane(0, w) + static_cast<std::size_t>(from.x() - low.x()) * row_ + (from.y() - low.y()));
    for (const Layer& layer : layers) {
      if (is_whole(layer)) continue;
      const Eigen::Vector2i first = layer.columns.first.cwiseMax(from), last = layer.columns.last.cwiseMin(to);
      for (int x = first.x(); x <= last.x() && first.y() <= last.y(); ++x) {
        const std::uint64_t* in = layer.words + static_cast<std::size_t>(x - layer.columns.first.x()) * layer.row +
                                  static_cast<std::size_t>(first.y() - layer.columns.first.y()) * words +
                                  static_cast<std::size_t>(w);
        std::uint64_t* out = plane(0, w) + static_cast<std::size_t>(x - low.x()) * row_ + (first.y() - low.y());
        for (int y = first.y(); y <= last.y(); ++y, in += words) *out++ |= *in;
      }
    }
    any |= or_all(plane(0, w), plane_size_);
  }
  return any != 0;
}

void Dilator::spread() {
  for (int h = 1; h <= reach_z_; ++h) {
    if (words_ > 1) {
      for (const int w : {-1, words_}) std::fill_n(plane(h - 1, w), plane_size_, 0);
    }
    spread_by_one(plane(h - 1, 0), plane_size_, plane(h, 0));
  }
}

// All words of `n` columns, which lie n apart; so do zeros before the first and after the last, if there are several.
void Dilator::spread_by_one(const std::uint64_t* in, std::size_t n, std::uint64_t* out) const {
  const int tail = size_.z() % 64;
  const std::uint64_t all = ~std::uint64_t{0}, top = tail != 0 ? (std::uint64_t{1} << tail) - 1 : all;
  if (words_ == 1) return spread_words(in, top, n, out);
  for (int w = 0; w < words_; ++w, in += n, out += n)
    spread_words(in, in - n, in + n, w == words_ - 1 ? top : all, n, out);
}

// For each offset along x, from the farthest on: what the ball's slice there covers along y and z. A slice holds those
// farther out, so that only what it has more must be added.
void Dilator::slice_ball(int w) {
  const std::size_t n = plane_size_ - 2 * static_cast<std::size_t>(reach_y_);
  slices_.assign(static_cast<std::size_t>(reach_x_) + 1, nullptr);
  if (covered_.size() < slices_.size() * plane_size_) covered_.resize(slices_.size() * plane_size_);
  for (int i = reach_x_; i >= 0; --i) {
    const auto index = static_cast<std::size_t>(i);
    sources_.clear();
    if (i < reach_x_) sources_.push_back(slices_[index + 1] + reach_y_);
    for (int j = -reach_y_; j <= reach_y_; ++j) {
      const int half = half_width(i, j);
      if (half >= 0 && (i == reach_x_ || half > half_width(i + 1, j)))
        sources_.push_back(plane(half, w) + reach_y_ + j);
    }
    if (sources_.size() == 1) {
      slices_[index] = sources_.front() - reach_y_;
      continue;
    }
    std::uint64_t* out = covered_.data() + index * plane_size_;
    or_words(sources_, {.n = n}, out + reach_y_);
    slices_[index] = out;
  }
}

void Dilator::dilate(std::span<const Layer> layers, const Columns& columns, std::uint64_t* out, std::size_t out_row) {
  const bool any = gather(layers, columns);
  if (any) spread();
  const std::size_t first = static_cast<std::size_t>(reach_x_) * row_ + reach_y_;  // of the wanted columns in a plane
  const auto rows = static_cast<std::size_t>(columns.last.x() - columns.first.x() + 1);
  const auto width = static_cast<std::size_t>(columns.width());
  const auto words = static_cast<std::size_t>(words_);
  for (int w = 0; w < words_; ++w) {
    if (any) slice_ball(w);
    sources_.clear();
    for (int i = -reach_x_; any && i <= reach_x_; ++i)
      sources_.push_back(slices_[static_cast<std::size_t>(std::abs(i))] + first +
                         i * static_cast<std::ptrdiff_t>(row_));
    if (words_ == 1) {
      or_words(sources_, {rows, width, row_, out_row}, out);
      continue;
    }
    sum_.resize(rows * width);
    or_words(sources_, {rows, width, row_, width}, sum_.data());
    for (std::size_t x = 0; x < rows; ++x) {
      for (std::size_t y = 0; y < width; ++y)
        out[x * out_row + y * words + static_cast<std::size_t>(w)] = sum_[x * width + y];
    }
  }
}

// Row by row: the union of what the ball covers with each half-width, from the largest on, spread along z in between.
void Dilator::sample(std::span<const Layer> layers, int stride, const Columns& cells, std::uint64_t* out) {
  const Eigen::Vector2i middle = Eigen::Vector2i::Constant(stride / 2);
  const Columns columns{stride * cells.first + middle, stride * cells.last + middle};
  const auto words = static_cast<std::size_t>(words_);
  const int num_x = cells.last.x() - cells.first.x() + 1, num_y = cells.width();
  const std::uint64_t* in = in_place(layers, columns);
  std::size_t in_row = in != nullptr ? layers.front().row : 0;
  if (in == nullptr) {
    if (!gather(layers, columns)) {
      std::fill_n(out, static_cast<std::size_t>(num_x) * static_cast<std::size_t>(num_y) * words, 0);
      return;
    }
    in = plane(0, 0) + static_cast<std::size_t>(reach_x_) * row_ + reach_y_;
    in_row = row_;
  }
  const auto n = static_cast<std::size_t>(columns.width());
  row_sums_.assign(2 * (words + 2) * n, 0);  // before and after spreading; a word of zeros at each end
  const auto before = [&](int w) { return row_sums_.data() + static_cast<std::size_t>(w + 1) * n; };
  const auto after = [&](int w) { return before(w) + (words + 2) * n; };
  for (int x = 0; x < num_x; ++x) {
    const std::uint64_t* middle_row = in + static_cast<std::size_t>(stride * x) * in_row;
    for (int h = reach_z_; h >= 0; --h) {
      for (int w = 0; w < words_; ++w) {
        sources_.clear();
        if (h < reach_z_) sources_.push_back(after(w));
        for (const Eigen::Vector2i& offset : offsets_[static_cast<std::size_t>(h)])
          sources_.push_back(middle_row + static_cast<std::size_t>(w) * plane_size_ +
                             offset.x() * static_cast<std::ptrdiff_t>(in_row) + offset.y());
        or_words(sources_, {.n = n}, before(w));
      }
      if (h > 0) spread_by_one(before(0), n, after(0));
    }
    for (int y = 0; y < num_y; ++y) {
      for (int w = 0; w < words_; ++w) *out++ = before(w)[stride * y];
    }
  }
}

void Dilator::dilate(const Sogm& in, double radius_m, Sogm* out) {
  set(in.geometry, radius_m);
  if (out->geometry.size != in.geometry.size || out->num_frames != in.num_frames ||
      out->words.size() != in.words.size())
    out->reset(in.geometry, in.num_frames, in.start_utime, in.frame_duration_us);
  out->geometry = in.geometry;
  out->start_utime = in.start_utime;
  out->frame_duration_us = in.frame_duration_us;
  for (int frame = 0; frame < in.num_frames && !in.words.empty(); ++frame) {
    const Layer layer = layer_of(in, frame);
    dilate({&layer, 1}, layer.columns, out->column(frame, 0, 0), layer.row);
  }
}

void dilate(const Sogm& in, double radius_m, Sogm* out) {
  Dilator().dilate(in, radius_m, out);
}

}  // namespace swarm
