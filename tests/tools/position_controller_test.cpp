// The position loop in front of attitude and thrust: which way is which, what limits it, and that a quadrotor in the
// wind follows through it.
#include "tools/bridge/position_controller.h"

#include <cmath>
#include <numbers>

#include "planner_daemon/trajectory/motion_limits.h"
#include "planner_daemon/trajectory/vehicle_fit.h"
#include "swarm_sim/environment/vehicle_model.h"
#include "tests/support/harness.h"
#include "tests/support/random_motion.h"

namespace swarm::test {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

const Vector3d kHover(0, 0, -MotionLimits::kGravity_mps2);  // north, east, down
constexpr double kQuarter = std::numbers::pi / 2, kThirty = std::numbers::pi / 6;

void expect_turn(const Vector3d& thrust, double yaw_rad, const Quaterniond& wanted) {
  EXPECT_LT(body_of(thrust, Vector3d::Zero(), yaw_rad, 0.0).turn.angularDistance(wanted), 1e-9)
      << thrust.transpose() << ", yaw " << yaw_rad;
}

TEST(BodyTarget, LeansToWhereItPushes) {
  const double lean = std::atan2(2.0, MotionLimits::kGravity_mps2);
  const Vector3d north(2, 0, 0), east(0, 2, 0);
  expect_turn(kHover, 0.0, Quaterniond::Identity());
  expect_turn(kHover, kQuarter, Quaterniond(AngleAxisd(kQuarter, Vector3d::UnitZ())));  // nose to the east
  expect_turn(kHover + north, 0.0, Quaterniond(AngleAxisd(-lean, Vector3d::UnitY())));  // nose down
  expect_turn(kHover + east, 0.0, Quaterniond(AngleAxisd(lean, Vector3d::UnitX())));    // right side down
  expect_turn(kHover + east, kQuarter, AngleAxisd(kQuarter, Vector3d::UnitZ()) * AngleAxisd(-lean, Vector3d::UnitY()));
  expect_turn(kHover - north, 2 * kQuarter,
              AngleAxisd(2 * kQuarter, Vector3d::UnitZ()) * AngleAxisd(-lean, Vector3d::UnitY()));
}

// The nose stays above its yaw, and the body pushes where it shall, whatever that is.
TEST(BodyTarget, PushesAlongItsAxisWithTheNoseAboveItsYaw) {
  Rng rng(5);
  for (int i = 0; i < 200; ++i) {
    const Vector3d thrust(uniform(rng, -6, 6), uniform(rng, -6, 6), uniform(rng, -15, -4));
    const Vector3d change(uniform(rng, -30, 30), uniform(rng, -30, 30), uniform(rng, -30, 30));
    const double yaw = uniform(rng, -3, 3), yaw_rate = uniform(rng, -2, 2);
    const BodyTarget body = body_of(thrust, change, yaw, yaw_rate);
    EXPECT_LT((body.turn * Vector3d::UnitZ() + thrust.normalized()).norm(), 1e-9);
    const Vector3d nose = body.turn * Vector3d::UnitX();
    EXPECT_NEAR(std::remainder(std::atan2(nose.y(), nose.x()) - yaw, 2 * std::numbers::pi), 0.0, 1e-9);
    // Its rates carry it to what it shall be a moment later.
    constexpr double kLater_s = 1e-3;
    const BodyTarget later = body_of(thrust + kLater_s * change, change, yaw + kLater_s * yaw_rate, yaw_rate);
    const double angle = body.rates.norm() * kLater_s;
    const Quaterniond carried =
        body.turn * Quaterniond(AngleAxisd(angle, angle > 0.0 ? body.rates.normalized() : Vector3d::UnitX()));
    EXPECT_LT(carried.angularDistance(later.turn), 0.02 * angle + 1e-6);
  }
}

MotionState resting_at(const Vector3d& position, const Vector3d& velocity = Vector3d::Zero()) {
  MotionState state;
  state.position = position;
  state.velocity = velocity;
  return state;
}

TEST(PositionController, PushesAgainstWhatIsAmiss) {
  PositionController controller({.position_per_s2 = 5, .velocity_per_s = 3, .integral_per_s3 = 0});
  const Vector3d thrust =
      controller.thrust(resting_at({0.2, 0, 1}, {0, 0.5, 0}), {0, 0, 1}, resting_at({0, 0, 1.1}, {0, 0, 0.1}), 0.01);
  EXPECT_LT((thrust - Vector3d(1.0, 1.5, 9.81 + 1 - 0.5 - 0.3)).norm(), 1e-12);
}

TEST(PositionController, KeepsToTiltAndThrust) {
  Rng rng(6);
  const PositionGains gains{.tilt_max_deg = 30, .hover_thrust = 0.6};
  PositionController controller(gains);
  for (int i = 0; i < 500; ++i) {
    const auto any = [&](double most) {
      return Vector3d(uniform(rng, -most, most), uniform(rng, -most, most), uniform(rng, -most, most));
    };
    const Vector3d thrust =
        controller.thrust(resting_at(any(3), any(5)), any(10), resting_at(any(3), any(5)), uniform(rng, 0, 0.05));
    EXPECT_LE(std::atan2(thrust.head<2>().norm(), thrust.z()), kThirty + 1e-9);
    EXPECT_LE(thrust.norm(), 9.81 / 0.6 + 1e-9);
    EXPECT_GT(thrust.z(), 1.0);
  }
}

// The integral finds a steady wind, but does not wind up while the robot cannot do more, nor beyond its bound.
TEST(PositionController, TheIntegralIsBounded) {
  PositionController controller({.position_per_s2 = 1, .velocity_per_s = 1, .integral_per_s3 = 1, .tilt_max_deg = 15});
  const auto push = [&](double amiss_m) {
    return controller.thrust(resting_at({amiss_m, 0, 0}), Vector3d::Zero(), resting_at({0, 0, 0}), 0.01).x();
  };
  EXPECT_NEAR(push(0.1), 0.101, 1e-9);
  for (int i = 0; i < 1000; ++i) (void)push(0.1);
  EXPECT_NEAR(push(0.0), 1.001, 1e-9);
  for (int i = 0; i < 100'000; ++i) (void)push(1.0);
  const double most = std::tan(kThirty / 2) * 9.81;
  EXPECT_NEAR(push(1.0), most, 1e-9);
  EXPECT_LE(push(0.0), most - 1.0 + 0.02);
  controller.reset();
  EXPECT_NEAR(push(0.0), 0.0, 1e-12);

  controller = PositionController({.position_per_s2 = 1, .velocity_per_s = 1, .integral_per_s3 = 1});
  for (int i = 0; i < 10'000; ++i) (void)push(0.1);
  EXPECT_NEAR(push(0.0), 4.0, 1e-9);
}

// From far away it comes at a speed that does not depend on how far that is.
TEST(PositionController, ComesFromFarAwayGently) {
  for (const double away_m : {3.0, 30.0}) {
    const auto vehicle = make_quadrotor(QuadrotorBody(), {.kind = "quadrotor"}, {0, 0, 1}, 1, 1);
    PositionController controller{PositionGains()};
    MotionState is = resting_at({0, 0, 1});
    double fastest_mps = 0.0;
    for (int i = 0; i < 800; ++i) {
      is = vehicle->push(controller.thrust(resting_at({away_m, 0, 1}), Vector3d::Zero(), is, VehicleModel::kStep_s));
      fastest_mps = std::max(fastest_mps, is.velocity.norm());
    }
    EXPECT_LT(fastest_mps, 2.5) << away_m;
    EXPECT_GT(is.position.x(), std::min(away_m - 0.5, 8.0)) << away_m;
    EXPECT_NEAR(is.position.z(), 1.0, 0.3);
  }
}

// A quadrotor in 3 m/s of wind, whose state comes at 50 Hz and whose thrust is a tenth less than it is taken for, on a
// circle of 1.5 m at 2 m/s: what lags is made up for, what is steady is found.
TEST(PositionController, AQuadrotorInTheWindFollowsThroughIt) {
  const auto vehicle = make_quadrotor(QuadrotorBody(), {.kind = "quadrotor", .wind_mps = 3.0}, {1.5, 0, 1}, 1, 1);
  PositionController controller{PositionGains()};
  const VehicleFit fit{0.03, 0.07, 0.3};
  const auto wanted_at = [](double t_s) {
    const double speed = std::min(2.0, 0.5 * t_s), angle = t_s < 4 ? 0.25 * t_s * t_s / 1.5 : (4 + 2 * (t_s - 4)) / 1.5;
    const double rate = speed / 1.5, c = std::cos(angle), s = std::sin(angle), growth = t_s < 4 ? 0.5 : 0.0;
    MotionState state = resting_at({1.5 * c, 1.5 * s, 1}, speed * Vector3d(-s, c, 0));
    state.acceleration = growth * Vector3d(-s, c, 0) - speed * rate * Vector3d(c, s, 0);
    state.jerk = speed * rate * rate * Vector3d(s, -c, 0);
    return state;
  };
  MotionState is = wanted_at(0), heard = is;
  double heard_s = 0.0;
  std::vector<double> off_m;
  for (int i = 0; i < 2400; ++i) {
    const double t_s = i * VehicleModel::kStep_s;
    if (i % 2 == 0) heard = resting_at(is.position, is.velocity), heard_s = t_s;
    const MotionState wanted = wanted_at(t_s);
    heard.acceleration = wanted.acceleration;
    const Vector3d thrust = controller.thrust(wanted, fitted(wanted, fit).acceleration,
                                              fitted(heard, {t_s - heard_s, 0.0, 0.0}), VehicleModel::kStep_s);
    is = vehicle->push(0.9 * thrust);
    if (t_s > 8.0) off_m.push_back((is.position - wanted_at(t_s + VehicleModel::kStep_s).position).norm());
  }
  std::sort(off_m.begin(), off_m.end());
  EXPECT_LT(off_m[off_m.size() / 2], 0.04);
  EXPECT_LT(off_m[off_m.size() * 99 / 100], 0.09);
}

}  // namespace
}  // namespace swarm::test
