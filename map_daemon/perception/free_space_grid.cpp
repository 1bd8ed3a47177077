#include "map_daemon/perception/free_space_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace swarm {
namespace {

constexpr std::uint64_t kAll = ~std::uint64_t{0};
constexpr int kFreeScans = 10;  // after so many, a voxel was free
constexpr int kCounted = 15;
constexpr Duration kLasting = 2s;  // what is occupied throughout two such stretches stays there

// Fixed point, 16 bits after the point.
constexpr double kOne = 65536.0;
constexpr int kShift = 16;
// A ray that comes no further into a voxel misses what stands there: a fifth; of sparse ones two from above and below.
constexpr std::uint32_t kRim = 13107, kSparseRim = 26214;

// Of the part of a ray that is within [0, size] along each axis: begins and ends at so much of its length; none if it
// begins after its end.
struct Inside {
  double begin, end;
};
Inside clipped(const Eigen::Vector3d& from, const Eigen::Vector3d& way, const Eigen::Vector3d& size) {
  Inside inside{0.0, 1.0};
  const auto is_inside = [&size](const Eigen::Vector3d& place) {
    return (place.array() >= 0.0).all() && (place.array() < size.array()).all();
  };
  if (is_inside(from) && is_inside(from + way)) return inside;
  for (int axis = 0; axis < 3; ++axis) {
    if (way[axis] == 0.0) {
      if (from[axis] < 0.0 || from[axis] >= size[axis]) return {1.0, 0.0};
      continue;
    }
    const double a = -from[axis] / way[axis], b = (size[axis] - from[axis]) / way[axis];
    inside = {std::max(inside.begin, std::min(a, b)), std::min(inside.end, std::max(a, b))};
  }
  return inside;
}

}  // namespace

FreeSpaceGrid::FreeSpaceGrid(double resolution_m, Duration memory)
    : memory_(memory),
      geometry_{.resolution_m = resolution_m, .size = {kEdge, kEdge, kHeight}},
      columns_(kColumns, unknown()),
      occupied_(kColumns),
      seen_(kColumns),
      free_(kColumns),
      passed_(kColumns),
      surfaces_(kColumns),
      moving_(kColumns),
      beside_(kColumns) {
  surface_columns_.reserve(kColumns);
}

FreeSpaceGrid::Column FreeSpaceGrid::unknown() {
  Column column{};
  for (std::size_t i = 0; i < 4; ++i)
    column.free_scans[i] = ((kCounted - kFreeScans) >> i & 1) != 0 ? kAll : std::uint64_t{0};
  return column;
}

void FreeSpaceGrid::forget_column(std::size_t column) {
  columns_[column] = unknown();
  occupied_[column] = seen_[column] = 0;
}

std::uint64_t FreeSpaceGrid::turned(std::uint64_t word) const {
  return std::rotr(word, geometry_.origin.z() & (kHeight - 1));
}

void FreeSpaceGrid::move_to(const Eigen::Vector3d& place) {
  const Eigen::Vector3i origin = lattice_voxel(place, geometry_.resolution_m) - geometry_.size / 2;
  const Eigen::Vector3i by = origin - geometry_.origin;
  const bool all = !is_placed_ || (by.cwiseAbs().array() >= geometry_.size.array()).any();
  is_placed_ = true;
  geometry_.origin = origin;
  if (all) {
    for (std::size_t i = 0; i < kColumns; ++i) forget_column(i);
    return;
  }
  // What left the window on one side lies where what comes into it on the other will.
  for (int axis = 0; axis < 2; ++axis) {
    const int first = by[axis] > 0 ? kEdge - by[axis] : 0, count = std::abs(by[axis]);
    for (int i = first; i < first + count; ++i)
      for (int j = 0; j < kEdge; ++j)
        forget_column(static_cast<std::size_t>(axis == 0 ? column_of(i, j) : column_of(j, i)));
  }
  if (by.z() == 0) return;
  const int count = std::abs(by.z()), first = by.z() > 0 ? kHeight - count : 0;
  const std::uint64_t entering = std::rotl((kAll >> (kHeight - count)) << first, geometry_.origin.z() & (kHeight - 1));
  const Column blank = unknown();
  for (std::size_t i = 0; i < kColumns; ++i) {
    Column& column = columns_[i];
    const auto clear = [entering](std::uint64_t& word, std::uint64_t to) {
      word = (word & ~entering) | (to & entering);
    };
    for (std::uint64_t& word : column.certainty) clear(word, 0);
    for (std::size_t bit = 0; bit < 4; ++bit) clear(column.free_scans[bit], blank.free_scans[bit]);
    for (std::uint64_t& word : column.seen_lately) clear(word, 0);
    clear(column.occupied, 0);
    clear(column.passed, 0);
    clear(column.ever_free, 0);
    clear(column.lasting, 0);
    clear(column.lasting_before, 0);
    clear(occupied_[i], 0);
    clear(seen_[i], 0);
  }
}

// In steps of half a voxel: a corner that the ray cuts may be missed, which errs to the safe side.
FreeSpaceGrid::Walk FreeSpaceGrid::walk_along(const RangeScan::Ray& ray) const {
  const Eigen::Vector3d start = ray.from / geometry_.resolution_m - geometry_.origin.cast<double>();
  const Eigen::Vector3d way = (ray.to - ray.from) / geometry_.resolution_m;
  const Inside inside = clipped(start, way, geometry_.size.cast<double>());
  if (inside.begin >= inside.end) return {};
  const double length = (inside.end - inside.begin) * way.norm();
  const int steps = std::max(static_cast<int>(2.0 * length), 1);
  const Eigen::Vector3d step = (inside.end - inside.begin) / steps * way;
  // From the middle of the first step on.
  const Eigen::Vector3d first = start + inside.begin * way + 0.5 * step +
                                Eigen::Vector3d(geometry_.origin.x() & (kEdge - 1), geometry_.origin.y() & (kEdge - 1),
                                                geometry_.origin.z() & (kHeight - 1));
  const auto fixed = [](double value) { return static_cast<std::uint32_t>(static_cast<std::int32_t>(value * kOne)); };
  return {.x = fixed(first.x()),
          .y = fixed(first.y()),
          .z = fixed(first.z()),
          .dx = fixed(step.x()),
          .dy = fixed(step.y()),
          .dz = fixed(step.z()),
          .steps = steps};
}

void FreeSpaceGrid::see_free(std::span<const RangeScan::Ray> rays, bool are_sparse) {
  const std::uint32_t flat_rim = are_sparse ? kSparseRim : kRim;
  // Where several rays begin is found at once: each takes long, but none waits for another.
  constexpr std::size_t kAtOnce = 64;
  std::array<Walk, kAtOnce> walks;
  std::uint64_t *const free = free_.data(), *const passed = passed_.data();
  for (; !rays.empty(); rays = rays.subspan(std::min(kAtOnce, rays.size()))) {
    const std::size_t number = std::min(kAtOnce, rays.size());
    for (std::size_t i = 0; i < number; ++i) walks[i] = walk_along(rays[i]);
    for (auto [x, y, z, dx, dy, dz, steps] : std::span(walks).first(number)) {
      for (; steps > 0; --steps) {
        const std::uint32_t column = (x >> kShift & (kEdge - 1)) * kEdge + (y >> kShift & (kEdge - 1));
        const std::uint32_t height = z >> kShift & (kHeight - 1);
        const std::uint32_t borders =
            ((x - kRim) ^ (x + kRim)) | ((y - kRim) ^ (y + kRim)) | ((z - flat_rim) ^ (z + flat_rim));
        free[column] |= std::uint64_t{1} << height;
        passed[column] |= std::uint64_t{borders >> kShift == 0} << height;
        x += dx, y += dy, z += dz;
      }
    }
  }
}

// visit(column, voxels whose middles are so near).
template <class Visit>
void FreeSpaceGrid::for_each_column_of_ball(const Eigen::Vector3d& place, double radius_m, const Visit& visit) const {
  const Eigen::Vector3d middle = place / geometry_.resolution_m - geometry_.origin.cast<double>() -
                                 Eigen::Vector3d::Constant(0.5);  // in voxels above the first
  const double radius = radius_m / geometry_.resolution_m;
  const Eigen::Vector2i low = (middle.head<2>().array() - radius).ceil().max(0.0).matrix().cast<int>();
  const Eigen::Vector2i high = (middle.head<2>().array() + radius).floor().min(kEdge - 1.0).matrix().cast<int>();
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      const double square = radius * radius - (Eigen::Vector2d(x, y) - middle.head<2>()).squaredNorm();
      if (square < 0.0) continue;
      std::uint64_t run = 0;
      set_run(middle.z() - std::sqrt(square), middle.z() + std::sqrt(square), kHeight, &run);
      visit(static_cast<std::size_t>(column_of(x, y)), std::rotl(run, geometry_.origin.z() & (kHeight - 1)));
    }
  }
}

std::uint64_t FreeSpaceGrid::layer(const Eigen::Vector3d& place, double half_height_m) const {
  const double middle = place.z() / geometry_.resolution_m - geometry_.origin.z() - 0.5;
  const double half = half_height_m / geometry_.resolution_m;
  std::uint64_t run = 0;
  set_run(middle - half, middle + half, kHeight, &run);
  return std::rotl(run, geometry_.origin.z() & (kHeight - 1));
}

void FreeSpaceGrid::see_free_around(const Eigen::Vector3d& place, double radius_m, double half_height_m) {
  const std::uint64_t within = layer(place, half_height_m);
  for_each_column_of_ball(place, radius_m, [&](std::size_t column, std::uint64_t run) {
    free_[column] |= run & within;
    passed_[column] |= run & within;
  });
}

void FreeSpaceGrid::see_free_along(const Eigen::Vector3d& place, double radius_m, double half_height_m) {
  const std::uint64_t passed = layer(place, 0.5 * geometry_.resolution_m), within = layer(place, half_height_m);
  for_each_column_of_ball(place, radius_m, [&](std::size_t column, std::uint64_t) {
    if ((free_[column] & passed) != 0) free_[column] |= within;
  });
}

void FreeSpaceGrid::keep_around(const Eigen::Vector3d& place, double radius_m) {
  for_each_column_of_ball(place, radius_m, [this](std::size_t column, std::uint64_t run) {
    columns_[column].seen_lately[0] |= columns_[column].seen() & run;
  });
}

void FreeSpaceGrid::see_surface_in(const Eigen::Vector3i& voxel) {
  if (!geometry_.contains(voxel)) return;
  const int column = column_of(voxel.x(), voxel.y());
  std::uint64_t& word = surfaces_[static_cast<std::size_t>(column)];
  if (word == 0) surface_columns_.push_back(column);
  word |= std::uint64_t{1} << ((voxel.z() + geometry_.origin.z()) & (kHeight - 1));
}

void FreeSpaceGrid::mark_moving_in(const Eigen::Vector3i& voxel) {
  if (!geometry_.contains(voxel)) return;
  moving_[static_cast<std::size_t>(column_of(voxel.x(), voxel.y()))] |=
      std::uint64_t{1} << ((voxel.z() + geometry_.origin.z()) & (kHeight - 1));
}

void FreeSpaceGrid::learn(const Sight& seen, Doubt doubt, Column* column) {
  const auto [free, passed, surfaces, moving, beside] = seen;
  // Occupied: 3 once, 7 once more, one less each time that rays pass it, also beside surfaces, or what errs once would
  // make walls thicker for good.
  const std::uint64_t standing = surfaces & ~moving, some = column->likely();
  auto& certainty = column->certainty;
  std::uint64_t borrow = passed & ~surfaces & some;
  for (std::uint64_t& bit : certainty) {
    bit ^= borrow;
    borrow &= bit;
  }
  certainty[0] |= standing;
  certainty[1] |= standing;
  certainty[2] |= standing & some;
  column->passed |= passed;
  const std::uint64_t doubted = doubt == Doubt::kNowhere ? std::uint64_t{0}
                                : doubt == Doubt::kAlone ? column->passed | ~beside
                                                         : kAll;
  column->occupied = (column->occupied | (standing & (some | ~doubted))) & column->likely();
  column->passed &= ~standing;
  // Free: a count that stops at its highest, and starts again below it.
  auto& count = column->free_scans;
  std::uint64_t carry = free & ~(count[0] & count[1] & count[2] & count[3]);
  for (std::size_t i = 0; i < count.size(); ++i) {
    const std::uint64_t both = count[i] & carry;
    count[i] ^= carry;
    carry = both;
    const std::uint64_t again = ((kCounted - kFreeScans) >> i & 1) != 0 ? surfaces : std::uint64_t{0};
    count[i] = (count[i] & ~surfaces) | again;
  }
  column->ever_free |= count[0] & count[1] & count[2] & count[3];
  column->lasting &= column->likely();
  column->seen_lately[0] |= free | surfaces;
}

void FreeSpaceGrid::finish(Utime utime, Doubt doubt) {
  forget_old(utime);
  // Surfaces err by a part of a voxel: what is beside them is not free for certain.
  for (const int column : surface_columns_) {
    const std::uint64_t word = surfaces_[static_cast<std::size_t>(column)];
    const std::uint64_t above_and_below = std::rotl(word, 1) | std::rotr(word, 1), all = word | above_and_below;
    const int x = column / kEdge, y = column % kEdge;
    for (int i = -1; i <= 1; ++i) {
      for (int j = -1; j <= 1; ++j) {
        const auto near = static_cast<std::size_t>(((x + i) & (kEdge - 1)) * kEdge + ((y + j) & (kEdge - 1)));
        free_[near] &= ~all;
        beside_[near] |= i == 0 && j == 0 ? above_and_below : all;
      }
    }
  }
  for (std::size_t i = 0; i < kColumns; ++i) {
    const Sight seen{free_[i], passed_[i], surfaces_[i], moving_[i], std::exchange(beside_[i], 0)};
    if ((seen.free | seen.passed | seen.surfaces) == 0) continue;
    learn(seen, doubt, &columns_[i]);
    occupied_[i] = columns_[i].occupied;
    seen_[i] = columns_[i].seen();
    free_[i] = passed_[i] = surfaces_[i] = moving_[i] = 0;
  }
  surface_columns_.clear();
}

void FreeSpaceGrid::recall(int column, std::uint64_t standing) {
  Column& known = columns_[static_cast<std::size_t>(column)];
  const std::uint64_t word =
      std::rotl(standing, geometry_.origin.z() & (kHeight - 1)) & ~(known.seen() | known.likely());
  known.certainty[0] |= word;
  known.occupied |= word;
  occupied_[static_cast<std::size_t>(column)] |= word;
  known.lasting |= word;
  known.lasting_before |= word;
}

void FreeSpaceGrid::forget_old(Utime utime) {
  const auto is_over = [utime](Utime since, Duration stretch) { return utime < since || utime >= since + stretch; };
  if (is_over(seen_since_, memory_ / 2)) {
    const bool all = utime >= seen_since_ + 3 * (memory_ / 2);  // without a scan all the time
    seen_since_ = utime;
    for (std::size_t i = 0; i < kColumns; ++i) {
      auto& lately = columns_[i].seen_lately;
      if (all) lately = {};
      std::rotate(lately.begin(), lately.end() - 1, lately.end());
      lately[0] = 0;
      seen_[i] = columns_[i].seen();
    }
  }
  if (is_over(lasting_since_, kLasting)) {
    lasting_since_ = utime;
    for (Column& column : columns_) {
      column.ever_free &= ~(column.lasting & column.lasting_before);
      column.lasting_before = column.lasting;
      column.lasting = column.likely();
    }
  }
}

}  // namespace swarm
