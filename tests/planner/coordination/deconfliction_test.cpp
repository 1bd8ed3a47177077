#include "planner_daemon/coordination/deconfliction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/support/hull_distance.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using Eigen::Vector3d;

TEST(LinearlySeparableTest, IsSoundAndFindsWhatIsClearlySeparable) {
  Rng rng(1);
  int separable = 0, clear = 0, found = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    const Vector3d center = in_cube(rng, 2), extent = in_box(rng, Vector3d::Zero(), Vector3d::Constant(1.5));
    ControlPoints points;
    for (int k = 0; k < 6; ++k) points.col(k) = center + in_box(rng, -extent, extent);
    const double distance = distance_to_hull(points, Vector3d::Zero()), radius = uniform(rng, 0.05, 1.5);
    const bool answer = linearly_separable(points, radius);
    const auto input = [&] {
      return ::testing::Message() << "trial " << trial << ", radius " << radius << ", distance " << distance << "\n"
                                  << points;
    };
    ASSERT_TRUE(!answer || distance >= radius - 1e-9) << input();
    separable += distance >= radius, found += answer;
    if (distance > 1.25 * radius) {
      ++clear;
      ASSERT_TRUE(answer) << input();
    }
  }
  EXPECT_GT(clear, 1000);
  EXPECT_LT(separable, 4500);              // both kinds occur
  EXPECT_GT(found, separable * 95 / 100);  // few of those that exist only just are missed
}

TEST(LinearlySeparableTest, PointAndSegmentHulls) {
  ControlPoints points = Vector3d(0.3, 0.4, 0).replicate<1, 6>();
  EXPECT_TRUE(linearly_separable(points, 0.5));
  EXPECT_FALSE(linearly_separable(points, 0.5 + 1e-12));
  EXPECT_FALSE(linearly_separable(ControlPoints::Zero(), 0.1));
  for (int k = 0; k < 6; ++k) points.col(k) = Vector3d(k - 2.5, 0.5, 0);  // passes the origin at 0.5
  EXPECT_TRUE(linearly_separable(points, 0.49));
  EXPECT_FALSE(linearly_separable(points, 0.51));
}

double least_sampled_distance(const Motion& a, const Motion& b, Utime from) {
  double least = INFINITY;
  const Utime end = std::max({a.end_utime(), b.end_utime(), from});
  for (Utime t = from; t <= end + 1ms; t += 1ms) {
    least = std::min(least, (a.at(t).position - b.at(t).position).norm());
  }
  return least;
}

// Against a millisecond's sampling, about the distance that decides. Relative speeds stay below 20 m/s, so that between
// two samples the motions come nearer by less than a centimetre.
TEST(MotionsSeparatedTest, AgreesWithDenseSampling) {
  Rng rng(2);
  int decided_by_tail = 0;
  for (int trial = 0; trial < 600; ++trial) {
    const Motion a = random_motion(rng, kStart, 1.5);
    const Motion b = random_motion(rng, kStart + uniform_duration(rng, -1500ms, 1500ms), 1.5);
    const Utime from = std::max(a.committed.start_utime(), b.committed.start_utime()) + uniform_duration(rng, -1s, 2s);
    const double least = least_sampled_distance(a, b, from);
    const Utime end = std::max({a.end_utime(), b.end_utime(), from});
    decided_by_tail += least == (a.at(end).position - b.at(end).position).norm();
    for (double distance : {least - 0.0101, least - 0.002, least + 2e-6, least + 0.05, uniform(rng, 0.05, 1.0)}) {
      if (distance <= 0.0) continue;
      const bool answer = motions_separated(a, b, from, distance);
      const auto input = [&] {
        return ::testing::Message() << "trial " << trial << ", distance " << distance << ", sampled " << least
                                    << ", from " << to_us(from) << "\na " << a << "\nb " << b;
      };
      ASSERT_TRUE(!answer || least >= distance - 1e-9) << input();
      ASSERT_TRUE(answer || least <= distance + 0.01) << input();
      ASSERT_EQ(motions_separated(b, a, from, distance), answer) << input();
    }
  }
  EXPECT_GT(decided_by_tail, 20);
  EXPECT_LT(decided_by_tail, 500);
}

// Whatever is said to be apart is apart for every shift of the second motion, and what is farther apart than it can
// come nearer in that time is said to be.
TEST(MotionsSeparatedTest, AllowsForAWrongClock) {
  Rng rng(3);
  int differ = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Motion a = random_motion(rng, kStart, 1.5);
    const Motion b = random_motion(rng, kStart - uniform_duration(rng, 100ms, 1s), 1.5);
    const double error_s = uniform(rng, 0.005, 0.05);
    const Utime from = kStart + uniform_duration(rng, 0us, 1s);
    double least = INFINITY, fastest = 0.0;
    for (const double share : {-1.0, -0.5, 0.0, 0.5, 1.0}) {
      Motion late = b;
      late.committed.shift(to_duration(share * error_s));
      late.next.shift(to_duration(share * error_s));
      least = std::min(least, least_sampled_distance(a, late, from));
    }
    for (Utime t = from - 60ms; t < b.end_utime(); t += 1ms) fastest = std::max(fastest, b.at(t).velocity.norm());
    const double distance = uniform(rng, 0.05, 1.0);
    const bool answer = motions_separated(a, b, from, distance, error_s);
    ASSERT_TRUE(!answer || least >= distance - 1e-9) << "trial " << trial << ", " << least << " < " << distance;
    const bool clear = least_sampled_distance(a, b, from) > distance + 2.5 * error_s * fastest + 0.02;
    ASSERT_TRUE(answer || !clear) << "trial " << trial;
    differ += answer != motions_separated(a, b, from, distance);
  }
  EXPECT_GT(differ, 5);
}

Motion line(Utime start, const Vector3d& from, const Vector3d& to) {
  Motion motion{Trajectory(1, start, 1s, 1), {}};
  MotionState state;
  state.position = from;
  motion.committed.set_knot(0, state);
  state.position = to;
  motion.committed.set_knot(1, state);
  return motion;
}

TEST(MotionsSeparatedTest, WhateverRestsNeedsNoClock) {
  const Motion passing = line(kStart, {-1, 0.41, 1}, {1, 0.41, 1});
  const Motion hovering{Trajectory::hover(1, kStart - 1s, {0, 0, 1}), {}};
  EXPECT_TRUE(motions_separated(passing, hovering, kStart, 0.4, 0.1));
  EXPECT_FALSE(motions_separated(hovering, passing, kStart, 0.4, 0.1));
}

TEST(MotionsSeparatedTest, SamePlaceAtDifferentTimesIsNoConflict) {
  const Motion east = line(kStart, {-1, 0, 1}, {1, 0, 1});
  EXPECT_FALSE(motions_separated(east, line(kStart, {0, -1, 1}, {0, 1, 1}), kStart, 0.4));
  EXPECT_TRUE(motions_separated(east, line(kStart + 1s, {0, -1, 1}, {0, 1, 1}), kStart, 0.4));
  EXPECT_FALSE(motions_separated(east, line(kStart, {1, 0, 1}, {-1, 0, 1}), kStart, 0.4));
}

TEST(MotionsSeparatedTest, CountsFromTheGivenTimeToForEver) {
  const Motion passing = line(kStart, {-1, 0, 1}, {1, 0, 1});
  const Motion hovering{Trajectory::hover(1, kStart, {0, 0.3, 1}), {}};
  EXPECT_FALSE(motions_separated(passing, hovering, kStart, 0.4));
  EXPECT_TRUE(motions_separated(passing, hovering, kStart + 800ms, 0.4));  // it has passed
  const Motion arriving = line(kStart + 5s, {5, 0, 1}, {1, 0.3, 1});       // long after the other's end
  EXPECT_FALSE(motions_separated(passing, arriving, kStart, 0.4));
  EXPECT_TRUE(motions_separated(passing, arriving, kStart, 0.29));
  EXPECT_FALSE(motions_separated(passing, arriving, kStart + 60s, 0.4));  // both hover there
}

TEST(MotionsSeparatedTest, APendingNextCounts) {
  const Motion hovering{Trajectory::hover(1, kStart, {0, 0, 1}), {}};
  Motion other{Trajectory::hover(1, kStart, {3, 0, 1}), {}};
  EXPECT_TRUE(motions_separated(hovering, other, kStart, 0.5));
  other.next = line(kStart + 2s, {3, 0, 1}, {0.3, 0, 1}).committed;
  EXPECT_FALSE(motions_separated(hovering, other, kStart, 0.5));
  other.committed = line(kStart + 2500ms, {3, 0, 1}, {0, 0, 1}).committed;  // never flown
  other.next = Trajectory::hover(2, kStart + 2s, {3, 0, 1});
  EXPECT_TRUE(motions_separated(hovering, other, kStart, 0.5));
}

// Around another robot, at a distance from it that is the more laborious to show the closer it is to what is wanted.
// That is given up, and taken for a conflict: judging a motion must not take longer than setpoints can wait.
TEST(MotionsSeparatedTest, GivesUpWhatIsTooLaborious) {
  constexpr int kPieces = Trajectory::kMaxPieces;
  constexpr double r = 1000.0;
  Trajectory around(1, kStart, 1s, kPieces);
  for (int k = 0; k <= kPieces; ++k) {
    const double rate = 0.1, angle = rate * k;  // at 100 m/s
    const Vector3d out(std::cos(angle), std::sin(angle), 0), along(-out.y(), out.x(), 0);
    around.set_knot(k, {r * out, r * rate * along, -r * rate * rate * out, Vector3d::Zero()});
  }
  const Motion hovers{Trajectory::hover(1, kStart, Vector3d::Zero()), {}};
  double nearest_m = r;
  for (Utime t = kStart; t < around.end_utime(); t += 1ms)
    nearest_m = std::min(nearest_m, around.at(t).position.norm());
  EXPECT_TRUE(motions_separated(hovers, {around, {}}, kStart, (1.0 - 1e-2) * nearest_m));
  EXPECT_TRUE(motions_separated(hovers, {around, {}}, kStart, (1.0 - 1e-4) * nearest_m));
  EXPECT_FALSE(motions_separated(hovers, {around, {}}, kStart, nearest_m - 1e-7));
}

}  // namespace
}  // namespace swarm
