// From the onboard bus to ROS 2: paths, the map, and commands, which go on while there are no setpoints.
#include "lcmtypes/bus/channels.h"
#include "map_daemon/sogm_codec.h"
#include "tests/support/ros2_bridge.h"
#include "tools/ros2/ros2_log.h"

namespace swarm::test {
namespace {

using geometry_msgs::msg::PoseStamped;
using nav_msgs::msg::Path;
using sensor_msgs::msg::PointCloud2;
using trajectory_msgs::msg::MultiDOFJointTrajectory;

TEST(Ros2Commands, CommittedTrajectoriesArePaths) {
  RosBridge bridge;
  MotionState start;
  start.position = {0, 0, 1};
  const Trajectory own = quintic_to(start, bridge.now, {2, 0, 1}, 1.05);
  const Trajectory peers = Trajectory::hover(1, bridge.now, {5, 5, 1});
  bridge.send(channel::kOwnTrajectory, bridge.announcement_of(3, own));
  bridge.send(channel::kPeerTrajectory, bridge.announcement_of(7, peers));
  bridge.send(channel::kPeerTrajectory, bridge.announcement_of(3, own));  // that is no peer
  EXPECT_EQ(bridge.node.report().refused_from_bus[Refusal::kRobot], 1);
  ASSERT_EQ(bridge.paths[3].size(), 1u);
  ASSERT_EQ(bridge.paths[7].size(), 1u);
  const Path& path = bridge.paths[3][0];
  EXPECT_EQ(path.header.frame_id, "world");
  ASSERT_EQ(path.poses.size(), 12u);  // every 0.1 s, and the end
  for (const PoseStamped& pose : path.poses) {
    const Utime utime = utime_of(pose.header.stamp);
    EXPECT_LT((vector_of(pose.pose.position) - own.at(utime).position).norm(), 1e-9);
  }
  EXPECT_EQ(utime_of(path.poses.back().header.stamp), own.end_utime());
  EXPECT_LT((vector_of(bridge.paths[7][0].poses.back().pose.position) - Eigen::Vector3d(5, 5, 1)).norm(), 1e-6);
  // To be looked at: five times a second are enough.
  for (int i = 0; i < 100; ++i) {
    bridge.run_for(0.01);
    bridge.send(channel::kOwnTrajectory, bridge.announcement_of(3, own));
  }
  EXPECT_EQ(bridge.paths[3].size(), 6u);
}

TEST(Ros2Commands, PathsBeginAndEndWithTheirTrajectories) {
  RosBridge bridge;
  MotionState start;
  start.position = {0, 0, 1};
  const Trajectory trajectory = quintic_to(start, bridge.now, {2, 0, 1}, 1.05);
  auto early = bridge.announcement_of(7, trajectory), wrong = bridge.announcement_of(8, trajectory);
  early.header.utime -= 8'950'000;  // it ends 10 s later
  wrong.header.utime -= 8'950'001;
  bridge.send(channel::kPeerTrajectory, early);
  bridge.send(channel::kPeerTrajectory, wrong);
  ASSERT_EQ(bridge.paths[7].size(), 1u);
  ASSERT_EQ(bridge.paths[7][0].poses.size(), 12u);
  EXPECT_EQ(utime_of(bridge.paths[7][0].poses[0].header.stamp), trajectory.start_utime());
  EXPECT_TRUE(bridge.paths[8].empty());
  EXPECT_EQ(bridge.node.report().refused_from_bus[Refusal::kInconsistent], 1);
}

TEST(Ros2Commands, WhatRosDoesNotTakeIsCountedAndSaidOnceInTenSeconds) {
  RosBridge bridge;
  Ros2Log log;
  bridge.failure = "command/trajectory: it is broken";
  std::vector<std::string> warnings;
  for (int i = 0; i < 150; ++i) {
    bridge.send(channel::kSetpoint, bridge.setpoint_of(MotionState(), 0.0));
    for (const LogLine& line : log.update(bridge.now, bridge.node.report())) {
      if (line.warning) warnings.push_back(line.text);
    }
    bridge.now += 100ms;  // before anything is missed
  }
  EXPECT_EQ(warnings, (std::vector<std::string>{
                          "1 messages not published; the newest: command/trajectory: it is broken",
                          "100 messages not published; the newest: command/trajectory: it is broken",
                      }));
  EXPECT_EQ(bridge.node.report().commands, 0);
  bridge.failure = "";
  bridge.send(channel::kSetpoint, bridge.setpoint_of(MotionState(), 0.0));
  EXPECT_EQ(bridge.node.report().commands, 1);
  EXPECT_EQ(bridge.node.report().unpublished, 150);
}

TEST(Ros2Commands, TheMapsOccupiedVoxelsAreACloud) {
  RosBridge bridge;
  Sogm sogm;
  GridGeometry geometry;
  geometry.origin = {-10, -20, 0};
  geometry.size = {20, 30, 70};
  sogm.reset(geometry, 3, bridge.now, 100ms);
  const std::vector<Eigen::Vector3i> voxels = {{0, 0, 0}, {7, 8, 63}, {7, 8, 64}, {19, 29, 69}};
  for (const Eigen::Vector3i& v : voxels) sogm.column(0, v.x(), v.y())[v.z() / 64] |= std::uint64_t{1} << (v.z() % 64);
  sogm.column(1, 5, 5)[0] = 1;  // later
  SogmEncoder encoder;
  for (const sogm_swarm::sogm_t& part : encoder.encode(sogm, make_header(3, 1, 0, bridge.now)))
    bridge.send(channel::kSogm, part);
  ASSERT_EQ(bridge.clouds.size(), 1u);
  const PointCloud2& cloud = bridge.clouds[0];
  EXPECT_EQ(cloud.header.frame_id, "world");
  EXPECT_EQ(utime_of(cloud.header.stamp), bridge.now);
  const std::vector<Eigen::Vector3d> points = points_of(cloud);
  ASSERT_EQ(points.size(), voxels.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    EXPECT_LT((points[i] - geometry.center_of(voxels[i])).norm(), 1e-6) << i;
}

// The broadcast daemon lives: setpoints at 100 Hz, announcements at 20 Hz, by a clock that is `ahead` of the bridge's.
void fly(RosBridge& bridge, const Trajectory& trajectory, double seconds, Duration ahead = {}) {
  for (int i = 0; i < std::lround(100 * seconds); ++i) {
    auto announcement = bridge.announcement_of(3, trajectory);
    auto setpoint = bridge.setpoint_of(trajectory.at(bridge.now + ahead), 0.5);
    setpoint.header.utime += ahead.count();
    announcement.header.utime += ahead.count();
    if (i % 5 == 0) bridge.send(channel::kOwnTrajectory, announcement);
    bridge.send(channel::kSetpoint, setpoint);
    bridge.run_for(0.01);
  }
}

// That commands from the `first` on say what the trajectory does at their stamps, by a clock that is `ahead`.
void expect_follows(const RosBridge& bridge, std::size_t first, const Trajectory& trajectory, Duration ahead = {}) {
  for (std::size_t i = first; i < bridge.commands.size(); ++i) {
    const auto& point = bridge.commands[i].points.at(0);
    const MotionState wanted = trajectory.at(utime_of(bridge.commands[i].header.stamp) + ahead);
    EXPECT_LT((vector_of(point.transforms.at(0).translation) - wanted.position).norm(), 1e-6) << i;
    EXPECT_LT((vector_of(point.velocities.at(0).linear) - wanted.velocity).norm(), 1e-6) << i;
    EXPECT_LT((vector_of(point.accelerations.at(0).linear) - wanted.acceleration).norm(), 1e-6) << i;
  }
}

TEST(Ros2Commands, SetpointsAreCommands) {
  RosBridge bridge;
  MotionState state;
  state.position = {1, 2, 3};
  state.velocity = {0.1, 0.2, 0.3};
  state.acceleration = {-1, -2, -3};
  const auto setpoint = bridge.setpoint_of(state, 1.0);
  bridge.send(channel::kSetpoint, setpoint);
  bridge.send(channel::kSetpoint, setpoint);  // a duplicate
  EXPECT_EQ(bridge.node.report().refused_from_bus[Refusal::kSequence], 1);
  ASSERT_EQ(bridge.commands.size(), 1u);
  const MultiDOFJointTrajectory& command = bridge.commands[0];
  EXPECT_EQ(command.header.frame_id, "world");
  EXPECT_EQ(utime_of(command.header.stamp), bridge.now);
  EXPECT_EQ(command.joint_names, std::vector<std::string>{"base_link"});
  const auto& point = command.points.at(0);
  EXPECT_EQ(vector_of(point.transforms.at(0).translation), state.position);
  EXPECT_NEAR(point.transforms[0].rotation.z, std::sin(0.5), 1e-12);
  EXPECT_NEAR(point.transforms[0].rotation.w, std::cos(0.5), 1e-12);
  EXPECT_EQ(vector_of(point.velocities.at(0).linear), state.velocity);
  EXPECT_EQ(point.velocities[0].angular.z, 0.25);
  EXPECT_EQ(vector_of(point.accelerations.at(0).linear), state.acceleration);
  // Nothing more is said of what nobody is bound to.
  bridge.run_for(1.0);
  EXPECT_EQ(bridge.commands.size(), 1u);
}

TEST(Ros2Commands, TheTrajectoryIsFollowedWithoutSetpoints) {
  RosBridge bridge;
  MotionState start;
  start.position = {0, 0, 1};
  const Trajectory trajectory = quintic_to(start, bridge.now, {3, 0, 1}, 2.0);
  fly(bridge, trajectory, 0.5);
  EXPECT_FALSE(bridge.node.report().is_silent);
  const std::size_t heard = bridge.commands.size();
  EXPECT_EQ(heard, 50u);
  bridge.run_for(0.2);
  EXPECT_TRUE(bridge.node.report().is_silent);
  EXPECT_NEAR(static_cast<double>(bridge.commands.size() - heard), 16, 1);  // after 50 ms, every 10 ms
  // A setpoint that was long on its way does not lead back, but says that there are some again.
  const std::size_t sampled = bridge.commands.size();
  auto late = bridge.setpoint_of(trajectory.at(bridge.now - 20ms), 0.5);
  late.header.utime -= 20'000;
  bridge.send(channel::kSetpoint, late);
  EXPECT_EQ(bridge.commands.size(), sampled);
  EXPECT_FALSE(bridge.node.report().is_silent);
  bridge.run_for(0.01);
  fly(bridge, trajectory, 0.2);
  bridge.run_for(4.0);
  expect_follows(bridge, 0, trajectory);
  const Utime last = utime_of(bridge.commands.back().header.stamp);
  EXPECT_NEAR(to_seconds(last - trajectory.end_utime()), 1.0, 0.011);  // the place of rest for a second more
}

TEST(Ros2Commands, ABroadcasterThatKeepsItsTimeIsFollowedByThat) {
  RosBridge bridge;
  MotionState start;
  start.position = {0, 0, 1};
  const Trajectory trajectory = quintic_to(start, bridge.now, {3, 0, 1}, 3.0);
  fly(bridge, trajectory, 0.5);
  bridge.wall_ahead = 5s;
  bridge.step();
  bridge.run_for(0.3);  // without setpoints
  fly(bridge, trajectory, 0.3, -5s);
  bridge.run_for(0.3);
  expect_follows(bridge, 50, trajectory, -5s);
  EXPECT_GT(bridge.commands.size(), 120u);
  EXPECT_EQ(bridge.node.report().refused_from_bus.total(), 0);
}

}  // namespace
}  // namespace swarm::test
