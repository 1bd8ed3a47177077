// Small seeded maps for the tests, drawn voxel by voxel: no code in common with the rasteriser.
#pragma once

#include <algorithm>
#include <cstdint>

#include "map_daemon/sogm.h"
#include "tests/support/random_motion.h"

namespace swarm {

// Window of `size_m` centred at the origin.
inline Sogm empty_map(const Eigen::Vector3d& size_m, double resolution_m, int frames, Utime start,
                      Duration frame_duration) {
  GridGeometry geometry;
  geometry.resolution_m = resolution_m;
  geometry.size = (size_m / resolution_m).array().round().matrix().cast<int>();
  geometry.origin = -geometry.size / 2;
  Sogm sogm;
  sogm.reset(geometry, frames, start, frame_duration);
  return sogm;
}

inline void set_voxel(Sogm* sogm, int frame, const Eigen::Vector3i& voxel) {
  sogm->column(frame, voxel.x(), voxel.y())[voxel.z() >> 6] |= std::uint64_t{1} << (voxel.z() & 63);
}

// Occupies voxels whose centre lies in [low, high], in frames [first, last].
inline void mark_box(Sogm* sogm, const Eigen::Vector3d& low, const Eigen::Vector3d& high, int first = 0,
                     int last = 1 << 20) {
  const GridGeometry& grid = sogm->geometry;
  Eigen::Vector3i from = Eigen::Vector3i::Zero(), to = grid.size - Eigen::Vector3i::Ones();
  for (int axis = 0; axis < 3; ++axis) {
    while (from[axis] <= to[axis] && grid.center_of(from)[axis] < low[axis]) ++from[axis];
    while (from[axis] <= to[axis] && grid.center_of(to)[axis] > high[axis]) --to[axis];
  }
  for (int i = first; i <= std::min(last, sogm->num_frames - 1); ++i) {
    for (int x = from.x(); x <= to.x(); ++x) {
      for (int y = from.y(); y <= to.y(); ++y) {
        for (int z = from.z(); z <= to.z(); ++z) set_voxel(sogm, i, {x, y, z});
      }
    }
  }
}

// Occupies voxels of a frame whose centre is within `radius_m` of `center`; of its vertical axis for a column.
inline void mark_ball(Sogm* sogm, int frame, const Eigen::Vector3d& center, double radius_m, bool column = false) {
  const GridGeometry& grid = sogm->geometry;
  Eigen::Vector3i low = grid.voxel_of(center.array() - radius_m).cwiseMax(0);
  Eigen::Vector3i high = grid.voxel_of(center.array() + radius_m).cwiseMin(grid.size - Eigen::Vector3i::Ones());
  if (column) low.z() = 0, high.z() = grid.size.z() - 1;
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        Eigen::Vector3d offset = grid.center_of({x, y, z}) - center;
        if (column) offset.z() = 0.0;
        if (offset.squaredNorm() <= radius_m * radius_m) set_voxel(sogm, frame, {x, y, z});
      }
    }
  }
}

// A ball or column that moves uniformly, at `center` when the map starts.
inline void mark_moving(Sogm* sogm, const Eigen::Vector3d& center, const Eigen::Vector3d& velocity, double radius_m,
                        bool column = false) {
  const int samples = velocity.isZero() ? 1 : 5;
  for (int frame = 0; frame < sogm->num_frames; ++frame) {
    for (int i = 0; i < samples; ++i) {
      const double t = to_seconds(sogm->frame_duration) * (frame + 0.25 * i);
      mark_ball(sogm, frame, center + t * velocity, radius_m, column);
    }
  }
}

template <class Visit>
void for_each_column(const GridGeometry& geometry, const Visit& visit) {
  for (int x = 0; x < geometry.size.x(); ++x) {
    for (int y = 0; y < geometry.size.y(); ++y) visit(x, y);
  }
}

inline bool holds(const Columns& columns, int x, int y) {
  return x >= columns.first.x() && x <= columns.last.x() && y >= columns.first.y() && y <= columns.last.y();
}

inline Columns random_columns(Rng& rng, const Eigen::Vector2i& size) {
  const Eigen::Vector2i first(uniform_int(rng, 0, size.x() - 1), uniform_int(rng, 0, size.y() - 1));
  return {first, {uniform_int(rng, first.x(), size.x() - 1), uniform_int(rng, first.y(), size.y() - 1)}};
}

// Every voxel by itself.
inline Sogm random_bits(const Eigen::Vector3i& size, int frames, double density, double resolution_m, Rng& rng) {
  Sogm sogm;
  sogm.reset({.resolution_m = resolution_m, .origin = {-7, 3, 1}, .size = size}, frames, to_utime(1000), 100ms);
  std::bernoulli_distribution occupied(density);
  for (int frame = 0; frame < frames; ++frame) {
    for_each_column(sogm.geometry, [&](int x, int y) {
      for (int z = 0; z < size.z(); ++z) {
        if (occupied(rng)) set_voxel(&sogm, frame, {x, y, z});
      }
    });
  }
  return sogm;
}

// Balls and columns, half of them moving.
inline Sogm random_map(Rng& rng, int obstacles, const Eigen::Vector3d& size_m, int frames, Utime start,
                       Duration frame_duration, double resolution_m = 0.1) {
  Sogm sogm = empty_map(size_m, resolution_m, frames, start, frame_duration);
  for (int i = 0; i < obstacles; ++i) {
    const Eigen::Vector3d center = in_box(rng, -size_m / 2, size_m / 2);
    Eigen::Vector3d velocity = i % 2 == 0 ? Eigen::Vector3d::Zero().eval() : in_cube(rng, 1.5);
    const double radius = uniform(rng, 0.1, 0.4);
    mark_moving(&sogm, center, velocity, radius, i % 3 == 0);
  }
  return sogm;
}

// Distance from `p` to the nearest centre of a voxel occupied in `frame`, or `limit_m` when none is nearer.
inline double distance_to_occupied(const Sogm& sogm, int frame, const Eigen::Vector3d& p, double limit_m) {
  const GridGeometry& grid = sogm.geometry;
  const Eigen::Vector3i low = grid.voxel_of(p.array() - limit_m).cwiseMax(0);
  const Eigen::Vector3i high = grid.voxel_of(p.array() + limit_m).cwiseMin(grid.size - Eigen::Vector3i::Ones());
  double least = limit_m;
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        if (sogm.occupied(frame, {x, y, z})) least = std::min(least, (grid.center_of({x, y, z}) - p).norm());
      }
    }
  }
  return least;
}

}  // namespace swarm
