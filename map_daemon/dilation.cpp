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

void Dilator::dilate_columns(const Sogm& in, int frame, const Columns& columns) {
  const bool any = load(in, frame, columns);
  const int width = columns.width(), num_rows = columns.last.x() - columns.first.x() + 1;
  const std::size_t first = static_cast<std::size_t>(reach_x_) * row_ + reach_y_;  // of the wanted columns in a plane
  const std::size_t n = static_cast<std::size_t>(num_rows) * row_ - 2 * static_cast<std::size_t>(reach_y_);
  if (sum_.size() < n) sum_.resize(n);
  for (int w = 0; w < words_; ++w) {
    if (any) {
      sources_.clear();
      for (int i = -reach_x_; i <= reach_x_; ++i) {
        for (int j = -reach_y_; j <= reach_y_; ++j) {
          if (half_width(i, j) < 0) continue;
          sources_.push_back(plane(half_width(i, j), w) + first + i * static_cast<std::ptrdiff_t>(row_) + j);
        }
      }
      or_words(sources_, n, sum_.data());
    } else {
      std::fill_n(sum_.begin(), n, 0);
    }
    for (int i = 0; i < num_rows; ++i) {
      copy_strided(sum_.data() + static_cast<std::size_t>(i) * row_, 1, width, words_,
                   out_.column(frame, columns.first.x() + i, columns.first.y()) + w);
    }
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
