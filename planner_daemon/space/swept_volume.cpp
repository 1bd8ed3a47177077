#include "planner_daemon/space/swept_volume.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "lcmtypes/bus/wide.h"

namespace swarm {
namespace {

double distance_from_chord(const ControlPoints& points) {
  const Eigen::Vector3d from = points.col(0), along = points.col(5) - from;
  const double inverse_length2 = 1.0 / std::max(along.squaredNorm(), 1e-12);
  double distance2 = 0.0;
  for (int k = 1; k < 5; ++k) {
    const Eigen::Vector3d offset = points.col(k) - from;
    const double s = std::clamp(offset.dot(along) * inverse_length2, 0.0, 1.0);
    distance2 = std::max(distance2, (offset - s * along).squaredNorm());
  }
  return std::sqrt(distance2);
}

struct Capsule {
  Eigen::Vector3d along;  // its axis
  double radius_m;
};

// Where columns meet a capsule, n of them from `offset` from the axis' start on, seen from above: from low[i] to
// high[i] [m] above the start; low > high where they do not. A column meets the capsule where it meets the spheres
// around the axis: at share s of it from z - w to z + w, w^2 = radius^2 - (distance from above)^2. Both are extreme
// where the derivative by s vanishes, or at the nearest end of the axis.
SWARM_WIDE void cut_columns(const Capsule& capsule, const Eigen::Vector2d& offset, double step_m, std::size_t n,
                            double* __restrict low, double* __restrict high) {
  const double ax = capsule.along.x(), ay = capsule.along.y(), az = capsule.along.z();
  const double level2 = std::max(ax * ax + ay * ay, 1e-12), per_level2 = 1.0 / level2;
  const double steepness = az / std::sqrt(level2 * (level2 + az * az));
  const double radius2 = capsule.radius_m * capsule.radius_m;
  const auto clamp = [](double share) { return std::min(std::max(share, 0.0), 1.0); };
  for (std::size_t i = 0; i < n; ++i) {
    const double x = offset.x(), y = offset.y() + static_cast<double>(static_cast<std::int32_t>(i)) * step_m;
    const double nearest = (x * ax + y * ay) * per_level2;
    const double off_x = x - nearest * ax, off_y = y - nearest * ay;
    const double wide2 = radius2 - (off_x * off_x + off_y * off_y);
    const double extreme = steepness * std::sqrt(std::max(wide2, 0.0));
    const double s_low = clamp(nearest - extreme), s_high = clamp(nearest + extreme);
    const double away_low = s_low - nearest, away_high = s_high - nearest, end = clamp(nearest) - nearest;
    const double w_low = std::sqrt(std::max(wide2 - level2 * away_low * away_low, 0.0));
    const double w_high = std::sqrt(std::max(wide2 - level2 * away_high * away_high, 0.0));
    const bool meets = wide2 >= level2 * end * end;
    low[i] = meets ? s_low * az - w_low : std::numeric_limits<double>::infinity();
    high[i] = s_high * az + w_high;
  }
}

}  // namespace

void SweptVolumes::lay_out(const Sogm& sogm) {
  grid_ = sogm.geometry;
  start_utime_ = sogm.start_utime;
  frame_duration_ = sogm.frame_duration;
  patches_.resize(static_cast<std::size_t>(sogm.num_frames));
  for (auto& patches : patches_) patches.clear();
  words_.clear();
}

// Voxel centres within `radius_m` of the segment; nothing where there are none.
std::optional<SweptVolumes::Patch> SweptVolumes::mark_capsule(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                                                              double radius_m, const Columns& bounds) {
  const Eigen::Vector3i low = grid_.voxel_of(from.cwiseMin(to).array() - radius_m)
                                  .cwiseMax(Eigen::Vector3i(bounds.first.x(), bounds.first.y(), 0));
  const Eigen::Vector3i high = grid_.voxel_of(from.cwiseMax(to).array() + radius_m)
                                   .cwiseMin(Eigen::Vector3i(bounds.last.x(), bounds.last.y(), grid_.size.z() - 1));
  if ((low.array() > high.array()).any()) return {};
  const auto words = static_cast<std::size_t>(grid_.words_per_column());
  const Patch patch{{low.head<2>(), high.head<2>()}, words_.size()};
  words_.resize(words_.size() + row_of(patch) * static_cast<std::size_t>(high.x() - low.x() + 1), 0);
  const auto width = static_cast<std::size_t>(patch.columns.width());
  low_m_.resize(width);
  high_m_.resize(width);
  const Capsule capsule{to - from, radius_m};
  const double per_m = 1.0 / grid_.resolution_m, bottom = from.z() * per_m - 0.5 - grid_.origin.z();
  std::uint64_t* column = words_.data() + patch.first;
  for (int x = low.x(); x <= high.x(); ++x) {
    const Eigen::Vector2d offset = grid_.center_of({x, low.y(), 0}).head<2>() - from.head<2>();
    cut_columns(capsule, offset, grid_.resolution_m, width, low_m_.data(), high_m_.data());
    for (std::size_t y = 0; y < width; ++y, column += words)
      set_run(bottom + low_m_[y] * per_m, bottom + high_m_[y] * per_m, grid_.size.z(), column);
  }
  return patch;
}

void SweptVolumes::add(const Motion& motion, double radius_m, Duration clock_error, std::span<const Columns> bounds) {
  const auto num_frames = static_cast<std::int64_t>(patches_.size());
  // The last frame stays in force: all that comes after belongs to it.
  const Utime end =
      std::max(start_utime_ + num_frames * frame_duration_, motion.end_utime()) + clock_error + frame_duration_;
  for (Utime from = start_utime_ - clock_error; from < end;) {  // one quintic after the other
    const Utime to = std::min(motion.next_knot_after(from), end);
    const ControlPoints quintic = control_points_between(motion, from, to);
    const Columns around{grid_.voxel_of(quintic.rowwise().minCoeff().array() - radius_m).head<2>(),
                         grid_.voxel_of(quintic.rowwise().maxCoeff().array() + radius_m).head<2>()};
    const auto share = [&](Utime utime) {
      return static_cast<double>((utime - from).count()) / static_cast<double>((to - from).count());
    };
    std::optional<Patch> rests;  // the same in every frame
    if ((quintic.colwise() - quintic.col(0)).isZero(0.0))
      rests = mark_capsule(quintic.col(0), quintic.col(0), radius_m, all_columns(grid_));
    const std::int64_t first = (from - clock_error - start_utime_) / frame_duration_;
    for (std::int64_t frame = std::clamp<std::int64_t>(first, 0, num_frames - 1); frame < num_frames; ++frame) {
      const Utime begin = start_utime_ + frame * frame_duration_ - clock_error;
      const Utime until = frame + 1 == num_frames ? end : begin + frame_duration_ + 2 * clock_error;
      if (begin >= to) break;
      const Columns& columns = bounds[static_cast<std::size_t>(frame)];
      if (columns.empty() || !intersect(around, columns)) continue;
      std::optional<Patch> patch = rests;
      if (!patch) {
        const ControlPoints points = part_of(quintic, share(std::max(begin, from)), share(std::min(until, to)));
        patch = mark_capsule(points.col(0), points.col(5), radius_m + distance_from_chord(points), columns);
      }
      if (patch) patches_[static_cast<std::size_t>(frame)].push_back(*patch);
    }
    from = to;
  }
}

void SweptVolumes::append_layers(int frame, const Columns& columns, std::vector<Layer>* layers) const {
  for (const Patch& patch : patches_[static_cast<std::size_t>(frame)]) {
    if (intersect(patch.columns, columns))
      layers->push_back({patch.columns, words_.data() + patch.first, row_of(patch)});
  }
}

}  // namespace swarm
