#include "map_daemon/dilation.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "map_daemon/wide.h"

namespace swarm {
namespace {

// out = in, and its neighbours along z; `below` and `above` are the adjacent words of the same columns.
SWARM_WIDE void spread_by_one(const std::uint64_t* __restrict in, const std::uint64_t* __restrict below,
                              const std::uint64_t* __restrict above, int n, std::uint64_t* __restrict out) {
  for (int i = 0; i < n; ++i) out[i] = in[i] | in[i] << 1 | in[i] >> 1 | below[i] >> 63 | above[i] << 63;
}

SWARM_WIDE void or_two(const std::uint64_t* a, const std::uint64_t* b, int n, std::uint64_t* __restrict out) {
  for (int i = 0; i < n; ++i) out[i] |= a[i] | b[i];
}

SWARM_WIDE void or_strided(const std::uint64_t* __restrict in, int n, int stride, std::uint64_t* __restrict out) {
  if (stride == 1) {
    for (int i = 0; i < n; ++i) out[i] |= in[i];
  } else {
    for (int i = 0; i < n; ++i) out[i] |= in[static_cast<std::size_t>(i) * stride];
  }
}

SWARM_WIDE std::uint64_t or_all(const std::uint64_t* in, int n) {
  std::uint64_t any = 0;
  for (int i = 0; i < n; ++i) any |= in[i];
  return any;
}

SWARM_WIDE void or_masked(const std::uint64_t* __restrict in, std::uint64_t mask, int n, int stride,
                          std::uint64_t* __restrict out) {
  if (stride == 1) {
    for (int i = 0; i < n; ++i) out[i] |= in[i] & mask;
  } else {
    for (int i = 0; i < n; ++i) out[static_cast<std::size_t>(i) * stride] |= in[i] & mask;
  }
}

}  // namespace

std::uint64_t* Dilator::spread_row(int h, int w) {
  return spread_.data() + (static_cast<std::size_t>(h) * (words_ + 2) + w + 1) * (columns_ + 2 * reach_y_);
}

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
  columns_ = geometry.size.y();
  words_ = geometry.words_per_column();
  spread_.assign(static_cast<std::size_t>(reach_z_ + 1) * (words_ + 2) * (columns_ + 2 * reach_y_), 0);
  disc_.resize(static_cast<std::size_t>(columns_));
}

void Dilator::clear(const Sogm& in) {
  const bool same = out_.geometry.size == in.geometry.size && out_.num_frames == in.num_frames && !out_.words.empty();
  if (!same) {
    out_.reset(in.geometry, in.num_frames, in.start_utime, in.frame_duration_us);
    written_.assign(static_cast<std::size_t>(in.num_frames), {});
    return;
  }
  out_.geometry = in.geometry;
  out_.start_utime = in.start_utime;
  out_.frame_duration_us = in.frame_duration_us;
  for (int frame = 0; frame < in.num_frames; ++frame) {
    const Columns& columns = written_[static_cast<std::size_t>(frame)];
    for (int x = columns.first.x(); x <= columns.last.x(); ++x) {
      std::fill_n(out_.column(frame, x, columns.first.y()), (columns.last.y() - columns.first.y() + 1) * words_, 0);
    }
  }
}

bool Dilator::load_row(const Sogm& in, int frame, int frames_before, int x, int from_y) {
  std::uint64_t any = 0;
  for (int w = 0; w < words_; ++w) {
    std::uint64_t* out = spread_row(0, w) + reach_y_;
    std::fill_n(out, columns_, 0);
    for (int before = 0; before <= std::min(frame, frames_before); ++before)
      or_strided(in.column(frame - before, x, from_y) + w, columns_, words_, out);
    any |= or_all(out, columns_);
  }
  if (any == 0) return false;
  for (int h = 1; h <= reach_z_; ++h) {
    for (int w = 0; w < words_; ++w) {
      spread_by_one(spread_row(h - 1, w), spread_row(h - 1, w - 1), spread_row(h - 1, w + 1), columns_ + 2 * reach_y_,
                    spread_row(h, w));
    }
  }
  return true;
}

void Dilator::dilate_frame(const Sogm& in, int frame, int frames_before, const Columns& columns) {
  const Eigen::Vector3i& size = in.geometry.size;
  const int tail = size.z() % 64, first_y = columns.first.y(), n = columns.last.y() - first_y + 1;
  const std::uint64_t top_mask = tail == 0 ? ~std::uint64_t{0} : (std::uint64_t{1} << tail) - 1;
  const int from_y = std::max(0, first_y - reach_y_), to_y = std::min(size.y() - 1, columns.last.y() + reach_y_);
  columns_ = to_y - from_y + 1;
  std::fill(spread_.begin(), spread_.end(), 0);  // the rows' margins lie elsewhere when `columns_` changes
  const int from_x = std::max(0, columns.first.x() - reach_x_);
  const int to_x = std::min(size.x() - 1, columns.last.x() + reach_x_);
  for (int x = from_x; x <= to_x; ++x) {
    if (!load_row(in, frame, frames_before, x, from_y)) continue;
    for (int i = 0; i <= reach_x_; ++i) {  // one plane of the ball serves the rows x - i and x + i
      const bool lower = x - i >= columns.first.x() && x - i <= columns.last.x();
      const bool upper = i > 0 && x + i >= columns.first.x() && x + i <= columns.last.x();
      if (!lower && !upper) continue;
      for (int w = 0; w < words_; ++w) {
        std::fill(disc_.begin(), disc_.end(), 0);
        for (int j = 0; j <= reach_y_ && half_width(i, j) >= 0; ++j) {
          const std::uint64_t* source = spread_row(half_width(i, j), w) + reach_y_;
          or_two(source - j, source + j, columns_, disc_.data());
        }
        const std::uint64_t mask = w == words_ - 1 ? top_mask : ~std::uint64_t{0};
        const std::uint64_t* disc = disc_.data() + first_y - from_y;
        if (lower) or_masked(disc, mask, n, words_, out_.column(frame, x - i, first_y) + w);
        if (upper) or_masked(disc, mask, n, words_, out_.column(frame, x + i, first_y) + w);
      }
    }
  }
}

Dilator::Columns Dilator::reached(const Sogm& in, int frame, const Reach& reach) {
  // The last frame stays in force after its end.
  const bool last = frame + 1 == in.num_frames;
  const double end_s = 1e-6 * static_cast<double>(in.start_utime + (frame + 1) * in.frame_duration_us - reach.utime);
  if (end_s < 0.0 && !last) return {};
  const double until_s = last ? reach.horizon_s : std::min(end_s, reach.horizon_s);
  const double way_m = reach.speed_mps * until_s + in.geometry.resolution_m;
  const Eigen::Vector3i end = in.geometry.size - Eigen::Vector3i::Ones();
  return {in.geometry.voxel_of(reach.center.array() - way_m).cwiseMax(0).head<2>(),
          in.geometry.voxel_of(reach.center.array() + way_m).cwiseMin(end).head<2>()};
}

const Sogm& Dilator::dilate(const Sogm& in, double radius_m, const Reach* reach, int frames_before) {
  shape_ball(in.geometry, radius_m);
  clear(in);
  for (int frame = 0; frame < in.num_frames && !in.words.empty(); ++frame) {
    Columns& columns = written_[static_cast<std::size_t>(frame)];
    columns = {Eigen::Vector2i::Zero(), in.geometry.size.head<2>() - Eigen::Vector2i::Ones()};
    if (reach != nullptr) columns = reached(in, frame, *reach);
    if ((columns.first.array() > columns.last.array()).any()) {
      columns = {};
    } else {
      dilate_frame(in, frame, frames_before, columns);
    }
  }
  return out_;
}

void dilate(const Sogm& in, double radius_m, Sogm* out, const Reach* reach) {
  *out = Dilator().dilate(in, radius_m, reach);
}

}  // namespace swarm
