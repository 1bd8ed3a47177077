#include "planner_daemon/swept_volume.h"

#include <algorithm>
#include <cmath>

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

}  // namespace

void SweptVolumes::lay_out(const Sogm& sogm) {
  grid_ = sogm.geometry;
  start_utime_ = sogm.start_utime;
  frame_duration_us_ = sogm.frame_duration_us;
  if (patches_.size() != static_cast<std::size_t>(sogm.num_frames)) patches_.resize(sogm.num_frames);
  for (auto& patches : patches_) patches.clear();
  words_.clear();
}

// Voxel centres within `radius_m` of the segment.
void SweptVolumes::mark_capsule(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_m, int frame,
                                const Columns& bounds) {
  const Eigen::Vector3i low = grid_.voxel_of(from.cwiseMin(to).array() - radius_m)
                                  .cwiseMax(Eigen::Vector3i(bounds.first.x(), bounds.first.y(), 0));
  const Eigen::Vector3i high = grid_.voxel_of(from.cwiseMax(to).array() + radius_m)
                                   .cwiseMin(Eigen::Vector3i(bounds.last.x(), bounds.last.y(), grid_.size.z() - 1));
  if ((low.array() > high.array()).any()) return;
  const auto words = static_cast<std::size_t>(grid_.words_per_column());
  const Patch patch{{low.head<2>(), high.head<2>()}, words_.size()};
  words_.resize(words_.size() + row_of(patch) * static_cast<std::size_t>(high.x() - low.x() + 1), 0);
  patches_[static_cast<std::size_t>(frame)].push_back(patch);
  // The column at `offset` from the axis' start, seen from above, meets the capsule where it meets the spheres around
  // the axis: at share s of it from z - w to z + w, w^2 = radius^2 - (distance from above)^2. Both are extreme where
  // the derivative by s vanishes, or at the nearest end of the axis.
  std::uint64_t* column = words_.data() + patch.first;
  const Eigen::Vector3d along = to - from;
  const double level2 = std::max(along.head<2>().squaredNorm(), 1e-12), radius2 = radius_m * radius_m;
  const double steepness = along.z() / std::sqrt(level2 * (level2 + along.z() * along.z()));
  const double per_m = 1.0 / grid_.resolution_m, per_level2 = 1.0 / level2;
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y, column += words) {
      const Eigen::Vector2d offset = grid_.center_of({x, y, 0}).head<2>() - from.head<2>();
      const double nearest = offset.dot(along.head<2>()) * per_level2;
      const double wide2 = radius2 - (offset - nearest * along.head<2>()).squaredNorm();
      const double end = std::clamp(nearest, 0.0, 1.0) - nearest;
      if (wide2 < level2 * end * end) continue;
      const double extreme = steepness * std::sqrt(wide2);
      const auto reach = [&](double side) {  // [voxels]
        const double s = std::clamp(nearest + side * extreme, 0.0, 1.0), off = s - nearest;
        const double wide_m = std::sqrt(std::max(0.0, wide2 - level2 * off * off));
        return (from.z() + s * along.z() + side * wide_m) * per_m - 0.5 - grid_.origin.z();
      };
      const double lowest = std::max<double>(reach(-1.0), low.z());  // >= 0
      const int bottom = static_cast<int>(lowest) + (lowest > static_cast<int>(lowest) ? 1 : 0);
      const int top = static_cast<int>(std::min<double>(reach(1.0), high.z()) + 1.0) - 1;  // may be -1
      for (int z = bottom; z <= top; ++z) column[z >> 6] |= std::uint64_t{1} << (z & 63);
    }
  }
}

void SweptVolumes::add(const Motion& motion, double radius_m, std::span<const Columns> bounds) {
  const auto num_frames = static_cast<std::int64_t>(patches_.size());
  const std::int64_t end = start_utime_ + num_frames * frame_duration_us_;
  for (std::int64_t from = start_utime_; from < end;) {  // one quintic after the other
    const std::int64_t to = std::min(motion.next_knot_after(from), end);
    const ControlPoints quintic = control_points_between(motion, from, to);
    const auto share = [&](std::int64_t utime) {
      return static_cast<double>(utime - from) / static_cast<double>(to - from);
    };
    for (std::int64_t frame = (from - start_utime_) / frame_duration_us_; frame < num_frames; ++frame) {
      const std::int64_t begin = start_utime_ + frame * frame_duration_us_;
      if (begin >= to) break;
      const Columns& columns = bounds[static_cast<std::size_t>(frame)];
      if (columns.empty()) continue;
      const ControlPoints points =
          part_of(quintic, share(std::max(begin, from)), share(std::min(begin + frame_duration_us_, to)));
      mark_capsule(points.col(0), points.col(5), radius_m + distance_from_chord(points), static_cast<int>(frame),
                   columns);
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
