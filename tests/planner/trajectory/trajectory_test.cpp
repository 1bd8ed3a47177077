#include "planner_daemon/trajectory/motion.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <bit>
#include <vector>

#include "lcmtypes/bus/limits.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

// Independent of Bezier curves: the monomials' coefficients (6 x 3) from the end conditions.
class HermiteQuintic {
 public:
  HermiteQuintic(const MotionState& from, const MotionState& to, double h) {
    Eigen::Matrix<double, 6, 6> conditions;
    Eigen::Matrix<double, 6, 3> values;
    for (int derivative = 0; derivative < 3; ++derivative) {
      conditions.row(derivative) = powers(0.0, derivative);
      conditions.row(3 + derivative) = powers(h, derivative);
    }
    values << from.position.transpose(), from.velocity.transpose(), from.acceleration.transpose(),
        to.position.transpose(), to.velocity.transpose(), to.acceleration.transpose();
    coefficients_ = conditions.fullPivLu().solve(values);
  }

  MotionState at(double t) const {
    return {(powers(t, 0) * coefficients_).transpose(), (powers(t, 1) * coefficients_).transpose(),
            (powers(t, 2) * coefficients_).transpose(), (powers(t, 3) * coefficients_).transpose()};
  }

 private:
  static Eigen::Matrix<double, 1, 6> powers(double t, int derivative) {
    Eigen::Matrix<double, 1, 6> row;
    for (int k = 0; k < 6; ++k) {
      double factor = 1.0;
      for (int i = 0; i < derivative; ++i) factor *= k - i;
      row[k] = k < derivative ? 0.0 : factor * std::pow(t, k - derivative);
    }
    return row;
  }
  Eigen::Matrix<double, 6, 3> coefficients_;
};

TEST(QuinticTest, IsTheHermiteQuinticInsideItsHullAndBounds) {
  Rng rng(1);
  for (int trial = 0; trial < 500; ++trial) {
    const MotionState from = random_state(rng, 10, 3, 8), to = random_state(rng, 10, 3, 8);
    const double h = uniform(rng, 0.05, 2.0);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", h " << h << "\nfrom " << from << "\nto " << to);
    const ControlPoints points = quintic_control_points(from, to, h);
    const HermiteQuintic curve(from, to, h);
    const double speed_bound = max_speed_bound(points, h), acceleration_bound = max_acceleration_bound(points, h);
    std::array<Eigen::Vector3d, 20> normals;
    for (Eigen::Vector3d& normal : normals) normal = in_cube(rng, 1);
    for (int i = 0; i <= 100; ++i) {
      const double s = i / 100.0;
      const MotionState expected = curve.at(s * h), state = evaluate_bezier(points, h, s);
      ASSERT_LT((state.position - expected.position).norm(), 1e-8) << s;
      ASSERT_LT((bezier_position(points, s) - expected.position).norm(), 1e-8) << s;
      ASSERT_LT(h * (state.velocity - expected.velocity).norm(), 1e-8) << s;
      ASSERT_LT(h * h * (state.acceleration - expected.acceleration).norm(), 1e-7) << s;
      ASSERT_LT(h * h * h * (state.jerk - expected.jerk).norm(), 1e-6) << s;
      for (const Eigen::Vector3d& normal : normals) {
        ASSERT_LE(normal.dot(expected.position), (normal.transpose() * points).maxCoeff() + 1e-9) << s;
      }
      ASSERT_LE(expected.velocity.cwiseAbs().maxCoeff(), speed_bound * (1 + 1e-9)) << s;
      ASSERT_LE(expected.acceleration.cwiseAbs().maxCoeff(), acceleration_bound * (1 + 1e-9)) << s;
    }
  }
}

TEST(QuinticTest, BoundsAreExactOnUniformAcceleration) {
  MotionState from, to;
  from.velocity = {1, -2, 0.5};
  from.acceleration = to.acceleration = {0.5, 3, -1};
  const double h = 0.4;
  to.velocity = from.velocity + h * from.acceleration;
  to.position = h * from.velocity + h * h / 2 * from.acceleration;
  const ControlPoints points = quintic_control_points(from, to, h);
  EXPECT_NEAR(max_speed_bound(points, h), 2.0, 1e-12);
  EXPECT_NEAR(max_acceleration_bound(points, h), 3.0, 1e-11);
}

TEST(QuinticTest, DerivativesMatchDifferencesAndTheDefinitionAtTheEnds) {
  Rng rng(2);
  for (int trial = 0; trial < 300; ++trial) {
    ControlPoints c;
    for (int k = 0; k < 6; ++k) c.col(k) = in_cube(rng, 2);
    const double h = uniform(rng, 0.1, 1.0), s = uniform(rng, 0.01, 0.99), ds = 1e-5;
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", h " << h << ", s " << s << "\n" << c);
    const MotionState left = evaluate_bezier(c, h, s - ds), right = evaluate_bezier(c, h, s + ds);
    const MotionState state = evaluate_bezier(c, h, s);
    const double dt = 2 * ds * h;
    EXPECT_LT(((right.position - left.position) / dt - state.velocity).norm() * h, 1e-6);
    EXPECT_LT(((right.velocity - left.velocity) / dt - state.acceleration).norm() * h * h, 1e-5);
    EXPECT_LT(((right.acceleration - left.acceleration) / dt - state.jerk).norm() * h * h * h, 1e-4);
    for (int end = 0; end < 2; ++end) {
      const MotionState at_end = evaluate_bezier(c, h, end);
      // From the end inwards; odd derivatives change sign when time runs backwards.
      const auto point = [&](int k) -> Eigen::Vector3d { return c.col(end == 0 ? k : 5 - k); };
      const double sign = end == 0 ? 1.0 : -1.0;
      EXPECT_EQ(at_end.position, point(0));
      EXPECT_LT((at_end.velocity - sign * 5 / h * (point(1) - point(0))).norm(), 1e-9 / h);
      EXPECT_LT((at_end.acceleration - 20 / (h * h) * (point(2) - 2 * point(1) + point(0))).norm(), 1e-9 / (h * h));
      EXPECT_LT((at_end.jerk - sign * 60 / (h * h * h) * (point(3) - 3 * point(2) + 3 * point(1) - point(0))).norm(),
                1e-9 / (h * h * h));
    }
  }
}

TEST(TrajectoryTest, WireRoundTripIsExact) {
  Rng rng(3);
  for (int trial = 0; trial < 200; ++trial) {
    const Trajectory trajectory =
        random_trajectory(rng, 1 + trial, kStart + Duration(trial), random_state(rng, 1e3, 9, 9), 1e3);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << trajectory);
    const sogm_swarm::trajectory_t sent = trajectory.to_wire();
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(sent.getEncodedSize()));
    ASSERT_EQ(sent.encode(bytes.data(), 0, static_cast<int>(bytes.size())), static_cast<int>(bytes.size()));
    sogm_swarm::trajectory_t received{};
    ASSERT_EQ(received.decode(bytes.data(), 0, static_cast<int>(bytes.size())), static_cast<int>(bytes.size()));
    const Trajectory back = Trajectory::from_wire(received);
    EXPECT_EQ(back.seq(), trajectory.seq());
    EXPECT_EQ(back.start_utime(), trajectory.start_utime());
    EXPECT_EQ(back.piece(), trajectory.piece());
    ASSERT_EQ(back.num_pieces(), trajectory.num_pieces());
    for (int i = 0; i <= Trajectory::kMaxPieces; ++i) {
      for (int j = 0; j < 9; ++j) {
        ASSERT_EQ(std::bit_cast<std::uint32_t>(received.knots[i][j]), std::bit_cast<std::uint32_t>(sent.knots[i][j]));
        if (i > trajectory.num_pieces()) {
          ASSERT_EQ(sent.knots[i][j], 0.0f) << "past the end";
        }
      }
    }
    for (int i = 0; i < 20; ++i) {
      const Utime t = kStart + uniform_duration(rng, -100ms, 4500ms);
      const MotionState a = trajectory.at(t), b = back.at(t);
      ASSERT_EQ(a.position, b.position) << to_us(t);
      ASSERT_EQ(a.velocity, b.velocity) << to_us(t);
      ASSERT_EQ(a.acceleration, b.acceleration) << to_us(t);
      ASSERT_EQ(a.jerk, b.jerk) << to_us(t);
    }
  }
  const Trajectory none = Trajectory::from_wire(Trajectory().to_wire());
  EXPECT_TRUE(none.empty());
  EXPECT_EQ(none.seq(), 0);
}

TEST(TrajectoryTest, KnotsAreRoundedToWhatTheWireCarries) {
  Rng rng(4);
  Trajectory trajectory(1, kStart, 200ms, Trajectory::kMaxPieces);
  for (int i = 0; i <= trajectory.num_pieces(); ++i) {
    const MotionState state = random_state(rng, 50, 3, 8);
    trajectory.set_knot(i, state);
    const MotionState knot = trajectory.knot(i);
    EXPECT_LT((knot.position - state.position).cwiseAbs().maxCoeff(), 0.51 / kStepsPerMetre);
    EXPECT_EQ(knot.jerk, Eigen::Vector3d::Zero());
    if (i == trajectory.num_pieces()) {
      EXPECT_EQ(knot.velocity, Eigen::Vector3d::Zero());  // it ends at rest
      EXPECT_EQ(knot.acceleration, Eigen::Vector3d::Zero());
    } else {
      EXPECT_LT((knot.velocity - state.velocity).cwiseAbs().maxCoeff(), 0.51 / kStepsPerMps);
      EXPECT_LT((knot.acceleration - state.acceleration).cwiseAbs().maxCoeff(), 0.51 / kStepsPerMps2);
    }
  }
  // What is rounded stays as it is, to the last bit, wherever it is.
  for (const double scale : {1.0, 100.0, 1e4, 1e5}) {
    MotionState state = random_state(rng, scale, 50, 500);
    trajectory.set_knot(0, state);
    const MotionState once = trajectory.knot(0);
    trajectory.set_knot(0, once);
    EXPECT_EQ(trajectory.knot(0).position, once.position);
    EXPECT_EQ(trajectory.knot(0).velocity, once.velocity);
    EXPECT_EQ(trajectory.knot(0).acceleration, once.acceleration);
  }
}

TEST(TrajectoryTest, BrakesToRestWithinTheLimit) {
  for (const double a_max_mps2 : {0.5, 6.0}) {
    const Eigen::Vector3d place(1, -2, 1.5), velocity(1.5, -0.3, -0.7);
    const Trajectory braking = Trajectory::braking(7, kStart, place, velocity, {.a_max_mps2 = a_max_mps2});
    EXPECT_EQ(braking.seq(), 7);
    EXPECT_LT((braking.at(kStart).position - place).norm(), 1e-6);
    EXPECT_LT((braking.at(kStart).velocity - velocity).norm(), 1e-6);
    double most_mps2 = 0.0, before_mps = velocity.norm() + 1e-6;
    for (Utime t = kStart; t <= braking.end_utime(); t += 5ms) {
      const MotionState state = braking.at(t);
      EXPECT_LE(state.velocity.norm(), before_mps);
      before_mps = state.velocity.norm() + 1e-6;
      most_mps2 = std::max(most_mps2, state.acceleration.cwiseAbs().maxCoeff());
    }
    EXPECT_NEAR(most_mps2, a_max_mps2, 0.01 * a_max_mps2);
    EXPECT_EQ(braking.at(braking.end_utime()).velocity, Eigen::Vector3d::Zero());
  }
  EXPECT_EQ(Trajectory::braking(1, kStart, {0, 0, 1}, {0, 0, 0}, {.a_max_mps2 = 6.0}).end_utime(), kStart + 100ms);
  EXPECT_EQ(Trajectory::braking(1, kStart, {0, 0, 1}, {100, 0, 0}, {.a_max_mps2 = 0.01}).end_utime(), kStart + 5s);
}

TEST(TrajectoryTest, ClampsBeforeTheStartAndHoversAfterTheEnd) {
  Rng rng(5);
  for (int trial = 0; trial < 100; ++trial) {
    const Trajectory trajectory = random_trajectory(rng, 1, kStart, random_state(rng, 5, 2, 5), 5);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << trajectory);
    for (const Duration before : {0us, 1us, 1000us, Duration(10s)}) {
      EXPECT_EQ(trajectory.at(kStart - before).position, trajectory.knot(0).position);
    }
    for (const Duration after : {0us, 1us, 1000us, Duration(1000s)}) {
      const MotionState state = trajectory.at(trajectory.end_utime() + after);
      EXPECT_EQ(state.position, trajectory.knot(trajectory.num_pieces()).position);
      EXPECT_EQ(state.velocity, Eigen::Vector3d::Zero());
      EXPECT_EQ(state.acceleration, Eigen::Vector3d::Zero());
      EXPECT_EQ(state.jerk, Eigen::Vector3d::Zero());
    }
  }
  const Eigen::Vector3d place(1, 2, 3);
  const Trajectory hover = Trajectory::hover(7, kStart, place);
  EXPECT_EQ(hover.seq(), 7);
  EXPECT_EQ(hover.start_utime(), kStart);
  for (const Duration t : {-5us, 0us, 50'001us, 99'999us, 100'000us, 200'000us}) {
    EXPECT_EQ(hover.at(kStart + t).position, place);
    EXPECT_EQ(hover.at(kStart + t).velocity, Eigen::Vector3d::Zero());
  }
}

TEST(TrajectoryTest, IsTwiceContinuouslyDifferentiableAtTheKnots) {
  Rng rng(6);
  for (int trial = 0; trial < 100; ++trial) {
    const Trajectory trajectory = random_trajectory(rng, 1, kStart, random_state(rng, 5, 2, 5), 5);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << trajectory);
    for (int i = 0; i <= trajectory.num_pieces(); ++i) {
      const Utime t = kStart + i * trajectory.piece();
      const MotionState knot = trajectory.knot(i);
      for (int side : {-1, 0, 1}) {
        const Utime beside = t + side * 1us;
        if (beside < kStart || beside > trajectory.end_utime()) continue;
        const MotionState state = trajectory.at(beside);
        EXPECT_LT((state.position - knot.position - side * 1e-6 * knot.velocity).norm(), 1e-10) << i << ' ' << side;
        EXPECT_LT((state.velocity - knot.velocity - side * 1e-6 * knot.acceleration).norm(), 1e-6) << i << ' ' << side;
        EXPECT_LT((state.acceleration - knot.acceleration).norm(), 2e-6 * (1.0 + state.jerk.norm()))
            << i << ' ' << side;
      }
    }
  }
}

std::vector<Utime> knot_times(const Trajectory& trajectory) {
  std::vector<Utime> times;
  for (int i = 0; i <= trajectory.num_pieces(); ++i) {
    times.push_back(trajectory.start_utime() + i * trajectory.piece());
  }
  return times;
}

TEST(MotionTest, NextKnotAfterListsExactlyTheKnotsInForce) {
  Rng rng(7);
  EXPECT_EQ(Trajectory().next_knot_after(kStart), kNever);
  for (int trial = 0; trial < 200; ++trial) {
    const Motion motion = random_motion(rng, kStart, 3);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", " << motion);
    std::vector<Utime> knots = knot_times(motion.committed);
    if (!motion.next.empty()) {
      const Utime leave = motion.next.start_utime();
      std::erase_if(knots, [&](Utime t) { return t >= leave; });
      for (const Utime t : knot_times(motion.next)) knots.push_back(t);
    }
    knots.push_back(kNever);
    EXPECT_EQ(motion.end_utime(), *(knots.rbegin() + 1));
    std::vector<Utime> queries;
    for (const Utime t : knots) {
      if (t != kNever) queries.insert(queries.end(), {t - 1us, t, t + 1us});
    }
    for (int i = 0; i < 50; ++i) queries.push_back(kStart + uniform_duration(rng, -500ms, 9s));
    for (const Utime t : queries) {
      ASSERT_EQ(motion.next_knot_after(t), *std::upper_bound(knots.begin(), knots.end() - 1, t))
          << (t - kStart).count();
    }
  }
}

TEST(MotionTest, SwitchesToNextExactlyAtItsStart) {
  Rng rng(8);
  for (int trial = 0; trial < 100; ++trial) {
    Motion motion;
    motion.committed = random_trajectory(rng, 1, kStart, random_state(rng, 3, 1, 3), 3);
    const Utime leave = kStart + uniform_duration(rng, 0us, 3s);
    motion.next = random_trajectory(rng, 2, leave, random_state(rng, 3, 1, 3), 3);  // elsewhere, to tell them apart
    for (int i = 0; i < 50; ++i) {
      const Utime t = i < 3 ? leave + (i - 1) * 1us : kStart + uniform_duration(rng, -100ms, 5s);
      const Trajectory& in_force = t >= leave ? motion.next : motion.committed;
      ASSERT_EQ(motion.at(t).position, in_force.at(t).position) << (t - leave).count() << " us after the switch\n"
                                                                << motion;
    }
  }
}

TEST(MotionTest, ControlPointsBetweenReproduceTheMotion) {
  Rng rng(9);
  for (int trial = 0; trial < 200; ++trial) {
    const Motion motion = random_motion(rng, kStart, 3);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", " << motion);
    const Utime end = motion.end_utime() + 300ms;
    for (Utime from = kStart; from < end;) {
      const Utime knot = std::min(motion.next_knot_after(from), end);
      const Utime to = uniform_int(rng, 0, 2) == 0 ? knot : from + 1us + (knot - from) * uniform_int(rng, 1, 9) / 10;
      const Utime stop = std::min(to, knot);
      const ControlPoints points = control_points_between(motion, from, stop);
      for (int i = 0; i < 8; ++i) {
        const Utime t = from + (stop - from) * i / 8;  // not the right end: there `next` may begin
        const double s = to_seconds(t - from) / to_seconds(stop - from);
        ASSERT_LT((evaluate_bezier(points, to_seconds(stop - from), s).position - motion.at(t).position).norm(), 1e-9)
            << "at " << (t - kStart).count() << " in [" << (from - kStart).count() << ", " << (stop - kStart).count()
            << "]";
      }
      ASSERT_LT((points.col(5) - motion.at(stop).position).norm(), 2e-4);  // rounded knots
      from = stop;
    }
  }
}

TEST(TrajectoryTest, PartsOfAQuinticAreTheSameCurve) {
  Rng rng(12);
  for (int trial = 0; trial < 200; ++trial) {
    const ControlPoints whole =
        quintic_control_points(random_state(rng, 10, 3, 8), random_state(rng, 10, 3, 8), uniform(rng, 0.05, 2.0));
    const double from = trial % 4 == 0 ? 0.0 : uniform(rng, 0.0, 0.9);
    const double to = trial % 3 == 0 ? 1.0 : uniform(rng, from + 0.01, 1.0);
    const ControlPoints part = part_of(whole, from, to);
    for (int i = 0; i <= 10; ++i) {
      const double s = 0.1 * i;
      ASSERT_LT((bezier_position(part, s) - bezier_position(whole, from + s * (to - from))).norm(), 1e-9)
          << "trial " << trial << ", [" << from << ", " << to << "] at " << s;
    }
  }
}

// A `next` that does not continue `committed` shows whether an interval up to the switch looks past it.
TEST(MotionTest, ControlPointsUpToTheSwitchBelongToCommitted) {
  Rng rng(10);
  for (int trial = 0; trial < 50; ++trial) {
    Motion motion;
    motion.committed = random_trajectory(rng, 1, kStart, random_state(rng, 3, 1, 3), 3);
    const Utime leave = kStart + uniform_duration(rng, 1us, 99'999us);  // in the first piece
    motion.next = random_trajectory(rng, 2, leave, random_state(rng, 3, 1, 3), 3);
    const ControlPoints before = control_points_between(motion, kStart, leave);
    const ControlPoints after = control_points_between(motion, leave, leave + 1ms);
    EXPECT_EQ(before.col(5), motion.committed.at(leave).position) << motion;
    EXPECT_EQ(after.col(0), motion.next.knot(0).position) << motion;
  }
}

}  // namespace
}  // namespace swarm
