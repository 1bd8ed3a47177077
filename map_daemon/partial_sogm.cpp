#include "map_daemon/partial_sogm.h"

#include <algorithm>
#include <cmath>

#include "map_daemon/wide.h"

namespace swarm {
namespace {

// Farthest along an axis after `t_s` with this velocity [m].
double farthest(double velocity, double t_s, const Reach& reach) {
  if (velocity >= reach.speed_mps) return velocity * t_s;
  const double gain = reach.speed_mps - velocity, until_s = gain / reach.acceleration_mps2;
  if (t_s < until_s) return velocity * t_s + reach.acceleration_mps2 * t_s * t_s / 2;
  return reach.speed_mps * t_s - gain * until_s / 2;
}

}  // namespace

Span span(const Reach& reach, int axis, double from_s, double to_s) {
  const double v = reach.velocity[axis];  // the farthest is convex in time: its largest value is at an end
  return {reach.center[axis] - std::max(farthest(-v, from_s, reach), farthest(-v, to_s, reach)),
          reach.center[axis] + std::max(farthest(v, from_s, reach), farthest(v, to_s, reach))};
}

Columns Columns::grown(int margin, const GridGeometry& geometry) const {
  if (empty()) return {};
  const Columns all = all_columns(geometry);
  return {(first.array() - margin).max(all.first.array()), (last.array() + margin).min(all.last.array())};
}

Columns all_columns(const GridGeometry& geometry) {
  return {Eigen::Vector2i::Zero(), geometry.size.head<2>() - Eigen::Vector2i::Ones()};
}

Columns reached(const Sogm& sogm, int frame, const Reach& reach, double linger_s) {
  const bool last = frame + 1 == sogm.num_frames;
  const auto since_s = [&](int number) {
    return 1e-6 * static_cast<double>(sogm.start_utime + number * sogm.frame_duration_us - reach.utime);
  };
  const double end_s = since_s(frame + 1) + linger_s;
  if (end_s < 0.0 && !last) return {};
  const double to_s = last ? reach.horizon_s : std::min(end_s, reach.horizon_s);
  const double from_s = std::clamp(since_s(frame), 0.0, to_s);
  const Span x = span(reach, 0, from_s, to_s), y = span(reach, 1, from_s, to_s);
  const Eigen::Vector3d low(x.low, y.low, 0.0), high(x.high, y.high, 0.0);
  const GridGeometry& grid = sogm.geometry;
  const Columns all = all_columns(grid);
  return {grid.voxel_of(low.array() - grid.resolution_m).head<2>().cwiseMax(all.first),
          grid.voxel_of(high.array() + grid.resolution_m).head<2>().cwiseMin(all.last)};
}

void PartialSogm::lay_out(const GridGeometry& geometry, int num_frames, std::int64_t start_utime,
                          std::int64_t frame_duration_us) {
  if (map_.geometry.size != geometry.size || map_.num_frames != num_frames) {
    map_.reset(geometry, num_frames, start_utime, frame_duration_us);
    written_.assign(static_cast<std::size_t>(num_frames), {});
  }
  map_.geometry = geometry;
  map_.start_utime = start_utime;
  map_.frame_duration_us = frame_duration_us;
}

void PartialSogm::claim(int frame, const Columns& columns) {
  Columns& before = written_[static_cast<std::size_t>(frame)];
  const int words = map_.geometry.words_per_column();
  for_each_outside(before, columns, [&](int x, int first_y, int last_y) {
    std::fill_n(column(frame, x, first_y), (last_y - first_y + 1) * words, 0);
  });
  before = columns;
}

void PartialSogm::copy(const Sogm& from, int frame, const Columns& columns) {
  claim(frame, columns);
  for (int x = columns.first.x(); x <= columns.last.x() && !columns.empty(); ++x) {
    std::copy_n(from.column(frame, x, columns.first.y()), columns.width() * map_.geometry.words_per_column(),
                column(frame, x, columns.first.y()));
  }
}

void PartialSogm::accumulate(const Sogm& from, int frames_before, const Reach& reach) {
  lay_out(from);
  for (int frame = 0; frame < from.num_frames; ++frame) {
    const Columns columns = reached(from, frame, reach);
    claim(frame, columns);
    if (columns.empty()) continue;
    const auto n = static_cast<std::size_t>(columns.width() * map_.geometry.words_per_column());
    sources_.clear();
    for (int before = 0; before <= std::min(frame, frames_before); ++before)
      sources_.push_back(from.column(frame - before, columns.first.x(), columns.first.y()));
    const std::size_t row = static_cast<std::size_t>(map_.geometry.size.y()) * map_.geometry.words_per_column();
    const auto rows = static_cast<std::size_t>(columns.last.x() - columns.first.x() + 1);
    or_words(sources_, {rows, n, row, row}, column(frame, columns.first.x(), columns.first.y()));
  }
}

}  // namespace swarm
