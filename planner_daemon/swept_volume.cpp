#include "planner_daemon/swept_volume.h"

#include <algorithm>
#include <cmath>

namespace swarm {
namespace {

// Marks voxel centres within `radius` of the segment.
void mark_capsule(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius, int frame, PartialSogm* sogm) {
  const GridGeometry& grid = sogm->map().geometry;
  const Columns& columns = sogm->written(frame);
  const Eigen::Vector3i low = grid.voxel_of(from.cwiseMin(to).array() - radius)
                                  .cwiseMax(Eigen::Vector3i(columns.first.x(), columns.first.y(), 0));
  const Eigen::Vector3i high = grid.voxel_of(from.cwiseMax(to).array() + radius)
                                   .cwiseMin(Eigen::Vector3i(columns.last.x(), columns.last.y(), grid.size.z() - 1));
  const Eigen::Vector3d along = to - from;
  const double inverse_length2 = 1.0 / std::max(along.squaredNorm(), 1e-12);
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      std::uint64_t* column = sogm->column(frame, x, y);
      for (int z = low.z(); z <= high.z(); ++z) {
        const Eigen::Vector3d offset = grid.center_of({x, y, z}) - from;
        const double s = std::clamp(offset.dot(along) * inverse_length2, 0.0, 1.0);
        if ((offset - s * along).squaredNorm() <= radius * radius) column[z >> 6] |= std::uint64_t{1} << (z & 63);
      }
    }
  }
}

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

void mark_swept_volume(const Motion& motion, double radius_m, PartialSogm* sogm) {
  const Sogm& map = sogm->map();
  for (int frame = 0; frame < map.num_frames; ++frame) {
    const std::int64_t begin = map.start_utime + frame * map.frame_duration_us;
    const std::int64_t end = sogm->written(frame).empty() ? begin : begin + map.frame_duration_us;
    for (std::int64_t from = begin; from < end;) {
      const std::int64_t to = std::min(motion.next_knot_after(from), end);
      const ControlPoints points = control_points_between(motion, from, to);
      mark_capsule(points.col(0), points.col(5), radius_m + distance_from_chord(points), frame, sogm);
      from = to;
    }
  }
}

}  // namespace swarm
