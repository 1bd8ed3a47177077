// Exact distances against sampled surfaces, and rasterisation against the distances sampled densely in time. Long
// because each shape is tried in both ways.
#include "map_daemon/obstacle.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>
#include <random>
#include <sstream>

namespace swarm {
namespace {

using std::numbers::pi;

class Random {
 public:
  explicit Random(unsigned seed) : rng_(seed) {}
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng_); }
  int integer(int low, int high) { return std::uniform_int_distribution<int>(low, high)(rng_); }
  Eigen::Vector3d vector(double extent) {
    return {(*this)(-extent, extent), (*this)(-extent, extent), (*this)(-extent, extent)};
  }

 private:
  std::mt19937 rng_;
};

Shape random_shape(Shape::Kind kind, Random* random) {
  Shape shape{.kind = kind};
  shape.yaw_rad = (*random)(-pi, pi);
  switch (kind) {
    case Shape::Kind::kColumn:
      shape.size = {(*random)(0.0, 1.0), (*random)(0.0, 2.0), 0.0};
      break;
    case Shape::Kind::kRing:
      shape.size = {(*random)(0.0, 1.0), (*random)(0.02, 0.4), 0.0};
      break;
    case Shape::Kind::kBox:
      shape.size = {(*random)(0.0, 1.0), (*random)(0.0, 1.0), (*random)(0.0, 1.0)};
      break;
    case Shape::Kind::kSphere:
      shape.size = {(*random)(0.0, 1.0), 0.0, 0.0};
      break;
    case Shape::Kind::kVoxels:
      shape.size = {(*random)(0.02, 0.2), 0.0, 0.0};
      for (int i = random->integer(1, 12); i > 0; --i) {
        const Eigen::Vector3i voxel(random->integer(-3, 3), random->integer(-3, 3), random->integer(-3, 3));
        for (int k = random->integer(0, 2); k >= 0; --k) shape.voxels.push_back(voxel + Eigen::Vector3i(0, 0, 2 - k));
      }
      break;
  }
  return shape;
}

constexpr Shape::Kind kKinds[] = {Shape::Kind::kColumn, Shape::Kind::kRing, Shape::Kind::kBox, Shape::Kind::kSphere,
                                  Shape::Kind::kVoxels};

std::string describe(const Shape& shape) {
  std::ostringstream out;
  out << "kind " << static_cast<int>(shape.kind) << " size " << shape.size.transpose() << " yaw " << shape.yaw_rad;
  for (const Eigen::Vector3i& v : shape.voxels) out << " (" << v.transpose() << ")";
  return out.str();
}

// Points that fill a solid, its surface included, with neighbours at most about `spacing` apart.
std::vector<Eigen::Vector3d> fill(const Shape& shape, double spacing) {
  std::vector<Eigen::Vector3d> points;
  const auto steps = [spacing](double length) { return static_cast<int>(std::ceil(length / spacing)) + 1; };
  const auto at = [](int i, int n) { return static_cast<double>(i) / n; };
  const Eigen::AngleAxisd turn(shape.yaw_rad, Eigen::Vector3d::UnitZ());
  const auto fill_box = [&](const Eigen::Vector3d& center, const Eigen::Vector3d& size, bool turned) {
    const int nx = steps(size.x()), ny = steps(size.y()), nz = steps(size.z());
    for (int i = 0; i <= nx; ++i) {
      for (int j = 0; j <= ny; ++j) {
        for (int k = 0; k <= nz; ++k) {
          const Eigen::Vector3d local = size.cwiseProduct(
              Eigen::Vector3d(at(i, nx), at(j, ny), at(k, nz)).array().matrix() - Eigen::Vector3d::Constant(0.5));
          points.push_back(center + (turned ? Eigen::Vector3d(turn * local) : local));
        }
      }
    }
  };
  // A disc of `radius` in the plane of u and v about c.
  const auto fill_disc = [&](const Eigen::Vector3d& c, const Eigen::Vector3d& u, const Eigen::Vector3d& v,
                             double radius) {
    const int nr = steps(radius);
    for (int i = 0; i <= nr; ++i) {
      const double r = radius * at(i, nr);
      const int na = steps(2 * pi * r);
      for (int j = 0; j < na; ++j) {
        const double a = 2 * pi * at(j, na);
        points.push_back(c + r * (std::cos(a) * u + std::sin(a) * v));
      }
    }
  };
  switch (shape.kind) {
    case Shape::Kind::kColumn: {
      const int n = steps(shape.size.y());
      for (int k = 0; k <= n; ++k) {
        fill_disc({0, 0, shape.size.y() * (at(k, n) - 0.5)}, Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(),
                  shape.size.x() / 2);
      }
      break;
    }
    case Shape::Kind::kRing: {
      const double major = shape.size.x(), minor = shape.size.y() / 2;
      const Eigen::Vector3d axis = turn * Eigen::Vector3d::UnitX(), side = turn * Eigen::Vector3d::UnitY();
      const int n = steps(2 * pi * (major + minor));
      for (int k = 0; k < n; ++k) {
        const double a = 2 * pi * at(k, n);
        const Eigen::Vector3d outwards = std::cos(a) * side + std::sin(a) * Eigen::Vector3d::UnitZ();
        fill_disc(major * outwards, outwards, axis, minor);
      }
      break;
    }
    case Shape::Kind::kBox:
      fill_box(Eigen::Vector3d::Zero(), shape.size, true);
      break;
    case Shape::Kind::kSphere: {
      const double radius = shape.size.x() / 2;
      const int n = steps(2 * radius);
      for (int k = 0; k <= n; ++k) {
        const double z = radius * (2 * at(k, n) - 1);
        fill_disc({0, 0, z}, Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(),
                  std::sqrt(std::max(radius * radius - z * z, 0.0)));
      }
      break;
    }
    case Shape::Kind::kVoxels:
      for (const Eigen::Vector3i& v : shape.voxels) {
        fill_box(shape.size.x() * v.cast<double>(), Eigen::Vector3d::Constant(shape.size.x()), false);
      }
      break;
  }
  return points;
}

TEST(Distance, EqualsTheNearestPointOfTheFilledSolid) {
  Random random(11);
  constexpr double kSpacing_m = 0.03;
  for (Shape::Kind kind : kKinds) {
    for (int trial = 0; trial < 12; ++trial) {
      const Shape shape = random_shape(kind, &random);
      const std::vector<Eigen::Vector3d> solid = fill(shape, kSpacing_m);
      for (int query = 0; query < 25; ++query) {
        const Eigen::Vector3d p = random.vector(2.0);
        double nearest = 1e9;
        for (const Eigen::Vector3d& q : solid) nearest = std::min(nearest, (p - q).norm());
        const double exact = distance(shape, p);
        // Samples are points of the solid (never nearer than the truth) and leave no gap above the spacing.
        EXPECT_LE(exact, nearest + 1e-9) << describe(shape) << " at " << p.transpose();
        EXPECT_GE(exact, nearest - kSpacing_m) << describe(shape) << " at " << p.transpose();
      }
    }
  }
}

TEST(Distance, KnownValues) {
  const Shape column{.kind = Shape::Kind::kColumn, .size = {1.0, 4.0, 0.0}};
  EXPECT_DOUBLE_EQ(distance(column, {0.8, 0.0, 2.4}), 0.5);  // 3-4-5 from the rim
  EXPECT_EQ(distance(column, {0.3, 0.3, 1.9}), 0.0);
  const Shape ring{.kind = Shape::Kind::kRing, .size = {1.5, 0.1, 0.0}, .yaw_rad = pi / 2};  // axis along y
  EXPECT_NEAR(distance(ring, {0.0, 0.0, 0.0}), 1.45, 1e-12);
  EXPECT_NEAR(distance(ring, {1.5, 1.0, 0.0}), 0.95, 1e-12);
  EXPECT_EQ(distance(ring, {0.0, 0.0, -1.5}), 0.0);
  const Shape box{.kind = Shape::Kind::kBox, .size = {2.0, 1.0, 1.0}, .yaw_rad = pi / 2};  // 1 m along x, 2 m along y
  EXPECT_NEAR(distance(box, {1.5, 0.9, 0.0}), 1.0, 1e-12);
  EXPECT_EQ(distance(Shape{.kind = Shape::Kind::kVoxels, .size = {0.1, 0, 0}}, {0, 0, 0}),
            std::numeric_limits<double>::infinity());
}

struct Scene {
  Obstacle obstacle;
  double margin_m = 0.0, growth_mps = 0.0;
  Sogm sogm;
};

Scene random_scene(Shape::Kind kind, bool vertical, Random* random) {
  Scene scene;
  scene.obstacle.shape = random_shape(kind, random);
  scene.obstacle.utime = Utime(7s) + Duration(random->integer(-500'000, 100'000));
  scene.obstacle.position = random->vector(0.9);
  const double speed = random->integer(0, 3) == 0 ? 0.0 : 2.0;
  scene.obstacle.velocity = speed * random->vector(1.0);
  if (!vertical) scene.obstacle.velocity.z() = 0.0;
  scene.margin_m = random->integer(0, 1) * (*random)(0.0, 0.2);
  scene.growth_mps = random->integer(0, 1) * (*random)(0.0, 0.2);
  const double resolution_m = (*random)(0.08, 0.2);
  const int tall = random->integer(0, 1);  // one or two words per column
  scene.sogm.reset({.resolution_m = resolution_m,
                    .origin = tall ? Eigen::Vector3i(-4, -5, -50) : Eigen::Vector3i(-6, -5, -6),
                    .size = tall ? Eigen::Vector3i(8, 8, 75) : Eigen::Vector3i(13, 11, 12)},
                   2, Utime(7s), Duration(random->integer(20'000, 300'000)));
  scene.obstacle.acceleration_mps2 = random->integer(0, 1) * (*random)(0.0, 2.0);
  return scene;
}

// How far beyond the obstacle voxels are marked at the end of a frame.
double end_margin_m(const Scene& scene, int frame) {
  const double end_s = (frame + 1) * to_seconds(scene.sogm.frame_duration);
  const double age_s = to_seconds(scene.sogm.start_utime - scene.obstacle.utime) + end_s;
  const double unseen_s = std::min(std::max(age_s, 0.0), 0.5);
  return scene.margin_m + scene.growth_mps * end_s + 0.5 * scene.obstacle.acceleration_mps2 * unseen_s * unseen_s;
}

// What rasterize() takes the shape for.
std::vector<std::pair<Shape, Eigen::Vector3d>> thick_parts(const Shape& shape, double resolution_m, double margin_m) {
  if (shape.kind != Shape::Kind::kVoxels) return {{thickened(shape, resolution_m, margin_m), Eigen::Vector3d::Zero()}};
  std::vector<std::pair<Shape, Eigen::Vector3d>> parts;
  const double edge_m = std::max(shape.size.x(), resolution_m);
  for (const Eigen::Vector3i& voxel : shape.voxels) {
    parts.emplace_back(Shape{.kind = Shape::Kind::kBox, .size = Eigen::Vector3d::Constant(edge_m)},
                       shape.size.x() * voxel.cast<double>());
  }
  return parts;
}

Eigen::Vector3d position_at(const Scene& scene, int frame, double fraction) {
  const double t_s = to_seconds(scene.sogm.start_utime - scene.obstacle.utime) +
                     (frame + fraction) * to_seconds(scene.sogm.frame_duration);
  return scene.obstacle.position + t_s * scene.obstacle.velocity;
}

// Nothing that touches at a sampled time is missed; nothing is marked that stays farther than the promised slack.
TEST(Rasterize, AgreesWithDistancesSampledInTime) {
  Random random(12);
  constexpr int kSamples = 16;
  int marked = 0, visited = 0, beyond = 0;
  for (Shape::Kind kind : kKinds) {
    for (int trial = 0; trial < 20; ++trial) {
      const bool vertical = trial % 2 == 1;
      Scene scene = random_scene(kind, vertical, &random);
      Sogm& sogm = scene.sogm;
      rasterize(scene.obstacle, scene.margin_m, scene.growth_mps, &sogm);
      const double frame_s = to_seconds(sogm.frame_duration);
      const double gap_m = scene.obstacle.velocity.norm() * frame_s / kSamples / 2;  // between samples in time
      const auto parts = thick_parts(scene.obstacle.shape, sogm.geometry.resolution_m, scene.margin_m);
      const bool exact = !vertical && (kind == Shape::Kind::kColumn || kind == Shape::Kind::kSphere);
      for (int f = 0; f < sogm.num_frames; ++f) {
        const double end_margin = end_margin_m(scene, f);
        const double slack_m = (exact ? 0.0 : 0.25 * sogm.geometry.resolution_m) + gap_m + 1e-6;
        for (int x = 0; x < sogm.geometry.size.x(); ++x) {
          for (int y = 0; y < sogm.geometry.size.y(); ++y) {
            for (int z = 0; z < sogm.geometry.size.z(); ++z) {
              const Eigen::Vector3i v(x, y, z);
              double nearest = 1e9;
              for (int s = 0; s <= kSamples; ++s) {
                const Eigen::Vector3d offset =
                    sogm.geometry.center_of(v) - position_at(scene, f, static_cast<double>(s) / kSamples);
                for (const auto& [part, at] : parts) nearest = std::min(nearest, distance(part, offset - at));
                if (nearest == 0.0) break;
              }
              const bool occupied = sogm.occupied(f, v);
              ++visited;
              marked += occupied;
              beyond += occupied && nearest > end_margin + gap_m;
              const auto context = [&] {
                std::ostringstream out;
                out << describe(scene.obstacle.shape) << " velocity " << scene.obstacle.velocity.transpose()
                    << " position " << scene.obstacle.position.transpose() << " margin " << scene.margin_m << " growth "
                    << scene.growth_mps << " acceleration " << scene.obstacle.acceleration_mps2 << " resolution "
                    << sogm.geometry.resolution_m << " frame " << f << " of " << frame_s << " s, voxel "
                    << v.transpose() << ", nearest " << nearest;
                return out.str();
              };
              if (nearest <= end_margin) {
                ASSERT_TRUE(occupied) << context();
              } else if (nearest > end_margin + slack_m) {
                ASSERT_FALSE(occupied) << context();
              }
            }
          }
        }
        // Bits past the window's top stay clear.
        const int words = sogm.geometry.words_per_column(), tail = sogm.geometry.size.z() % 64;
        for (int x = 0; x < sogm.geometry.size.x(); ++x) {
          for (int y = 0; y < sogm.geometry.size.y(); ++y) ASSERT_EQ(sogm.column(f, x, y)[words - 1] >> tail, 0u);
        }
      }
    }
  }
  EXPECT_GT(marked, visited / 100);          // the scenes are not empty
  EXPECT_LT(beyond, marked / 20) << marked;  // the slack is hardly used
}

// The voxel of each point of the axis of a thin shape is marked, wherever it stands, turns and moves.
TEST(Rasterize, ThinShapesMarkTheVoxelsOnTheirAxis) {
  Random random(14);
  const GridGeometry grid{.resolution_m = 0.1, .origin = {-8, -8, -8}, .size = {16, 16, 16}};
  for (const Shape::Kind kind : kKinds) {
    for (int trial = 0; trial < 200; ++trial) {
      const double thin = random(0.001, 0.05);
      Shape shape{.kind = kind, .yaw_rad = random(-pi, pi)};
      std::vector<Eigen::Vector3d> axis = {Eigen::Vector3d::Zero()};
      const auto add_line = [&axis](const Eigen::Vector3d& half) {
        for (double s = -1.0; s <= 1.0; s += 0.01) axis.push_back(s * half);
      };
      switch (kind) {
        case Shape::Kind::kColumn:
          shape.size = {thin, random(0.0, 1.0), 0.0};
          add_line({0, 0, shape.size.y() / 2});
          break;
        case Shape::Kind::kRing:
          shape.size = {random(0.0, 0.6), thin, 0.0};
          axis.clear();
          for (double a = 0.0; a < 2 * pi; a += 0.02) {
            const double across = shape.size.x() * std::cos(a), up = shape.size.x() * std::sin(a);
            axis.emplace_back(-std::sin(shape.yaw_rad) * across, std::cos(shape.yaw_rad) * across, up);
          }
          break;
        case Shape::Kind::kBox:
          shape.size = {random(0.0, 1.0), thin, thin};
          add_line(shape.size.x() / 2 * Eigen::Vector3d(std::cos(shape.yaw_rad), std::sin(shape.yaw_rad), 0));
          break;
        case Shape::Kind::kSphere:
          shape.size.x() = thin;
          break;
        case Shape::Kind::kVoxels:
          shape.size.x() = thin;
          shape.voxels = {{0, 0, 0}};
          break;
      }
      Obstacle obstacle{shape, random.vector(0.3), trial % 2 * random.vector(1.0), Utime(7s)};
      if (trial % 4 == 0) {  // at a voxel's corner
        obstacle.position = obstacle.position.unaryExpr([](double x) { return std::round(10 * x) / 10; });
      }
      Sogm sogm;
      sogm.reset(grid, 1, Utime(7s), 100ms);
      rasterize(obstacle, trial % 3 * 0.03, 0.0, &sogm);
      for (const double t_s : {0.0, 0.03, 0.08, 0.1}) {
        for (const Eigen::Vector3d& point : axis) {
          const Eigen::Vector3d place = obstacle.position + t_s * obstacle.velocity + point;
          const Eigen::Vector3i voxel = grid.voxel_of(place);
          if ((voxel.array() < 1).any() || (voxel.array() > 14).any()) continue;
          const double off_m = 1e-6;  // rounding
          bool marked = false;
          for (int k = 0; k < 8 && !marked; ++k) {
            const Eigen::Vector3d corner(k & 1 ? off_m : -off_m, k & 2 ? off_m : -off_m, k & 4 ? off_m : -off_m);
            marked = sogm.occupied(0, grid.voxel_of(place + corner));
          }
          ASSERT_TRUE(marked) << describe(shape) << " at " << obstacle.position.transpose() << " velocity "
                              << obstacle.velocity.transpose() << ", place " << place.transpose() << " after " << t_s
                              << " s";
        }
      }
    }
  }
}

// Paper section III-B: frame i is the union over its interval, so frames of half the length unite to the whole.
TEST(Rasterize, FrameIsTheUnionOfItsHalves) {
  Random random(13);
  int occupied_words = 0;
  for (Shape::Kind kind : {Shape::Kind::kColumn, Shape::Kind::kSphere}) {  // closed form: no sub-step slack
    for (int trial = 0; trial < 200; ++trial) {
      Scene scene = random_scene(kind, false, &random);
      Sogm whole = scene.sogm, halves;
      whole.frame_duration = 200ms;
      halves.reset(whole.geometry, 2 * whole.num_frames, whole.start_utime, 100ms);
      scene.obstacle.acceleration_mps2 = 0.0;  // the margin would grow within a frame
      rasterize(scene.obstacle, scene.margin_m, 0.0, &whole);
      rasterize(scene.obstacle, scene.margin_m, 0.0, &halves);
      const std::size_t n = static_cast<std::size_t>(whole.geometry.words_per_frame());
      for (int f = 0; f < whole.num_frames; ++f) {
        for (std::size_t i = 0; i < n; ++i) {
          occupied_words += whole.words()[f * n + i] != 0;
          ASSERT_EQ(whole.words()[f * n + i], halves.words()[2 * f * n + i] | halves.words()[(2 * f + 1) * n + i])
              << describe(scene.obstacle.shape) << " velocity " << scene.obstacle.velocity.transpose() << " frame "
              << f;
        }
      }
    }
  }
  EXPECT_GT(occupied_words, 5000);
}

// The map knows where it was painted.
TEST(Rasterize, ResetTakesItAllAway) {
  Random random(17);
  int painted = 0;
  for (Shape::Kind kind : kKinds) {
    for (int trial = 0; trial < 200; ++trial) {
      Scene scene = random_scene(kind, trial % 2 == 0, &random);
      Sogm& sogm = scene.sogm;
      rasterize(scene.obstacle, scene.margin_m, 0.1, &sogm);
      const std::vector<std::uint64_t> nothing(sogm.words().size(), 0);
      painted += sogm.words() != nothing ? 1 : 0;
      sogm.reset(sogm.geometry, sogm.num_frames, sogm.start_utime, sogm.frame_duration);
      ASSERT_EQ(sogm.words(), nothing) << describe(scene.obstacle.shape);
    }
  }
  EXPECT_GT(painted, 400);
}

TEST(Rasterize, KeepsWhatIsThereAndIgnoresTheFarAway) {
  Scene scene;
  scene.obstacle.shape = {.kind = Shape::Kind::kSphere, .size = {0.5, 0, 0}};
  scene.obstacle.position = {1e5, -1e5, 3.0};
  scene.sogm.reset({.resolution_m = 0.1, .origin = {0, 0, 0}, .size = {4, 4, 4}}, 2, Utime(), 100ms);
  scene.sogm.column(1, 2, 3)[0] = 5;
  const Sogm before = scene.sogm;
  rasterize(scene.obstacle, 0.1, 0.0, &scene.sogm);
  EXPECT_EQ(scene.sogm.words(), before.words());
  scene.obstacle.position = {0.25, 0.35, 0.2};
  rasterize(scene.obstacle, 0.1, 0.0, &scene.sogm);
  EXPECT_EQ(scene.sogm.column(1, 2, 3)[0] & 5u, 5u);
  EXPECT_NE(scene.sogm.words(), before.words());
}

}  // namespace
}  // namespace swarm
