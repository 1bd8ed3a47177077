// Every shape is a core (disc column, circle, box, point) and what lies within `reach` of it; a vertical line meets it
// in at most two intervals of z, known in closed form, which become runs of bits. A voxel is marked when its centre is
// within. Shapes are thickened first, so that none slips through between the centres.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "lcmtypes/bus/portable_math.h"
#include "lcmtypes/bus/wide.h"
#include "map_daemon/obstacle.h"

namespace swarm {
namespace {

constexpr double kRounding_m = 1e-9;  // keeps exact contact inside

struct Core {
  Shape::Kind kind = Shape::Kind::kBox;            // never kVoxels: those are boxes
  Eigen::Vector2d half = Eigen::Vector2d::Zero();  // box: half length and width; column, ring: radius in x
  double half_height = 0.0;                        // column and box
  double thickness = 0.0;                          // radius of the solid around the core: sphere and ring
  double cos_yaw = 1.0, sin_yaw = 0.0;

  bool round() const { return kind == Shape::Kind::kColumn || kind == Shape::Kind::kSphere; }

  // Half extent of the core's bounding box.
  Eigen::Vector3d extent() const {
    const double c = std::abs(cos_yaw), s = std::abs(sin_yaw);
    switch (kind) {
      case Shape::Kind::kRing:
        return {s * half.x(), c * half.x(), half.x()};
      case Shape::Kind::kBox:
        return {c * half.x() + s * half.y(), s * half.x() + c * half.y(), half_height};
      default:
        return {half.x(), half.x(), half_height};
    }
  }
};

// The core at one place, or swept along a horizontal `travel` from there (round cores only), widened by `reach`.
struct Sweep {
  Eigen::Vector3d center;
  Eigen::Vector2d travel;
  double reach;

  bool operator==(const Sweep&) const = default;
};

// Columns of voxels that a sweep may meet, as many as are looked at together: wide registers hold several.
struct Cells {
  static constexpr std::size_t kMost = 256;
  static constexpr int kStride = 8;
  using Lengths = std::array<double, kMost>;
  using Numbers = std::array<std::int32_t, kMost>;

  // Adds [begin, end) of a row along y, as far as there is room, and returns where that ends. By strides, the last of
  // which writes what does not count: most rows take one, so that the processor foresees where they end.
  int add(int row, int begin, int end) {
    for (; begin < end && n + kStride <= kMost; begin += kStride) {
      for (int i = 0; i < kStride; ++i) {
        x[n + static_cast<std::size_t>(i)] = row;
        y[n + static_cast<std::size_t>(i)] = begin + i;
      }
      n += static_cast<std::size_t>(std::min(kStride, end - begin));
    }
    return std::min(begin, end);
  }

  std::size_t n = 0;
  Numbers x, y;       // in the window
  Numbers column;     // number in the window
  Lengths dx, dy;     // of their centres, from the sweep's [m]
  Lengths gap2;       // squared horizontal distance from the core's footprint [m^2]
  Lengths top, hole;  // occupied is what is so far above and below the sweep's centre [m]
  Numbers low_begin, low_end, high_begin, high_end;  // voxels of a word: below the hole, and above it
};

constexpr double kNowhere_m = -1e9;  // `top` where nothing is

SWARM_WIDE void find_offsets(const GridGeometry& grid, const Eigen::Vector3d& center, Cells* cells) {
  const std::int32_t origin_x = grid.origin.x(), origin_y = grid.origin.y(), row = grid.size.y();
  const double voxel_m = grid.resolution_m, center_x = center.x(), center_y = center.y();
  for (std::size_t i = 0; i < cells->n; ++i) {
    cells->dx[i] = (cells->x[i] + origin_x + 0.5) * voxel_m - center_x;
    cells->dy[i] = (cells->y[i] + origin_y + 0.5) * voxel_m - center_y;
    cells->column[i] = cells->x[i] * row + cells->y[i];
  }
}

// Of a disc swept along `travel`; `projection`: travel / |travel|^2, which projects onto [0, 1].
SWARM_WIDE void find_gaps_of_disc(double radius, const Eigen::Vector2d& travel, const Eigen::Vector2d& projection,
                                  Cells* cells) {
  const double travel_x = travel.x(), travel_y = travel.y(), along_x = projection.x(), along_y = projection.y();
  for (std::size_t i = 0; i < cells->n; ++i) {
    const double dx = cells->dx[i], dy = cells->dy[i];
    const double s = std::min(std::max(along_x * dx + along_y * dy, 0.0), 1.0);
    const double ex = dx - s * travel_x, ey = dy - s * travel_y, r2 = ex * ex + ey * ey;
    const double gap = std::sqrt(r2) - radius;
    cells->gap2[i] = r2 <= radius * radius ? 0.0 : gap * gap;
  }
}

SWARM_WIDE void find_gaps_of_box(const Core& core, Cells* cells) {
  const double cos_yaw = core.cos_yaw, sin_yaw = core.sin_yaw, half_x = core.half.x(), half_y = core.half.y();
  for (std::size_t i = 0; i < cells->n; ++i) {
    const double dx = cells->dx[i], dy = cells->dy[i];
    const double a = std::max(std::abs(cos_yaw * dx + sin_yaw * dy) - half_x, 0.0);
    const double b = std::max(std::abs(cos_yaw * dy - sin_yaw * dx) - half_y, 0.0);
    cells->gap2[i] = a * a + b * b;
  }
}

SWARM_WIDE void find_tops(double half_height, double reach, Cells* cells) {
  for (std::size_t i = 0; i < cells->n; ++i) {
    const double rest = reach * reach - cells->gap2[i];
    cells->top[i] = rest < 0.0 ? kNowhere_m : half_height + std::sqrt(std::max(rest, 0.0));
    cells->hole[i] = 0.0;
  }
}

// Of a torus around a circle in the vertical plane across `along`: R - q <= hypot(lateral, z) <= R + q.
SWARM_WIDE void find_tops_of_ring(const Core& core, double reach, Cells* cells) {
  const double cos_yaw = core.cos_yaw, sin_yaw = core.sin_yaw, radius = core.half.x();
  for (std::size_t i = 0; i < cells->n; ++i) {
    const double dx = cells->dx[i], dy = cells->dy[i];
    const double along = cos_yaw * dx + sin_yaw * dy, lateral = cos_yaw * dy - sin_yaw * dx;
    const double rest = reach * reach - along * along, q = std::sqrt(std::max(rest, 0.0));
    const double outer = radius + q, inner = std::max(radius - q, 0.0);
    const double outer2 = outer * outer - lateral * lateral, inner2 = inner * inner - lateral * lateral;
    cells->top[i] = std::min(rest, outer2) < 0.0 ? kNowhere_m : std::sqrt(std::max(outer2, 0.0));
    cells->hole[i] = std::sqrt(std::max(inner2, 0.0));
  }
}

// Of `size` voxels of each column, at most 64; `middle`: the sweep's centre in voxels above the centre of their first.
SWARM_WIDE void find_voxels(double per_m, double middle, std::int32_t size, Cells* cells) {
  const double most = size;
  const auto begin_at = [=](double voxel) {
    return size - static_cast<std::int32_t>(most - std::min(std::max(voxel, 0.0), most));
  };
  const auto end_at = [=](double voxel) {
    return static_cast<std::int32_t>(std::min(std::max(voxel + 1.0, 0.0), most));
  };
  for (std::size_t i = 0; i < cells->n; ++i) {
    const double top = cells->top[i] * per_m, hole = cells->hole[i] * per_m;
    cells->low_begin[i] = begin_at(middle - top);
    cells->low_end[i] = end_at(middle - hole);
    cells->high_begin[i] = begin_at(middle + hole);
    cells->high_end[i] = end_at(middle + top);
  }
}

// The bits of a word from one on; none from the 64th on.
constexpr auto kFrom = [] {
  std::array<std::uint64_t, 65> from{};
  for (std::size_t bit = 0; bit < 64; ++bit) from[bit] = ~std::uint64_t{0} << bit;
  return from;
}();

std::uint64_t bits_of(const Cells& cells, std::size_t i) {
  const auto from = [i](const Cells::Numbers& bit) { return kFrom[static_cast<std::size_t>(bit[i])]; };
  return (from(cells.low_begin) & ~from(cells.low_end)) | (from(cells.high_begin) & ~from(cells.high_end));
}

// Paints a core where it is swept, into several frames at once.
class Painter {
 public:
  Painter(const Core& core, Sogm* sogm)
      : core_(core), sogm_(*sogm), cot_yaw_(core.cos_yaw / core.sin_yaw), inverse_sin_(1.0 / std::abs(core.sin_yaw)) {}

  void paint(const Sweep& sweep, int first_frame, int last_frame) {
    const GridGeometry& g = sogm_.geometry;
    const double per_m = 1.0 / g.resolution_m;
    const Eigen::Vector2d reach = core_.extent().head<2>().array() + sweep.reach;
    const Eigen::Vector2d low = sweep.center.head<2>() + sweep.travel.cwiseMin(0.0) - reach;
    const Eigen::Vector2d high = sweep.center.head<2>() + sweep.travel.cwiseMax(0.0) + reach;
    const Eigen::Array2d origin = g.origin.head<2>().cast<double>(), size = g.size.head<2>().cast<double>();
    const Eigen::Array2i first = (low.array() * per_m - 0.5 - origin).ceil().max(0.0).min(size).cast<int>();
    const Eigen::Array2i last = (high.array() * per_m - 0.5 - origin).floor().max(-1.0).min(size - 1.0).cast<int>();
    for (int x = first.x(); x <= last.x(); ++x) {
      int begin = first.y(), end = last.y();
      if (core_.kind == Shape::Kind::kRing) clip_to_ring(sweep, x, &begin, &end);
      if (begin <= end) touch(x, begin, end);
      while ((begin = cells_.add(x, begin, end + 1)) <= end) paint_cells(sweep, first_frame, last_frame);
    }
    paint_cells(sweep, first_frame, last_frame);
  }

 private:
  static constexpr std::size_t kRows = 128;  // that are remembered
  static constexpr int kAhead = 4;           // columns touched beyond a sweep
  struct Row {
    int x = -1, begin = 0, end = 0;  // touched columns
  };

  // Sweeps follow each other closely: most lie within what was touched for those before.
  void touch(int x, int begin, int end) {
    Row& row = rows_[static_cast<std::size_t>(x) % rows_.size()];
    if (row.x == x && row.begin <= begin && row.end >= end) return;
    row = {x, std::max(begin - kAhead, 0), std::min(end + kAhead, sogm_.geometry.size.y() - 1)};
    sogm_.columns(0, {{x, row.begin}, {x, row.end}});
  }

  // A ring is thin along its axis: of a row, only columns with |cos dx + sin dy| <= reach can meet it.
  void clip_to_ring(const Sweep& sweep, int x, int* begin, int* end) const {
    if (std::abs(core_.sin_yaw) < 1e-3) return;
    const GridGeometry& g = sogm_.geometry;
    const double dx = (x + g.origin.x() + 0.5) * g.resolution_m - sweep.center.x();
    const double per_m = 1.0 / g.resolution_m, zero = sweep.center.y() * per_m - 0.5 - g.origin.y();
    const double middle = zero - per_m * cot_yaw_ * dx, half = per_m * sweep.reach * inverse_sin_;
    *begin = std::max(*begin, static_cast<int>(middle - half));
    *end = std::min(*end, static_cast<int>(middle + half) + 1);
  }

  void paint_cells(const Sweep& sweep, int first_frame, int last_frame) {
    const GridGeometry& g = sogm_.geometry;
    find_offsets(g, sweep.center, &cells_);
    find_heights(sweep);
    const double per_m = 1.0 / g.resolution_m, middle = sweep.center.z() * per_m - 0.5 - g.origin.z();
    const Eigen::Index words = g.words_per_column(), frame_words = g.words_per_frame();
    for (int word = 0; word < words; ++word) {
      find_voxels(per_m, middle - 64 * word, std::min(g.size.z() - 64 * word, 64), &cells_);
      std::uint64_t* const begin = sogm_.column(first_frame, 0, 0) + word;
      for (std::size_t i = 0; i < cells_.n; ++i) {
        const std::uint64_t bits = bits_of(cells_, i);
        std::uint64_t* to = begin + cells_.column[i] * words;
        for (int frame = first_frame; frame <= last_frame; ++frame, to += frame_words) *to |= bits;
      }
    }
    cells_.n = 0;
  }

  void find_heights(const Sweep& sweep) {
    if (core_.kind == Shape::Kind::kRing) return find_tops_of_ring(core_, sweep.reach, &cells_);
    if (core_.round()) {
      const double length2 = sweep.travel.squaredNorm();
      const Eigen::Vector2d projection = length2 > 0.0 ? Eigen::Vector2d(sweep.travel / length2) : sweep.travel;
      find_gaps_of_disc(core_.half.x(), sweep.travel, projection, &cells_);
    } else {
      find_gaps_of_box(core_, &cells_);
    }
    find_tops(core_.half_height, sweep.reach, &cells_);
  }

  const Core& core_;
  Sogm& sogm_;
  double cot_yaw_, inverse_sin_;
  std::array<Row, kRows> rows_;
  Cells cells_;
};

// Never of voxels: those are boxes.
Core core_of(const Shape& any, double resolution_m, double margin_m) {
  const Shape shape = thickened(any, resolution_m, margin_m);
  Core core;
  core.kind = shape.kind;
  const auto [sin_yaw, cos_yaw] = sin_cos(shape.yaw_rad);
  core.cos_yaw = cos_yaw;
  core.sin_yaw = sin_yaw;
  switch (shape.kind) {
    case Shape::Kind::kColumn:
      core.half.x() = shape.size.x() / 2;
      core.half_height = shape.size.y() / 2;
      break;
    case Shape::Kind::kRing:
      core.half.x() = shape.size.x();
      core.thickness = shape.size.y() / 2;
      break;
    case Shape::Kind::kSphere:
      core.thickness = shape.size.x() / 2;
      break;
    default:
      core.half = shape.size.head<2>() / 2;
      core.half_height = shape.size.z() / 2;
      break;
  }
  return core;
}

// Whether the core may touch the window there at all.
bool meets_window(const Core& core, const Sweep& sweep, const GridGeometry& g) {
  const Eigen::Array3d pad = core.extent().array() + sweep.reach;
  const Eigen::Array3d low = g.origin.cast<double>().array() * g.resolution_m;
  const Eigen::Array3d high = (g.origin + g.size).cast<double>().array() * g.resolution_m;
  const Eigen::Vector3d to = sweep.center + Eigen::Vector3d(sweep.travel.x(), sweep.travel.y(), 0.0);
  return (sweep.center.cwiseMax(to).array() + pad >= low).all() &&
         (sweep.center.cwiseMin(to).array() - pad <= high).all();
}

// `offset`: of the core from the obstacle's centre.
void paint_core(const Core& core, const Eigen::Vector3d& offset, const Obstacle& obstacle, double margin_m,
                double growth_mps, Sogm* sogm) {
  const double frame_s = to_seconds(sogm->frame_duration);
  const double lead_s = to_seconds(sogm->start_utime - obstacle.utime);
  const Eigen::Vector3d motion = frame_s * obstacle.velocity;
  const bool straight = core.round() && motion.z() == 0.0;
  const int steps = straight ? 0 : static_cast<int>(std::ceil(motion.norm() / (0.5 * sogm->geometry.resolution_m)));
  const double step_m = steps > 0 ? motion.norm() / steps : 0.0;
  Painter painter(core, sogm);
  // The end of a frame is the beginning of the next, and what stands does so in all of them: painted once.
  std::optional<Sweep> sweep;
  int first_frame = 0;
  const auto paint = [&](int last_frame) {
    if (sweep && meets_window(core, *sweep, sogm->geometry)) painter.paint(*sweep, first_frame, last_frame);
  };
  for (int frame = 0; frame < sogm->num_frames; ++frame) {
    // A point within r of a core on its way is within sqrt(r^2 + step^2 / 4) of it at one end of the step, whatever the
    // core's form: so no sub-step leaves a gap, at the price of less than 7 % of r for r >= 0.07 m at 0.1 m voxels.
    const double end_s = (frame + 1) * frame_s, unseen_s = std::clamp(lead_s + end_s, 0.0, kUnseen_s);
    const double r = core.thickness + margin_m + growth_mps * end_s +
                     obstacle.acceleration_mps2 * unseen_s * unseen_s / 2 + kRounding_m;
    const double reach = std::sqrt(r * r + step_m * step_m / 4);
    for (int k = 0; k <= steps; ++k) {
      const double at_s = lead_s + (frame + (k > 0 ? static_cast<double>(k) / steps : 0.0)) * frame_s;
      const Sweep next{obstacle.position + offset + at_s * obstacle.velocity,
                       straight ? Eigen::Vector2d(motion.head<2>()) : Eigen::Vector2d::Zero(), reach};
      if (sweep == next) continue;
      paint(k == 0 ? frame - 1 : frame);
      sweep = next;
      first_frame = frame;
    }
  }
  paint(sogm->num_frames - 1);
}

}  // namespace

Shape thickened(const Shape& shape, double resolution_m, double margin_m) {
  using std::numbers::sqrt2, std::numbers::sqrt3;
  // What a voxel measures in some direction, less the margin there: round solids have it everywhere, others at their
  // edges and corners only in part.
  const auto across = [&](double voxels, double part) { return voxels * resolution_m - 2 * part * margin_m; };
  Shape thick = shape;
  switch (shape.kind) {
    case Shape::Kind::kColumn: {
      const double wide_m = across(sqrt2, 1 / sqrt2), high_m = std::max(across(1, 1 / sqrt2), 0.0);
      if (shape.size.x() < wide_m) thick.size << wide_m, shape.size.y() + high_m, 0.0;
      thick.size.y() = std::max(thick.size.y(), high_m);
      break;
    }
    case Shape::Kind::kRing:
      thick.size.y() = std::max(shape.size.y(), across(sqrt3, 1));
      break;
    case Shape::Kind::kBox: {
      const auto [sin_yaw, cos_yaw] = sin_cos(shape.yaw_rad);
      const double wide_m = across(std::abs(sin_yaw) + std::abs(cos_yaw), 1 / sqrt3);
      const Eigen::Array3d least = Eigen::Array3d(wide_m, wide_m, across(1, 1 / sqrt3)).max(0.0);
      const auto size = shape.size.array();
      if ((size < least).any()) thick.size = (size < least && size < size.maxCoeff()).select(least, size + least);
      break;
    }
    case Shape::Kind::kSphere:
      thick.size.x() = std::max(shape.size.x(), across(sqrt3, 1));
      break;
    case Shape::Kind::kVoxels:
      break;
  }
  return thick;
}

void rasterize(const Obstacle& obstacle, double margin_m, double growth_mps, Sogm* sogm) {
  const Shape& shape = obstacle.shape;
  if (shape.kind != Shape::Kind::kVoxels) {
    paint_core(core_of(shape, sogm->geometry.resolution_m, margin_m), Eigen::Vector3d::Zero(), obstacle, margin_m,
               growth_mps, sogm);
    return;
  }
  const double edge_m = shape.size.x(), thick_m = std::max(edge_m, sogm->geometry.resolution_m);
  for (std::size_t i = 0; i < shape.voxels.size();) {
    const Eigen::Vector3i first = shape.voxels[i];
    int run = 1;  // voxels listed upwards one after the other are one box
    while (++i < shape.voxels.size() && shape.voxels[i] == first + Eigen::Vector3i(0, 0, run)) ++run;
    const Shape box{.kind = Shape::Kind::kBox, .size = {thick_m, thick_m, thick_m + (run - 1) * edge_m}};
    const Eigen::Vector3d offset = edge_m * (first.cast<double>() + Eigen::Vector3d(0.0, 0.0, (run - 1) / 2.0));
    paint_core(core_of(box, sogm->geometry.resolution_m, margin_m), offset, obstacle, margin_m, growth_mps, sogm);
  }
}

}  // namespace swarm
