#include "tools/ros2/ros2_link.h"

#include <boost/asio/post.hpp>
#include <exception>
#include <utility>

namespace swarm {
namespace {

constexpr std::size_t kNewest = 1;  // messages kept, reliably: whoever listens hears them
constexpr std::size_t kWaitingStates = 10;

// What `publish` throws, in words; empty: nothing.
template <class Publish>
std::string attempt(const std::string& topic, const Publish& publish) {
  try {
    publish();
    return "";
  } catch (const std::exception& error) {
    return topic + ": " + error.what();
  }
}

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
  subscribe("odometry", whatever_comes, kWaitingStates, &Ros2Node::on_odometry);
  subscribe("goal", kNewest, kNewest, &Ros2Node::on_goal);
  subscribe("obstacles", whatever_comes, kNewest, &Ros2Node::on_obstacles);
  subscribe("cloud", whatever_comes, kNewest, &Ros2Node::on_cloud);
  tell_soon();
  thread_ = std::thread([this] { executor_.spin(); });
}

template <class Message>
void Ros2Link::subscribe(const std::string& topic, const rclcpp::QoS& qos, std::size_t most,
                         OnMessage<Message> on_message) {
  const auto inbox = std::make_shared<Inbox<Message>>();
  subscriptions_.push_back(ros_->create_subscription<Message>(
      topic, qos, [this, most, on_message, inbox](std::shared_ptr<const Message> message) {
        const std::lock_guard lock(inbox->mutex);
        inbox->waiting.push_back(message);
        if (inbox->waiting.size() > most) {
          inbox->waiting.pop_front();
          ++inbox->overtaken;
        } else if (inbox->waiting.size() == 1) {  // the host's thread is not asked yet
          boost::asio::post(host_->io(), [this, on_message, inbox] { hear(*inbox, on_message); });
        }
      }));
}

template <class Message>
void Ros2Link::hear(Inbox<Message>& inbox, OnMessage<Message> on_message) {
  std::deque<std::shared_ptr<const Message>> messages;
  {
    const std::lock_guard lock(inbox.mutex);
    messages.swap(inbox.waiting);
    node_->on_overtaken(std::exchange(inbox.overtaken, 0));
  }
  for (const auto& message : messages)
    host_->deliver(*node_, [&](Utime now, Outbox& outbox) { (node_->*on_message)(now, *message, outbox); });
}

void Ros2Link::tell_soon() {
  timer_->expires_after(100ms);
  timer_->async_wait([this](const boost::system::error_code& error) {
    if (error) return;
    host_->deliver(*node_, [this](Utime now, Outbox&) { write(log_.update(now, node_->report())); });
    tell_soon();
  });
}

std::string Ros2Link::publish_path(int robot_id, const nav_msgs::msg::Path& path) {
  PathPublisher& publisher = paths_[robot_id];
  const std::string robot = "robot_" + std::to_string(robot_id);
  return attempt("path of " + robot, [&] {
    if (!publisher) publisher = ros_->create_publisher<nav_msgs::msg::Path>("peers/" + robot + "/path", kNewest);
    publisher->publish(path);
  });
}

std::string Ros2Link::publish_command(const trajectory_msgs::msg::MultiDOFJointTrajectory& command) {
  return attempt("command/trajectory", [&] { command_->publish(command); });
}

std::string Ros2Link::publish_occupied(const sensor_msgs::msg::PointCloud2& cloud) {
  return attempt("occupied", [&] { occupied_->publish(cloud); });
}

}  // namespace swarm
