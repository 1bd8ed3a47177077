// The primitives of the search: time-optimal bounds, where they lead, and that they keep the speed limit.
#include "planner_daemon/search/primitives.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>

#include "tests/support/search_scene.h"

namespace swarm {
namespace {

using Eigen::Vector3d;

// All motions that accelerate to a peak speed, keep it and brake: the fastest to rest at d.
double brute_force_time(double d, double v, double v_max_mps, double a_max_mps2) {
  double least = INFINITY;
  constexpr int kPeaks = 20'000;
  for (int i = -kPeaks; i <= kPeaks; ++i) {
    const double peak = v_max_mps * i / kPeaks;
    const double ramp = (peak - v) / (peak >= v ? a_max_mps2 : -a_max_mps2), brake = std::abs(peak) / a_max_mps2;
    const double remaining = d - ramp * (v + peak) / 2 - brake * peak / 2;
    if (i == 0 ? std::abs(remaining) < 1e-9 : remaining / peak >= 0.0) {
      least = std::min(least, ramp + brake + (i == 0 ? 0.0 : remaining / peak));
    }
  }
  return least;
}

TEST(MinTimeToRestTest, EqualsTheBestOfAllBangBangMotions) {
  Rng rng(1);
  for (int trial = 0; trial < 300; ++trial) {
    const double v_max_mps = uniform(rng, 0.5, 4.0), a_max_mps2 = uniform(rng, 1.0, 10.0);
    const double d = uniform(rng, -1, 1) * std::pow(10.0, uniform(rng, -2, 1)), v = uniform(rng, -v_max_mps, v_max_mps);
    const double time = min_time_to_rest(d, v, v_max_mps, a_max_mps2),
                 brute = brute_force_time(d, v, v_max_mps, a_max_mps2);
    const auto input = [&] { return testing::Message() << d << ' ' << v << ' ' << v_max_mps << ' ' << a_max_mps2; };
    ASSERT_LE(time, brute + 1e-9) << input();
    ASSERT_GE(time, brute - 0.01)
        << input();  // the grid of peaks; its error is below its step times 1 / a_max_mps2 and more near 0
    ASSERT_NEAR(min_time_to_rest(-d, -v, v_max_mps, a_max_mps2), time, 1e-12) << input();
  }
}

TEST(MinTimeToRestTest, KnownCases) {
  EXPECT_EQ(min_time_to_rest(0, 0, 2, 6), 0.0);
  EXPECT_NEAR(min_time_to_rest(8, 0, 2, 4), 4.5, 1e-12);                   // ramps of 0.5 s and 0.5 m, 3.5 s of cruise
  EXPECT_NEAR(min_time_to_rest(1, 0, 2, 4), 1.0, 1e-12);                   // just reaches v_max_mps
  EXPECT_NEAR(min_time_to_rest(0.5, 2, 2, 4), 0.5, 1e-12);                 // brakes all the way
  EXPECT_NEAR(min_time_to_rest(0, 2, 2, 4), 0.5 + std::sqrt(0.5), 1e-12);  // overshoots by 0.5 m and comes back
}

// An admissible heuristic is consistent: no motion of duration dt brings the goal nearer than dt.
TEST(MinTimeToRestTest, TriangleProperty) {
  Rng rng(2);
  for (int trial = 0; trial < 20'000; ++trial) {
    const double v_max_mps = 2.0, a_max_mps2 = 6.0, dt = uniform(rng, 0.001, 0.5);
    const double d = uniform(rng, -3, 3), v = uniform(rng, -v_max_mps, v_max_mps);
    const double a = std::clamp(uniform(rng, -a_max_mps2, a_max_mps2), (-v_max_mps - v) / dt, (v_max_mps - v) / dt);
    const double after = min_time_to_rest(d - v * dt - a * dt * dt / 2, v + a * dt, v_max_mps, a_max_mps2);
    ASSERT_LE(min_time_to_rest(d, v, v_max_mps, a_max_mps2), dt + after + 1e-9)
        << d << ' ' << v << ' ' << a << ' ' << dt;
  }
}

TEST(PrimitivesTest, PropagateIntegratesThePrimitive) {
  Rng rng(3);
  for (int trial = 0; trial < 50; ++trial) {
    SearchOptions options;
    options.piece = Duration(uniform_int(rng, 150'000, 400'000));
    const double tau = to_seconds(options.piece);
    const Primitives primitives(SearchLimits{}, options);
    const MotionState from = random_state(rng, 5, 2, 6);
    const Vector3d a1 = in_cube(rng, 6);
    const MotionState to = primitives.propagate(from, a1);
    Vector3d p = from.position, v = from.velocity;
    constexpr int kSteps = 2000;
    for (int i = 0; i < kSteps; ++i) {  // a(s) = a0 + (a1 - a0)(2 s - s^2), midpoint rule
      const double s = (i + 0.5) / kSteps, dt = tau / kSteps;
      const Vector3d a = from.acceleration + (a1 - from.acceleration) * (2 * s - s * s);
      p += dt * v + dt * dt / 2 * a;
      v += dt * a;
    }
    EXPECT_LT((to.position - p).norm(), 1e-6) << from << " a1 " << a1.transpose() << " tau " << tau;
    EXPECT_LT((to.velocity - v).norm(), 1e-6);
    EXPECT_EQ(to.acceleration, a1);
    // The quintic between the two knots is the primitive itself, a quartic: its fifth difference vanishes.
    const ControlPoints c = quintic_control_points(from, to, tau);
    const Vector3d fifth = c.col(5) - 5 * c.col(4) + 10 * c.col(3) - 10 * c.col(2) + 5 * c.col(1) - c.col(0);
    EXPECT_LT(fifth.norm(), 1e-12);
  }
}

// However fast the robot: nothing that is a voxel wide lies between two samples.
TEST(PrimitivesTest, SamplesLieAtMostAVoxelApart) {
  Rng rng(5);
  for (const double v_max_mps : {0.5, 2.0, 5.0, 10.0, 15.0}) {
    SearchLimits limits;
    limits.v_max_mps = v_max_mps;
    limits.a_max_mps2 = 20.0;
    Primitives primitives(limits, SearchOptions{});
    for (const double resolution_m : {0.1, 0.2, 0.3}) {
      primitives.lay_out(empty_map({0.3, 0.3, 64 * resolution_m}, resolution_m, 1, kStart, 100ms).geometry,
                         {limits.space_min, limits.space_max}, limits.v_max_mps);
      ASSERT_EQ(primitives.num_samples() % kBlockSamples, 0);
      ASSERT_LE(primitives.num_samples(), kMaxSamples);
      for (int trial = 0; trial < 200; ++trial) {
        const MotionState from = viable_state(rng, limits, primitives.tau_s(), Vector3d::Zero());
        AxisOptions options;
        primitives.axis_options(2, from, true, &options);
        for (int i = 0; i < options.count; ++i) {
          const AxisSamples& samples = options.option[static_cast<std::size_t>(i)].samples;
          int before = 32;  // the voxel of the start
          for (int k = 0; k < primitives.num_samples(); ++k) {
            const std::uint64_t bit = samples.in_window[static_cast<std::size_t>(k)];
            if (bit == 0) break;  // it has left the window
            const int voxel = std::countr_zero(bit);
            ASSERT_LE(std::abs(voxel - before), 1) << v_max_mps << " m/s, " << resolution_m << " m, sample " << k;
            before = voxel;
          }
        }
      }
    }
  }
}

// Whatever state a robot with limited jerk came to, it brakes to rest in the time that was kept for it.
TEST(PrimitivesTest, BrakesWithinJerkAndThrust) {
  Rng rng(6);
  for (int trial = 0; trial < 40; ++trial) {
    SearchLimits limits;
    if (trial % 3 != 0) limits.j_max_mps3 = uniform(rng, 25.0, 120.0);
    if (trial % 3 != 1) limits.kind = "thrust";
    Primitives primitives(limits, SearchOptions{});
    primitives.lay_out(empty_map({64, 64, 64}, 1.0, 1, kStart, 100ms).geometry, {limits.space_min, limits.space_max},
                       limits.v_max_mps);
    const double tau = primitives.tau_s(), step = limits.j_max_mps3 > 0.0 ? limits.j_max_mps3 * tau / 2 : INFINITY;
    for (int walk = 0; walk < 50; ++walk) {
      MotionState state = at_rest({0, 0, 0});
      for (int k = 0; k < 8; ++k) {  // somewhere, by what the axes offer
        Vector3d a1;
        for (int axis = 0; axis < 3; ++axis) {
          AxisOptions options;
          primitives.axis_options(axis, state, true, &options);
          ASSERT_GT(options.count, 0);
          a1[axis] = options.option[static_cast<std::size_t>(uniform_int(rng, 0, options.count - 1))].acceleration;
          ASSERT_LE(std::abs(a1[axis] - state.acceleration[axis]), step);
        }
        if (!primitives.can_tilt(a1.x(), a1.y(), a1.z())) continue;
        state = primitives.propagate(state, a1);
        ASSERT_LE(state.velocity.cwiseAbs().maxCoeff(), limits.v_max_mps + 1e-9);
      }
      const MotionState from = state;
      const Vector3d level = primitives.brake_level(from);
      for (int k = 1; k <= primitives.brake_pieces(); ++k) {
        const Vector3d a1 = primitives.brake_acceleration(k, from, level);
        ASSERT_LE((a1 - state.acceleration).cwiseAbs().maxCoeff(), step) << from << ", piece " << k;
        ASSERT_TRUE((a1.cwiseAbs().array() <= limits.axis_mps2().array()).all()) << from << ", piece " << k;
        ASSERT_TRUE(primitives.can_tilt(a1.x(), a1.y(), a1.z())) << from << ", piece " << k;
        state = primitives.propagate(state, a1);
        ASSERT_LE(state.velocity.cwiseAbs().maxCoeff(), limits.v_max_mps + 1e-9) << from << ", piece " << k;
      }
      EXPECT_LT(state.velocity.norm(), 1e-9);
      EXPECT_LT(state.acceleration.norm(), 1e-9);
    }
  }
}

// One that was pushed accelerates faster than can end in time: it brakes all the same, as far as it may.
TEST(PrimitivesTest, BrakesFromAnAccelerationThatCannotEndInTime) {
  SearchLimits limits;
  limits.j_max_mps3 = 40.0;
  const Primitives primitives(limits, SearchOptions{});
  MotionState state;
  state.acceleration = {30.0, -30.0, 0.0};
  const Vector3d level = primitives.brake_level(state);
  ASSERT_TRUE(level.allFinite());
  for (int k = 1; k <= primitives.brake_pieces(); ++k) {
    const Vector3d a = primitives.brake_acceleration(k, state, level);
    EXPECT_LE(std::abs(a.x()), 30.0);
    EXPECT_EQ(a.x(), -a.y());
    EXPECT_EQ(a.z(), 0.0);
  }
  EXPECT_EQ(primitives.brake_acceleration(primitives.brake_pieces(), state, level), Vector3d::Zero());
}

// In the middle of a piece the acceleration may be too large for the speed: it is taken back at once.
TEST(PrimitivesTest, AStartThatStillRisesHardlyPassesTheSpeedLimit) {
  Rng rng(8);
  const Scene scene(empty_map({9, 9, 2}, 0.1, 20, kStart, 100ms));
  const SearchLimits limits;
  KinodynamicSearch search(limits, SearchOptions{});
  SearchResult path;
  int rising = 0;
  for (int trial = 0; trial < 400; ++trial) {
    MotionState start;
    const int axis = trial % 3;
    const double sign = trial % 2 == 0 ? 1 : -1, v = uniform(rng, 1.5, 2.0), a = uniform(rng, 0.0, 4.0);
    // Full braking within a primitive, a(s) = a - (a + 5.88)(2 s - s^2), on a fine grid.
    double least_peak = v, at = v;
    for (int i = 0; i < 2000; ++i) {
      const double s = (i + 0.5) / 2000;
      at += 0.2 / 2000 * (a - (a + 5.88) * (2 * s - s * s));
      least_peak = std::max(least_peak, at);
    }
    if (v + 0.2 / 3 * a <= limits.v_max_mps) continue;
    ++rising;
    start.velocity[axis] = sign * v;
    start.acceleration[axis] = sign * a;
    search.find(scene.problem(start, kStart, 50 * sign * Vector3d::Unit(axis)), &path);
    double fastest = 0.0;
    for (double t = 0.0; t < 0.2 * path.num_pieces; t += 0.001)
      fastest = std::max(fastest, std::abs(state_at(path, 0.2, t).velocity[axis]));
    EXPECT_LE(fastest, std::max(1.0025 * limits.v_max_mps, least_peak) + 0.002) << v << ' ' << a;
  }
  EXPECT_GT(rising, 100);
}

// What the message advises can be flown, a little more cannot.
TEST(PrimitivesTest, SaysWhatTheHorizonCanBrakeFrom) {
  SearchLimits limits;
  SearchOptions options;
  limits.v_max_mps = 10.0;
  limits.a_max_mps2 = 2.0;
  std::string message;
  try {
    const Primitives primitives(limits, options);
  } catch (const std::invalid_argument& error) {
    message = error.what();
  }
  EXPECT_NE(message.find("pieces of 0.638 s or more do, or a speed of 3.13 m/s or less"), std::string::npos) << message;
  limits.v_max_mps = 3.13;
  EXPECT_NO_THROW(Primitives(limits, options));
  limits.v_max_mps = 3.15;
  EXPECT_THROW(Primitives(limits, options), std::invalid_argument);
  limits.v_max_mps = 10.0;
  options.piece = 638ms;
  EXPECT_NO_THROW(Primitives(limits, options));
  options.piece = 637ms;
  EXPECT_THROW(Primitives(limits, options), std::invalid_argument);
  // With limits of jerk and thrust, too.
  limits = {};
  limits.j_max_mps3 = 8.0;
  limits.kind = "thrust";
  options.piece = 200ms;
  try {
    const Primitives primitives(limits, options);
    FAIL();
  } catch (const std::invalid_argument& error) {
    message = error.what();
  }
  double piece_s = 0.0, speed_mps = 0.0;
  const std::string advice = message.substr(message.find("of so many"));
  ASSERT_EQ(std::sscanf(advice.c_str(), "of so many, pieces of %lf s or more do, or a speed of %lf m/s", &piece_s,
                        &speed_mps),
            2)
      << message;
  for (const double over : {0.0, 0.011}) {
    SearchLimits slower = limits;
    slower.v_max_mps = speed_mps + over;
    EXPECT_EQ(Primitives::brake_pieces(slower, 200ms) < Trajectory::kMaxPieces, over == 0.0) << message;
    EXPECT_EQ(Primitives::brake_pieces(limits, to_duration(piece_s - over)) < Trajectory::kMaxPieces, over == 0.0)
        << message;
  }
}

}  // namespace
}  // namespace swarm
