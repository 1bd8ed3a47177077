// From ROS 2 to the onboard bus: the robot's state, goals, obstacles, and what is refused of them.
#include <numbers>

#include "lcmtypes/bus/channels.h"
#include "tests/support/ros2_bridge.h"
#include "tools/ros2/ros2_log.h"

namespace swarm::test {
namespace {

using geometry_msgs::msg::PoseStamped;
using nav_msgs::msg::Odometry;
using sogm_swarm::obstacle_t;
using sogm_swarm::obstacles_t;
using sogm_swarm::robot_state_t;
using visualization_msgs::msg::Marker;

TEST(Ros2Bridge, OdometryIsTheRobotsState) {
  RosBridge bridge;
  Odometry odometry = bridge.odometry_at({1, -2, 3}, rotated(0.1, -0.2, 2.5), {1.0, 0.5, 0.0});
  bridge.hear(odometry);
  auto state = bridge.out.newest<robot_state_t>(channel::kRobotState);
  EXPECT_EQ(state.header.robot_id, 3);
  EXPECT_EQ(to_utime(state.header.utime), bridge.now);
  EXPECT_EQ(Eigen::Vector3d(state.position), Eigen::Vector3d(1, -2, 3));
  const Eigen::Vector3d turned_velocity = rotated(0.1, -0.2, 2.5) * Eigen::Vector3d(1.0, 0.5, 0.0);
  EXPECT_LT((Eigen::Vector3d(state.velocity) - turned_velocity).norm(), 1e-12);  // the twist was the body's
  EXPECT_NEAR(state.yaw, 2.5, 1e-12);

  bridge.run_for(0.01);
  odometry.header.stamp = stamp_of(bridge.now);
  odometry.child_frame_id = "world";
  bridge.hear(odometry);
  state = bridge.out.newest<robot_state_t>(channel::kRobotState);
  EXPECT_EQ(Eigen::Vector3d(state.velocity), Eigen::Vector3d(1.0, 0.5, 0.0));
  EXPECT_EQ(utime_of(stamp_of(kStart + 123'456us)), kStart + 123'456us);
  EXPECT_EQ(bridge.node.report().states, 2);

  Ros2Config silent = config_of_robot_3();
  silent.publish_state = false;
  RosBridge other(silent);
  other.hear(other.odometry_at({1, 2, 3}, rotated(0, 0, 0)));
  EXPECT_EQ(other.out.count(channel::kRobotState), 0);
}

TEST(Ros2Bridge, RefusesWhatCannotBe) {
  RosBridge bridge;
  const Odometry good = bridge.odometry_at({1, 2, 3}, rotated(0, 0, 1));
  Odometry bad = good;
  bad.header.frame_id = "odom";
  bridge.expect_refused(bad, RosRefusal::kFrame, "odometry: frame_id 'odom': must be 'world'");
  bad = good;
  bad.pose.pose.position.y = kNoNumber;
  bridge.expect_refused(bad, RosRefusal::kValue, "odometry: position");
  bad = good;
  bad.twist.twist.linear.z = 101.0;
  bridge.expect_refused(bad, RosRefusal::kValue, "odometry: velocity [0,0,101]: must be within 100");
  for (const double w : {0.0, 2.0, kNoNumber}) {
    bad = good;
    bad.pose.pose.orientation.w = w;
    bridge.expect_refused(bad, RosRefusal::kQuaternion, "must have length 1");
  }
  bad = good;
  bad.header.stamp = stamp_of(bridge.now - 1100ms);
  bridge.expect_refused(bad, RosRefusal::kTime, "stamp is 1100 ms old");
  bad.header.stamp = stamp_of(bridge.now + 150ms);
  bridge.expect_refused(bad, RosRefusal::kTime, "stamp is -150 ms old");
  bridge.hear(good);
  EXPECT_EQ(bridge.node.report().states, 1);
  bridge.expect_refused(good, RosRefusal::kOrder, "must be later than the one before");

  // A clock that is set back does not make it wait for the time that was before.
  bridge.wall_ahead = -10s;
  bridge.step();
  bridge.hear(bridge.odometry_at({1, 2, 3}, rotated(0, 0, 1)));
  EXPECT_EQ(bridge.node.report().states, 2);
}

TEST(Ros2Bridge, WhatIsRefusedIsSaidOnceInTenSeconds) {
  RosBridge bridge;
  Ros2Log log;
  std::vector<std::string> warnings;
  for (int i = 0; i < 150; ++i) {
    Odometry odometry = bridge.odometry_at({1, 2, 3}, rotated(0, 0, 1));
    odometry.header.frame_id = "map";
    bridge.hear(odometry);
    for (const LogLine& line : log.update(bridge.now, bridge.node.report())) {
      if (line.warning) warnings.push_back(line.text);
    }
    bridge.run_for(0.1);
  }
  EXPECT_EQ(warnings,
            (std::vector<std::string>{"1 messages refused; the newest: odometry: frame_id 'map': must be 'world'",
                                      "100 messages refused; the newest: odometry: frame_id 'map': must be 'world'"}));
}

TEST(Ros2Bridge, AGoalHoldsFromWhenItIsHeard) {
  RosBridge bridge;
  PoseStamped goal;
  goal.header.frame_id = "world";
  put(Eigen::Vector3d(4, 5, 1.5), &goal.pose.position);
  bridge.node.on_goal(bridge.now, goal, bridge.out);  // its stamp is 0
  const auto told = bridge.out.newest<sogm_swarm::goal_t>(channel::kGoal);
  EXPECT_EQ(to_utime(told.header.utime), bridge.now);
  ASSERT_EQ(told.num_waypoints, 1);
  EXPECT_EQ(Eigen::Vector3d(told.waypoints[0].position), Eigen::Vector3d(4, 5, 1.5));
  EXPECT_EQ(told.waypoints[0].tolerance, 0.0);
  goal.header.frame_id = "";
  bridge.node.on_goal(bridge.now, goal, bridge.out);
  EXPECT_EQ(bridge.refused(RosRefusal::kFrame), 1);
  EXPECT_EQ(bridge.node.report().goals, 1);
}

TEST(Ros2Bridge, AGoalIsNewerThanThoseOfOtherSenders) {
  RosBridge bridge;
  SequenceGate planner;
  PoseStamped pose;
  pose.header.frame_id = "world";
  const auto own = [&] {
    bridge.node.on_goal(bridge.now, pose, bridge.out);
    const auto goal = bridge.out.newest<sogm_swarm::goal_t>(channel::kGoal);
    bridge.send(channel::kGoal, goal);  // it hears itself
    EXPECT_EQ(planner.pass(goal.header), Refusal::kNone);
    return goal.header;
  };
  const auto others = [&](int robot_id, std::int32_t boot, std::int64_t seq) {
    sogm_swarm::goal_t goal{};
    goal.header = make_header(robot_id, boot, seq, bridge.now);
    goal.num_waypoints = 1;
    goal.waypoints.resize(1);
    bridge.send(channel::kGoal, goal);
    return planner.pass(goal.header);
  };
  const std::int32_t boot = 1'700'000'000;
  EXPECT_EQ(own().boot, boot);
  EXPECT_EQ(others(3, boot + 100, 7), Refusal::kNone);
  EXPECT_EQ(own().boot, boot + 101);
  EXPECT_EQ(others(3, boot + 100, 8), Refusal::kSequence);  // the other one says again what no longer holds
  const sogm_swarm::header_t second = own();
  EXPECT_EQ(second.boot, boot + 101);
  EXPECT_EQ(second.seq, 1);
  EXPECT_EQ(others(3, boot + 101, 2), Refusal::kNone);  // begun at the same time
  EXPECT_EQ(own().boot, boot + 102);
  (void)others(4, boot + 200, 0);  // of another robot
  EXPECT_EQ(bridge.node.report().refused_from_bus[Refusal::kRobot], 1);
  bridge.node.on_goal(bridge.now, pose, bridge.out);
  EXPECT_EQ(bridge.out.newest<sogm_swarm::goal_t>(channel::kGoal).header.boot, boot + 102);
  EXPECT_EQ(bridge.node.report().refused_from_bus.total(), 1);
}

TEST(Ros2Bridge, MarkersAreObstacles) {
  RosBridge bridge;
  std::vector<Marker> markers = {
      marker_at(Marker::CYLINDER, {1, 2, 0.9}, {0.5, 0.6, 1.8}, bridge.now - 20ms),
      marker_at(Marker::CUBE, {3, 0, 1}, {2, 0.5, 1}, bridge.now),
      marker_at(Marker::SPHERE, {0, 3, 1}, {0.3, 0.4, 0.2}, bridge.now),
      marker_at(Marker::CYLINDER, {5, 0, 1}, {0.2, 0.2, 3}, bridge.now),  // lies along y
      marker_at(Marker::TEXT_VIEW_FACING, {5, 0, 1}, {1, 1, 1}, bridge.now),
      marker_at(Marker::ARROW, {0, 0, 0}, {0.05, 0.1, 0.1}, bridge.now),
  };
  for (int i = 0; i < 5; ++i) markers[i].id = i;
  markers[1].pose = pose_at({3, 0, 1}, rotated(0, 0, 0.7));
  markers[3].pose = pose_at({5, 0, 1}, rotated(std::numbers::pi / 2, 0, 0));
  markers[5].ns = "people/velocity";  // of the first one
  markers[5].points.resize(2);
  put(Eigen::Vector3d(1, 2, 0.9), &markers[5].points[0]);
  put(Eigen::Vector3d(2, 2, 0.9), &markers[5].points[1]);
  markers[5].pose = pose_at({0, 0, 0}, rotated(0, 0, std::numbers::pi / 2));
  bridge.hear(markers);
  auto message = bridge.out.newest<obstacles_t>(channel::kObstacles);
  EXPECT_EQ(to_utime(message.header.utime), bridge.now);
  EXPECT_EQ(message.complete, 0);
  EXPECT_EQ(bridge.node.report().passed_over, 1);
  ASSERT_EQ(message.num_obstacles, 4);
  const std::vector<obstacle_t>& found = message.obstacles;  // by name: in the order of their ids
  EXPECT_EQ(found[0].shape, obstacle_t::kColumn);
  EXPECT_EQ(Eigen::Vector3d(found[0].position), Eigen::Vector3d(1, 2, 0.9));
  EXPECT_EQ(Eigen::Vector3d(found[0].size), Eigen::Vector3d(0.6, 1.8, 0));
  EXPECT_LT((Eigen::Vector3d(found[0].velocity) - Eigen::Vector3d(0, 1, 0)).norm(), 1e-12);
  EXPECT_NEAR(found[0].velocity_sigma, 0.2, 1e-6);
  EXPECT_NEAR(found[0].age_s, 0.02, 1e-9);
  EXPECT_EQ(found[1].shape, obstacle_t::kBox);
  EXPECT_NEAR(found[1].yaw, 0.7, 1e-12);
  EXPECT_LT((Eigen::Vector3d(found[1].size) - Eigen::Vector3d(2, 0.5, 1)).norm(), 1e-12);
  EXPECT_EQ(found[1].velocity_sigma, -1.0f);
  EXPECT_NEAR(found[1].position_sigma, 0.05, 1e-6);
  EXPECT_EQ(found[2].shape, obstacle_t::kSphere);
  EXPECT_EQ(found[2].size[0], 0.4);
  EXPECT_EQ(found[3].shape, obstacle_t::kBox);
  EXPECT_LT((Eigen::Vector3d(found[3].size) - Eigen::Vector3d(0.2, 3, 0.2)).norm(), 1e-12);

  // The same markers have the same ids; one that is added and deleted again is not there; DELETEALL: all is told.
  bridge.run_for(0.1);
  std::vector<Marker> again = {Marker(), markers[0], markers[1], markers[1]};
  again[0].action = Marker::DELETEALL;
  again[3].action = Marker::DELETE;
  for (Marker& marker : again) marker.header.stamp = stamp_of(bridge.now);
  bridge.hear(again);
  message = bridge.out.newest<obstacles_t>(channel::kObstacles);
  EXPECT_EQ(message.complete, 1);
  ASSERT_EQ(message.num_obstacles, 1);
  EXPECT_EQ(message.obstacles[0].id, found[0].id);
  EXPECT_EQ(message.obstacles[0].velocity_sigma, -1.0f);

  bridge.run_for(0.1);
  bridge.hear(std::vector<Marker>{again[0]});  // nothing is there any more, and it has no stamp
  message = bridge.out.newest<obstacles_t>(channel::kObstacles);
  EXPECT_EQ(message.num_obstacles, 0);
  EXPECT_EQ(to_utime(message.header.utime), bridge.now);
}

TEST(Ros2Bridge, MarkersThatCannotBeAreRefused) {
  RosBridge bridge;
  const Marker good = marker_at(Marker::CUBE, {1, 2, 3}, {1, 1, 1}, bridge.now);
  const auto expect_refused = [&](const auto& spoil, RosRefusal reason, const std::string& words) {
    Marker bad = good;
    bad.id = 1;
    spoil(bad);
    bridge.expect_refused(std::vector<Marker>{good, bad}, reason, "obstacles: " + words);
  };
  expect_refused([](Marker& m) { m.header.frame_id = "camera"; }, RosRefusal::kFrame, "frame_id 'camera'");
  expect_refused([](Marker& m) { m.pose.position.x = kNoNumber; }, RosRefusal::kValue, "position");
  expect_refused([](Marker& m) { m.scale.x = -1.0; }, RosRefusal::kValue, "scale [-1,1,1]: must be greater than 0");
  expect_refused([](Marker& m) { m.scale.z = kNoNumber; }, RosRefusal::kValue, "scale");
  expect_refused([](Marker& m) { m.pose.orientation.w = 0.5; }, RosRefusal::kQuaternion, "orientation");
  expect_refused([](Marker& m) { m.header.stamp.sec -= 2; }, RosRefusal::kTime, "stamps of its markers differ");
  const auto arrow = [](Marker& m) { m.type = Marker::ARROW, m.ns = "people/velocity"; };
  expect_refused(arrow, RosRefusal::kLayout, "velocity: an arrow of 0 points: must have 2");
  expect_refused([&](Marker& m) { arrow(m), m.points.resize(2), m.points[1].x = 101.0; }, RosRefusal::kValue,
                 "velocity [101,0,0]: must be within 100");
  EXPECT_EQ(bridge.node.report().obstacle_messages, 0);
}

}  // namespace
}  // namespace swarm::test
