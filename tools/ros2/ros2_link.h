// The topics of ROS 2 at the host's event loop. rclcpp waits in a thread of its own and hands messages over; the node
// is called by the host's thread alone. Where that is late the newest are heard: one a topic, ten of odometry.
//
// In: odometry, goal, obstacles, cloud. Out: path, peers/robot_ID/path, command/trajectory, occupied. All are relative:
// --ros-args -r __ns:=/robot2 -r odometry:=/vio/odometry
#pragma once

#include <boost/asio/steady_timer.hpp>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <rclcpp/rclcpp.hpp>
#include <string>
#include <thread>
#include <vector>

#include "lcmtypes/bus/realtime_host.h"
#include "tools/ros2/ros2_log.h"
#include "tools/ros2/ros2_node.h"

namespace swarm {

// One a process, for rclcpp is begun and ended with it.
class Ros2Link : public RosOutbox {
 public:
  // Begins rclcpp with the arguments of the command line, of which it takes those for ROS; signals are left to the
  // host. Throws what rclcpp throws.
  Ros2Link(int robot_id, int argc, const char* const* argv);
  ~Ros2Link() override;

  // From now on `node` of `host` hears its topics, and its log is written. Once; both must outlive this.
  void connect(RealtimeHost& host, Ros2Node& node);

  std::string publish_path(int robot_id, const nav_msgs::msg::Path& path) override;
  std::string publish_command(const trajectory_msgs::msg::MultiDOFJointTrajectory& command) override;
  std::string publish_occupied(const sensor_msgs::msg::PointCloud2& cloud) override;

 private:
  using PathPublisher = rclcpp::Publisher<nav_msgs::msg::Path>::SharedPtr;

  // What waits for the host's thread, of a topic.
  template <class Message>
  struct Inbox {
    std::mutex mutex;
    std::deque<std::shared_ptr<const Message>> waiting;
    std::int64_t overtaken = 0;
  };
  template <class Message>
  using OnMessage = void (Ros2Node::*)(Utime, const Message&, Outbox&);

  static std::shared_ptr<rclcpp::Node> begin(int argc, const char* const* argv);
  // `most`: so many may wait.
  template <class Message>
  void subscribe(const std::string& topic, const rclcpp::QoS& qos, std::size_t most, OnMessage<Message> on_message);
  template <class Message>
  void hear(Inbox<Message>& inbox, OnMessage<Message> on_message);
  void tell_soon();

  std::shared_ptr<rclcpp::Node> ros_;
  rclcpp::executors::SingleThreadedExecutor executor_;
  std::map<int, PathPublisher> paths_;  // by robot
  rclcpp::Publisher<trajectory_msgs::msg::MultiDOFJointTrajectory>::SharedPtr command_;
  rclcpp::Publisher<sensor_msgs::msg::PointCloud2>::SharedPtr occupied_;
  std::vector<rclcpp::SubscriptionBase::SharedPtr> subscriptions_;

  RealtimeHost* host_ = nullptr;
  Ros2Node* node_ = nullptr;
  std::optional<boost::asio::steady_timer> timer_;
  Ros2Log log_;
  std::thread thread_;  // rclcpp's
};

}  // namespace swarm
