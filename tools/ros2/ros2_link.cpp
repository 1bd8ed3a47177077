#include "tools/ros2/ros2_link.h"

#include <boost/asio/post.hpp>
#include <utility>

namespace swarm {
namespace {

constexpr std::size_t kNewest = 1;  // messages kept, reliably: whoever listens hears them

}  // namespace

std::shared_ptr<rclcpp::Node> Ros2Link::begin(int argc, const char* const* argv) {
  rclcpp::init(argc, argv, rclcpp::InitOptions(), rclcpp::SignalHandlerOptions::None);
  return std::make_shared<rclcpp::Node>("sogm_swarm_bridge");
}

Ros2Link::Ros2Link(int robot_id, int argc, const char* const* argv)
    : ros_(begin(argc, argv)),
      command_(ros_->create_publisher<trajectory_msgs::msg::MultiDOFJointTrajectory>("command/trajectory", kNewest)),
      occupied_(ros_->create_publisher<sensor_msgs::msg::PointCloud2>("occupied", kNewest)) {
  paths_[robot_id] = ros_->create_publisher<nav_msgs::msg::Path>("path", kNewest);
  executor_.add_node(ros_);
}

Ros2Link::~Ros2Link() {
  rclcpp::shutdown();  // then the executor comes back, also where it has not begun yet
  if (thread_.joinable()) thread_.join();
}

void Ros2Link::connect(RealtimeHost& host, Ros2Node& node) {
  host_ = &host;
  node_ = &node;
  timer_.emplace(host.io());
  const rclcpp::SensorDataQoS whatever_comes;  // best effort: of whoever speaks
  subscribe("odometry", whatever_comes, &Ros2Node::on_odometry);
  subscribe("goal", kNewest, &Ros2Node::on_goal);
  subscribe("obstacles", whatever_comes, &Ros2Node::on_obstacles);
  subscribe("cloud", whatever_comes, &Ros2Node::on_cloud);
  tell_soon();
  thread_ = std::thread([this] { executor_.spin(); });
}

template <class Message>
void Ros2Link::subscribe(const std::string& topic, const rclcpp::QoS& qos,
                         void (Ros2Node::*on_message)(Utime, const Message&, Outbox&)) {
  subscriptions_.push_back(
      ros_->create_subscription<Message>(topic, qos, [this, on_message](std::shared_ptr<const Message> message) {
        boost::asio::post(host_->io(), [this, on_message, message] {
          host_->deliver(*node_, [&](Utime now, Outbox& outbox) { (node_->*on_message)(now, *message, outbox); });
        });
      }));
}

void Ros2Link::tell_soon() {
  timer_->expires_after(100ms);
  timer_->async_wait([this](const boost::system::error_code& error) {
    if (error) return;
    host_->deliver(*node_, [this](Utime now, Outbox&) { write(log_.update(now, node_->report())); });
    tell_soon();
  });
}

void Ros2Link::publish_path(int robot_id, const nav_msgs::msg::Path& path) {
  PathPublisher& publisher = paths_[robot_id];
  if (!publisher) {
    publisher =
        ros_->create_publisher<nav_msgs::msg::Path>("peers/robot_" + std::to_string(robot_id) + "/path", kNewest);
  }
  publisher->publish(path);
}

void Ros2Link::publish_command(const trajectory_msgs::msg::MultiDOFJointTrajectory& command) {
  command_->publish(command);
}

void Ros2Link::publish_occupied(const sensor_msgs::msg::PointCloud2& cloud) {
  occupied_->publish(cloud);
}

}  // namespace swarm
