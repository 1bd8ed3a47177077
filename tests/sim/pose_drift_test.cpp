// Robots whose odometry drifts: truth, what they take for it, and what flights come to by it.
#include "swarm_sim/environment/pose_drift.h"

#include <gtest/gtest.h>

#include <fstream>

#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "swarm_sim/environment/vehicle.h"
#include "swarm_sim/world/imperfections.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

constexpr double kQuarter = 0.7071067811865476;

// Drifts by 0.1 m/s along x for 20 s, then turns by a quarter within 10 s.
std::string write_drift(const TemporaryDirectory& directory) {
  const std::string path = (directory.path() / "drift.txt").string();
  std::ofstream(path) << "0 1 2 0 0 0 0 1\n20 3 2 0 0 0 0 1\n30 3 2 0 0 0 " << kQuarter << ' ' << kQuarter << '\n';
  return path;
}

TEST(PoseDrift, CountsFromWhereItBegins) {
  const TemporaryDirectory directory;
  const std::string path = write_drift(directory);
  bool differs = false;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const PoseDrift drift(path, seed);
    for (const double t_s : {-1.0, 0.0}) {
      EXPECT_EQ(drift.at(t_s).position, Eigen::Vector3d::Zero());
      EXPECT_EQ(drift.at(t_s).orientation.coeffs(), Eigen::Quaterniond::Identity().coeffs());
    }
    differs |= (drift.at(1.0).position - PoseDrift(path, 100).at(1.0).position).norm() > 1e-3;
    EXPECT_EQ(drift.at(7.0).position, PoseDrift(path, seed).at(7.0).position);
    // It stays after the end, by the whole quarter if it began before that.
    EXPECT_EQ(drift.at(31.0).position, drift.at(300.0).position);
  }
  EXPECT_TRUE(differs);
}

TEST(PoseDrift, TruthIsWhatIsTakenForTheBelievedState) {
  const TemporaryDirectory directory;
  const PoseDrift drift(write_drift(directory), 3);
  MotionState believed;
  believed.position = {4, -1, 1.5};
  believed.velocity = {0.3, 1.1, -0.2};
  believed.acceleration = {1, 2, 3};
  for (const double t_s : {0.0, 0.4, 3.0, 11.0, 18.0, 25.0, 40.0}) {
    const MotionState truth = drift.truth_of(believed, t_s);
    const Pose at = drift.at(t_s);
    EXPECT_LT((at.orientation * truth.position + at.position - believed.position).norm(), 1e-12) << t_s;
    EXPECT_LT((at.orientation * truth.acceleration - believed.acceleration).norm(), 1e-12) << t_s;
    // Whoever believes to move on at that velocity truly moves so.
    const double h_s = 1e-3;
    MotionState before = believed;
    before.position -= h_s * believed.velocity;
    const Eigen::Vector3d moved = truth.position - drift.truth_of(before, t_s - h_s).position;
    EXPECT_LT((moved / h_s - truth.velocity).norm(), 0.02) << t_s;
  }
}

TEST(PoseDrift, FilesAreChecked) {
  const TemporaryDirectory directory;
  EXPECT_NO_THROW(check_pose_drift(""));
  EXPECT_NO_THROW(check_pose_drift(write_drift(directory)));
  const std::string bad = (directory.path() / "bad.txt").string();
  std::ofstream(bad) << "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 2\n";
  for (const std::string& path : {bad, directory.path().string(), bad + ".none"}) {
    try {
      check_pose_drift(path);
      ADD_FAILURE() << path;
    } catch (const OptionError& error) {
      EXPECT_EQ(std::string(error.what()).find("must be a file of poses; " + path), 0u) << error.what();
    }
  }
}

// It flies where it is told in its own frame, and truly elsewhere.
TEST(PoseDrift, VehiclesFlyInTheFrameOfTheirOdometry) {
  const TemporaryDirectory directory;
  const PoseDrift drift(write_drift(directory), 3);
  const Eigen::Vector3d place(0, 0, 1);
  for (const char* kind : {"perfect", "quadrotor"}) {
    Vehicle vehicle(3, place, {}, {.kind = kind}, "pose_drift_test", drift);
    sogm_swarm::setpoint_t setpoint{};
    Eigen::Map<Eigen::Vector3d>(setpoint.position) = place;
    for (int k = 0; k < 1200; ++k) {
      const Utime now = kStart + k * 10ms;
      if (k % 2 == 0) {
        setpoint.header = make_header(3, 1, k, now);
        vehicle.on_setpoint(now, encoded(setpoint));
      }
      vehicle.move_to(now, 0.01 * (k - 200));
      if (k == 199) {
        EXPECT_LT((vehicle.state().position - place).norm(), 1e-6) << kind;
      }
    }
    EXPECT_LT((vehicle.estimate().position - place).norm(), 1e-3) << kind;
    const Pose at = vehicle.drifted();
    EXPECT_GT(at.position.norm(), 0.3);
    EXPECT_LT((at.orientation * vehicle.state().position + at.position - place).norm(), 1e-3) << kind;
  }
}

}  // namespace
}  // namespace swarm::test
