// The topics of the bridge to ROS 2, over stand-ins of rclcpp that hold its callbacks, and the real onboard bus.
#include "tools/ros2/ros2_link.h"

#include <thread>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/channels.h"
#include "tests/support/lcm_bus_fixture.h"
#include "tests/support/ros2_bridge.h"

namespace swarm::test {
namespace {

using Ros2LinkTest = LcmBusTest;

TEST_F(Ros2LinkTest, CarriesMessagesBothWays) {
  RealtimeHost host;
  Ros2Link link(3, 0, nullptr);
  Ros2Node node(config_of_robot_3(), new_boot(), link);
  host.add("ros2_bridge", node, test_url(1), "");
  link.connect(host, node);
  std::thread thread([&host] { host.run(); });

  LcmBus bus(test_url(1));
  std::map<std::string, int> heard;
  for (const char* const name : {channel::kRobotState, channel::kGoal, channel::kObstacles, channel::kLidarScan})
    bus.subscribe(name,
                  [&heard](std::string_view channel, std::span<const std::uint8_t>) { ++heard[std::string(channel)]; });
  const auto hears = [&](const char* channel) { return wait_until(bus, [&] { return heard[channel] == 1; }); };
  nav_msgs::msg::Odometry odometry;
  odometry.header.frame_id = "world";
  odometry.header.stamp = stamp_of(wall_utime());
  EXPECT_TRUE(rclcpp::stand_in::deliver("odometry", odometry));
  EXPECT_TRUE(rclcpp::stand_in::deliver("cloud", cloud_with({{1, 2, 3}}, "lidar", utime_of(odometry.header.stamp))));
  EXPECT_TRUE(hears(channel::kRobotState));
  EXPECT_TRUE(hears(channel::kLidarScan));
  geometry_msgs::msg::PoseStamped goal;
  goal.header.frame_id = "world";
  EXPECT_TRUE(rclcpp::stand_in::deliver("goal", goal));
  EXPECT_TRUE(hears(channel::kGoal));
  visualization_msgs::msg::MarkerArray markers;
  markers.markers.push_back(
      marker_at(visualization_msgs::msg::Marker::CYLINDER, {1, 2, 1}, {0.5, 0.5, 2}, wall_utime()));
  EXPECT_TRUE(rclcpp::stand_in::deliver("obstacles", markers));
  EXPECT_TRUE(hears(channel::kObstacles));
  EXPECT_FALSE(rclcpp::stand_in::deliver("elsewhere", goal));
  // Sensors often speak with best effort only, which a reliable subscription does not hear.
  for (const auto& [topic, subscriber] : rclcpp::StandIn::instance().subscribers)
    EXPECT_EQ(subscriber.is_reliable, topic == "goal") << topic;

  sogm_swarm::setpoint_t setpoint{};
  setpoint.header = make_header(3, 1, 0, wall_utime());
  setpoint.position[0] = 4.0;
  EXPECT_TRUE(bus.publish(channel::kSetpoint, encoded(setpoint)));
  const auto announce = [&](const char* channel, int robot_id) {
    sogm_swarm::announcement_t announcement{};
    announcement.header = make_header(robot_id, 1, 0, wall_utime());
    announcement.radius = 0.2f;
    announcement.committed = Trajectory::hover(1, wall_utime(), {4, 0, 1}).to_wire();
    announcement.least_delay_us = sogm_swarm::announcement_t::kUnknown;
    EXPECT_TRUE(bus.publish(channel, encoded(announcement)));
  };
  announce(channel::kOwnTrajectory, 3);
  announce(channel::kPeerTrajectory, 7);
  Sogm sogm;
  GridGeometry geometry;
  geometry.size = {10, 10, 10};
  sogm.reset(geometry, 1, wall_utime(), 100ms);
  sogm.column(0, 1, 2)[0] = 8;
  SogmEncoder encoder;
  for (const sogm_swarm::sogm_t& part : encoder.encode(sogm, make_header(3, 1, 0, sogm.start_utime)))
    EXPECT_TRUE(bus.publish(channel::kSogm, encoded(part)));
  const auto says = [](const std::string& topic, auto message) {
    return wait_for(5.0, [&] { return !rclcpp::stand_in::published<decltype(message)>(topic).empty(); });
  };
  using trajectory_msgs::msg::MultiDOFJointTrajectory;
  ASSERT_TRUE(says("command/trajectory", MultiDOFJointTrajectory()));
  const auto commands = rclcpp::stand_in::published<MultiDOFJointTrajectory>("command/trajectory");
  EXPECT_EQ(commands[0].points.at(0).transforms.at(0).translation.x, 4.0);
  EXPECT_TRUE(says("path", nav_msgs::msg::Path()));
  EXPECT_TRUE(says("peers/robot_7/path", nav_msgs::msg::Path()));
  ASSERT_TRUE(says("occupied", sensor_msgs::msg::PointCloud2()));
  EXPECT_EQ(points_of(rclcpp::stand_in::published<sensor_msgs::msg::PointCloud2>("occupied")[0]).size(), 1u);

  host.stop();
  thread.join();
}

TEST_F(Ros2LinkTest, OfWhatComesFasterThanItIsHeardTheNewestIsHeard) {
  RealtimeHost host;
  Ros2Link link(3, 0, nullptr);
  Ros2Node node(config_of_robot_3(), new_boot(), link);
  host.add("ros2_bridge", node, test_url(3), "");
  link.connect(host, node);
  LcmBus bus(test_url(3));
  double x = -1.0;
  bus.subscribe(channel::kGoal, [&x](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::goal_t goal;
    if (decode(bytes, &goal) == Refusal::kNone) x = goal.waypoints[0].position[0];
  });
  const Utime begin = wall_utime() - 50ms;
  nav_msgs::msg::Odometry odometry;
  odometry.header.frame_id = "world";
  for (int i = 0; i < 30; ++i) {
    odometry.header.stamp = stamp_of(begin + i * 1ms);
    EXPECT_TRUE(rclcpp::stand_in::deliver("odometry", odometry));
  }
  geometry_msgs::msg::PoseStamped goal;
  goal.header.frame_id = "world";
  for (int i = 0; i < 3; ++i) {
    goal.pose.position.x = i;
    EXPECT_TRUE(rclcpp::stand_in::deliver("goal", goal));
  }
  for (int i = 26; i < 30; ++i)
    EXPECT_TRUE(rclcpp::stand_in::deliver("cloud", cloud_with({{1, 2, 3}}, "lidar", begin + i * 1ms)));
  host.watch(10ms, [] { return false; });  // what waited is heard before
  host.run();
  EXPECT_EQ(node.report().states, 10);
  EXPECT_EQ(node.report().goals, 1);
  EXPECT_EQ(node.report().scans, 1);
  EXPECT_EQ(node.report().overtaken, 20 + 2 + 3);
  EXPECT_TRUE(wait_until(bus, [&x] { return x == 2.0; })) << x;
}

TEST_F(Ros2LinkTest, WhatRosDoesNotTakeEndsNothing) {
  RealtimeHost host;
  Ros2Link link(3, 0, nullptr);
  Ros2Node node(config_of_robot_3(), new_boot(), link);
  host.add("ros2_bridge", node, test_url(4), "");
  link.connect(host, node);
  rclcpp::StandIn::instance().broken = {"command/trajectory", "peers/robot_7/path"};
  LcmBus bus(test_url(4));
  sogm_swarm::setpoint_t setpoint{};
  setpoint.header = make_header(3, 1, 0, wall_utime());
  EXPECT_TRUE(bus.publish(channel::kSetpoint, encoded(setpoint)));
  sogm_swarm::announcement_t announcement{};
  announcement.header = make_header(7, 1, 0, wall_utime());
  announcement.radius = 0.2f;
  announcement.committed = Trajectory::hover(1, wall_utime(), {4, 0, 1}).to_wire();
  announcement.least_delay_us = sogm_swarm::announcement_t::kUnknown;
  EXPECT_TRUE(bus.publish(channel::kPeerTrajectory, encoded(announcement)));
  const auto end = Clock::now() + 5s;
  host.watch(10ms, [&] { return node.report().unpublished < 2 && Clock::now() < end; });
  host.run();
  EXPECT_EQ(node.report().unpublished, 2);
  EXPECT_EQ(node.report().unpublished_words, "path of robot_7: peers/robot_7/path is broken");
  EXPECT_EQ(node.report().commands + node.report().paths, 0);
  EXPECT_NE(link.publish_command({}), "");
  rclcpp::StandIn::instance().broken.clear();
  EXPECT_EQ(link.publish_command({}), "");
  EXPECT_EQ(link.publish_path(7, {}), "");
}

TEST_F(Ros2LinkTest, TheProgramTakesItsOptionsAndLeavesRosItsOwn) {
  const std::string program = "../tests/ros2_bridge_on_stand_ins";
  const Finished wrong = run_program({program, "--robot", "3", "--ros-args", "-r", "odometry:=/odom"});
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_NE(wrong.err.find("ros2_bridge: "), std::string::npos) << wrong.err;
  const Finished no_rule = run_program({program, "--robot-id", "3", "--ros-args", "-r", "odometry"});
  EXPECT_EQ(no_rule.exit_code, 2);
  EXPECT_EQ(no_rule.err, "ros2_bridge: Couldn't parse remap rule: '-r odometry'\n");
  // A topic that cannot be had: what belongs to rclcpp ends before the event loop does, not after all is told.
  const Finished broken =
      run_program({program, "--robot-id", "3", "--onboard-url", test_url(5), "--ros-args", "-r", "cloud:=//"});
  EXPECT_EQ(broken.exit_code, 2);
  const std::size_t ended = broken.err.find("rclcpp: shut down"),
                    told = broken.err.find("ros2_bridge: cloud is broken");
  EXPECT_NE(told, std::string::npos) << broken.err;
  EXPECT_LT(ended, told) << broken.err;
  Program good({program, "--ros-args", "-r", "odometry:=/odom", "--", "--robot-id", "3", "--onboard-url", test_url(2)});
  EXPECT_TRUE(wait_for(10.0, [&] { return good.err().find("listens to") != std::string::npos; })) << good.err();
  good.signal(SIGTERM);
  EXPECT_EQ(good.wait(5.0), 0) << good.err();
}

}  // namespace
}  // namespace swarm::test
