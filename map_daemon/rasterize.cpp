// Every shape is a core (disc column, circle, box, point) and what lies within `reach` of it; a vertical line meets it
// in at most two intervals of z, known in closed form, which become runs of bits. A voxel is marked when its centre is
// within. Shapes are thickened first, so that none slips through between the centres.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "lcmtypes/bus/portable_math.h"
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
};

class Painter {
 public:
  Painter(const Core& core, const Sweep& sweep, int frame, Sogm* sogm, std::vector<std::uint64_t>* full)
      : core_(core),
        sweep_(sweep),
        frame_(frame),
        sogm_(*sogm),
        inverse_resolution_(1.0 / sogm->geometry.resolution_m),
        words_(sogm->geometry.words_per_column()),
        full_(*full) {
    const double length2 = sweep.travel.squaredNorm();
    inverse_travel_ = length2 > 0.0 ? Eigen::Vector2d(sweep.travel / length2) : Eigen::Vector2d::Zero();
    z_offset_ = sweep.center.z() * inverse_resolution_ - 0.5 - sogm->geometry.origin.z();
    const double top = core.half_height + sweep.reach;
    full_.assign(static_cast<std::size_t>(words_), 0);
    run(-top, top, full_.data());
  }

  void paint() {
    const Eigen::Vector2d reach = core_.extent().head<2>().array() + sweep_.reach;
    const Eigen::Vector2d low = sweep_.center.head<2>() + sweep_.travel.cwiseMin(0.0) - reach;
    const Eigen::Vector2d high = sweep_.center.head<2>() + sweep_.travel.cwiseMax(0.0) + reach;
    const GridGeometry& g = sogm_.geometry;
    const Eigen::Array2d origin = g.origin.head<2>().cast<double>(), size = g.size.head<2>().cast<double>();
    const Eigen::Array2i first =
        (low.array() * inverse_resolution_ - 0.5 - origin).ceil().max(0.0).min(size).cast<int>();
    const Eigen::Array2i last =
        (high.array() * inverse_resolution_ - 0.5 - origin).floor().max(-1.0).min(size - 1.0).cast<int>();
    for (int x = first.x(); x <= last.x(); ++x) {
      const double dx = (x + g.origin.x() + 0.5) * g.resolution_m - sweep_.center.x();
      int begin = first.y(), end = last.y();
      if (core_.kind == Shape::Kind::kRing) clip_to_ring(dx, &begin, &end);
      for (int y = begin; y <= end; ++y) {
        const double dy = (y + g.origin.y() + 0.5) * g.resolution_m - sweep_.center.y();
        std::uint64_t* column = sogm_.column(frame_, x, y);
        if (core_.kind == Shape::Kind::kRing) {
          paint_ring(dx, dy, column);
        } else {
          paint_solid(core_.round() ? round_gap(dx, dy) : box_gap(dx, dy), column);
        }
      }
    }
  }

 private:
  // A ring is thin along its axis: of row `dx`, only columns with |cos dx + sin dy| <= reach can meet it.
  void clip_to_ring(double dx, int* begin, int* end) const {
    if (std::abs(core_.sin_yaw) < 1e-3) return;
    const double middle = -core_.cos_yaw * dx / core_.sin_yaw, half = sweep_.reach / std::abs(core_.sin_yaw);
    const GridGeometry& g = sogm_.geometry;
    const double zero = sweep_.center.y() * inverse_resolution_ - 0.5 - g.origin.y();
    const double low = (middle - half) * inverse_resolution_ + zero,
                 high = (middle + half) * inverse_resolution_ + zero;
    *begin = static_cast<int>(std::clamp<double>(std::floor(low), *begin, *end + 1.0));
    *end = static_cast<int>(std::clamp<double>(std::ceil(high), *begin - 1.0, *end));
  }
  // Squared horizontal distance from the swept footprint.
  double round_gap(double dx, double dy) const {
    const double s = std::clamp(inverse_travel_.x() * dx + inverse_travel_.y() * dy, 0.0, 1.0);
    const double ex = dx - s * sweep_.travel.x(), ey = dy - s * sweep_.travel.y(), r2 = ex * ex + ey * ey;
    const double radius = core_.half.x();
    if (radius == 0.0) return r2;
    if (r2 <= radius * radius) return 0.0;
    const double gap = std::sqrt(r2) - radius;
    return gap * gap;
  }
  double box_gap(double dx, double dy) const {
    const double along = std::abs(core_.cos_yaw * dx + core_.sin_yaw * dy) - core_.half.x();
    const double across = std::abs(core_.cos_yaw * dy - core_.sin_yaw * dx) - core_.half.y();
    const double a = std::max(along, 0.0), b = std::max(across, 0.0);
    return a * a + b * b;
  }

  void paint_solid(double gap2, std::uint64_t* column) const {
    const double rest = sweep_.reach * sweep_.reach - gap2;
    if (rest < 0.0) return;
    if (gap2 == 0.0) {
      for (int w = 0; w < words_; ++w) column[w] |= full_[static_cast<std::size_t>(w)];
      return;
    }
    const double top = core_.half_height + std::sqrt(rest);
    run(-top, top, column);
  }

  // Torus around the circle of radius R in the vertical plane across `along`: R - q <= hypot(lateral, z) <= R + q.
  void paint_ring(double dx, double dy, std::uint64_t* column) const {
    const double along = core_.cos_yaw * dx + core_.sin_yaw * dy;
    const double rest = sweep_.reach * sweep_.reach - along * along;
    if (rest < 0.0) return;
    const double lateral = core_.cos_yaw * dy - core_.sin_yaw * dx;
    const double q = std::sqrt(rest), outer = core_.half.x() + q, inner = std::max(core_.half.x() - q, 0.0);
    const double outer2 = outer * outer - lateral * lateral, inner2 = inner * inner - lateral * lateral;
    if (outer2 < 0.0) return;
    const double top = std::sqrt(outer2), hole = inner2 > 0.0 ? std::sqrt(inner2) : 0.0;
    run(-top, -hole, column);
    run(hole, top, column);
  }

  void run(double low, double high, std::uint64_t* column) const {  // about the centre [m]
    set_run(low * inverse_resolution_ + z_offset_, high * inverse_resolution_ + z_offset_, sogm_.geometry.size.z(),
            column);
  }

  const Core& core_;
  const Sweep& sweep_;
  const int frame_;
  Sogm& sogm_;
  const double inverse_resolution_;
  Eigen::Vector2d inverse_travel_;    // travel / |travel|^2: projects onto [0, 1]
  double z_offset_;                   // the centre's height in voxels above the window's first centre
  int words_;                         // per column
  std::vector<std::uint64_t>& full_;  // a column inside the footprint
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

// Whether the core, moving from `from` by `motion` and widened by `reach`, may touch the window at all.
bool meets_window(const Core& core, const Eigen::Vector3d& from, const Eigen::Vector3d& motion, double reach,
                  const GridGeometry& g) {
  const Eigen::Array3d pad = core.extent().array() + reach;
  const Eigen::Array3d low = g.origin.cast<double>().array() * g.resolution_m;
  const Eigen::Array3d high = (g.origin + g.size).cast<double>().array() * g.resolution_m;
  const Eigen::Vector3d to = from + motion;
  return (from.cwiseMax(to).array() + pad >= low).all() && (from.cwiseMin(to).array() - pad <= high).all();
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
  std::vector<std::uint64_t> full;
  for (int frame = 0; frame < sogm->num_frames; ++frame) {
    const Eigen::Vector3d from = obstacle.position + offset + (lead_s + frame * frame_s) * obstacle.velocity;
    // A point within r of a core on its way is within sqrt(r^2 + step^2 / 4) of it at one end of the step, whatever the
    // core's form: so no sub-step leaves a gap, at the price of less than 7 % of r for r >= 0.07 m at 0.1 m voxels.
    const double end_s = (frame + 1) * frame_s, unseen_s = std::clamp(lead_s + end_s, 0.0, kUnseen_s);
    const double r = core.thickness + margin_m + growth_mps * end_s +
                     obstacle.acceleration_mps2 * unseen_s * unseen_s / 2 + kRounding_m;
    const double reach = std::sqrt(r * r + step_m * step_m / 4);
    if (!meets_window(core, from, motion, reach, sogm->geometry)) continue;
    for (int k = 0; k <= steps; ++k) {
      const Sweep sweep{steps > 0 ? Eigen::Vector3d(from + motion * k / steps) : from,
                        straight ? Eigen::Vector2d(motion.head<2>()) : Eigen::Vector2d::Zero(), reach};
      Painter(core, sweep, frame, sogm, &full).paint();
    }
  }
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
