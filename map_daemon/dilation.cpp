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
SWARM_WIDE void spread_by_one(const std::uint64_t* __restrict in, const std::uint64_t* __restrict below,
                              const std::uint64_t* __restrict above, std::uint64_t inside, std::size_t n,
                              std::uint64_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i)
    out[i] = (in[i] | in[i] << 1 | in[i] >> 1 | below[i] >> 63 | above[i] << 63) & inside;
}

// For columns of one word.
SWARM_WIDE void spread_by_one(const std::uint64_t* __restrict in, std::uint64_t inside, std::size_t n,
                              std::uint64_t* __restrict out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = (in[i] | in[i] << 1 | in[i] >> 1) & inside;
}

SWARM_WIDE std::uint64_t or_all(const std::uint64_t* in, std::size_t n) {
  std::uint64_t any = 0;
  for (std::size_t i = 0; i < n; ++i) any |= in[i];
  return any;
}

void copy_strided(const std::uint64_t* in, int in_stride, int n, int out_stride, std::uint64_t* out) {
  if (in_stride == 1 && out_stride == 1) {
    std::copy_n(in, n, out);
  } else {
    for (int i = 0; i < n; ++i) out[i * out_stride] = in[i * in_stride];
  }
}

}  // namespace

void Dilator::shape_ball(const GridGeometry& geometry, double radius_m) {
  if (!(std::isfinite(radius_m) && radius_m >= 0.0)) {
    throw std::invalid_argument("dilation radius " + std::to_string(radius_m) + " m: must be finite and >= 0");
  }
  const double ratio = radius_m / geometry.resolution_m;
  const double squared = std::floor(ratio * ratio + 1e-9);
  // Half-width of the ball at squared horizontal offset d2, clipped to the window; -1 where there is none.
  const auto half = [squared](int d2, int extent) {
    return d2 > squared ? -1 : static_cast<int>(std::min<double>(std::floor(std::sqrt(squared - d2)), extent - 1));
  };
  reach_x_ = half(0, geometry.size.x());
  reach_y_ = half(0, geometry.size.y());
  reach_z_ = half(0, geometry.size.z());
  half_widths_.clear();
  for (int i = 0; i <= reach_x_; ++i) {
    for (int j = 0; j <= reach_y_; ++j) half_widths_.push_back(half(i * i + j * j, geometry.size.z()));
  }
  words_ = geometry.words_per_column();
}

bool Dilator::load(const Sogm& in, int frame, const Columns& columns) {
  const Eigen::Vector3i& size = in.geometry.size;
  const int low_x = columns.first.x() - reach_x_, low_y = columns.first.y() - reach_y_;
  const int num_rows = columns.last.x() + reach_x_ - low_x + 1;
  row_ = static_cast<std::size_t>(columns.width() + 2 * reach_y_);
  plane_size_ = row_ * static_cast<std::size_t>(num_rows);
  const std::size_t needed = static_cast<std::size_t>(reach_z_ + 1) * (words_ + 2) * plane_size_;
  if (planes_.size() < needed) planes_.resize(needed);
  const int first_y = std::max(0, low_y), last_y = std::min(size.y() - 1, columns.last.y() + reach_y_);
  const bool clipped = first_y > low_y || last_y < columns.last.y() + reach_y_;
  std::uint64_t any = 0;
  for (int w = 0; w < words_; ++w) {
    for (int i = 0; i < num_rows; ++i) {
      std::uint64_t* out = plane(0, w) + static_cast<std::size_t>(i) * row_;
      const int x = low_x + i;
      const bool known = x >= 0 && x < size.x();
      if (!known || clipped) std::fill_n(out, row_, 0);
      if (known) copy_strided(in.column(frame, x, first_y) + w, words_, last_y - first_y + 1, 1, out + first_y - low_y);
    }
    any |= or_all(plane(0, w), plane_size_);
  }
  if (any == 0) return false;
  const int tail = size.z() % 64;
  const std::uint64_t all = ~std::uint64_t{0}, top = tail != 0 ? (std::uint64_t{1} << tail) - 1 : all;
  for (int h = 1; h <= reach_z_; ++h) {
    if (words_ == 1) {
      spread_by_one(plane(h - 1, 0), top, plane_size_, plane(h, 0));
      continue;
    }
    for (const int w : {-1, words_}) std::fill_n(plane(h - 1, w), plane_size_, 0);
    for (int w = 0; w < words_; ++w) {
      spread_by_one(plane(h - 1, w), plane(h - 1, w - 1), plane(h - 1, w + 1), w == words_ - 1 ? top : all, plane_size_,
                    plane(h, w));
    }
  }
  return true;
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

void Dilator::dilate_columns(const Sogm& in, int frame, const Columns& columns) {
  const bool any = load(in, frame, columns);
  const std::size_t first = static_cast<std::size_t>(reach_x_) * row_ + reach_y_;  // of the wanted columns in a plane
  const auto rows = static_cast<std::size_t>(columns.last.x() - columns.first.x() + 1);
  const auto width = static_cast<std::size_t>(columns.width());
  const std::size_t out_row = static_cast<std::size_t>(in.geometry.size.y()) * words_;
  std::uint64_t* out = out_.column(frame, columns.first.x(), columns.first.y());
  for (int w = 0; w < words_; ++w) {
    sources_.clear();
    if (any) {
      slice_ball(w);
      sources_.clear();
      for (int i = -reach_x_; i <= reach_x_; ++i)
        sources_.push_back(slices_[static_cast<std::size_t>(std::abs(i))] + first +
                           i * static_cast<std::ptrdiff_t>(row_));
    }
    if (words_ == 1) {
      or_words(sources_, {rows, width, row_, out_row}, out);
      continue;
    }
    sum_.resize(rows * width);
    or_words(sources_, {rows, width, row_, width}, sum_.data());
    for (std::size_t i = 0; i < rows; ++i)
      copy_strided(sum_.data() + i * width, 1, columns.width(), words_, out + i * out_row + w);
  }
}

const Sogm& Dilator::dilate(const Sogm& in, double radius_m, const Reach* reach, double linger_s) {
  shape_ball(in.geometry, radius_m);
  out_.lay_out(in);
  for (int frame = 0; frame < in.num_frames && !in.words.empty(); ++frame) {
    const Columns columns = reach != nullptr ? reached(in, frame, *reach, linger_s) : all_columns(in.geometry);
    out_.claim(frame, columns);
    if (columns.empty()) continue;
    dilate_columns(in, frame, columns);
  }
  return out_.map();
}

void dilate(const Sogm& in, double radius_m, Sogm* out) {
  *out = Dilator().dilate(in, radius_m);
}

}  // namespace swarm
