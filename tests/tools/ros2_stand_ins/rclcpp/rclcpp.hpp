// Stands in for ROS 2's header: what tools/ros2 uses of it, and no more. Nothing is sent anywhere: tests hand messages
// to subscriptions, and read what was published, by the functions of `stand_in`. The rule TOPIC:=// makes all that is
// done with the topic throw; shutdown() is told on stderr.
#pragma once

#include <any>
#include <condition_variable>
#include <cstddef>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace rclcpp {

struct QoS {
  QoS(std::size_t history_depth) : depth(history_depth) {}  // not explicit, as rclcpp's
  std::size_t depth;
  bool is_reliable = true;
};

struct SensorDataQoS : QoS {
  SensorDataQoS() : QoS(5) { is_reliable = false; }
};

struct InitOptions {};
enum class SignalHandlerOptions { All, SigInt, SigTerm, None };

// What rclcpp is for a process.
struct StandIn {
  struct Subscriber {
    bool is_reliable = false;
    std::function<void(const std::any&)> hear;  // of a std::shared_ptr<const Message>
  };

  std::mutex mutex;
  std::condition_variable changed;
  bool runs = false;
  std::map<std::string, Subscriber> subscribers;           // by topic
  std::map<std::string, std::vector<std::any>> published;  // by topic, empty where there is a publisher only
  std::set<std::string> broken;                            // topics with which nothing can be done

  void check(const std::string& topic) const {
    if (broken.contains(topic)) throw std::runtime_error(topic + " is broken");
  }
  static StandIn& instance() {
    static StandIn stand_in;
    return stand_in;
  }
};

struct SubscriptionBase {
  using SharedPtr = std::shared_ptr<SubscriptionBase>;
};

template <class Message>
class Publisher {
 public:
  using SharedPtr = std::shared_ptr<Publisher>;
  explicit Publisher(std::string topic) : topic_(std::move(topic)) {}
  void publish(const Message& message) {
    StandIn& ros = StandIn::instance();
    const std::lock_guard lock(ros.mutex);
    ros.check(topic_);
    ros.published[topic_].push_back(message);
  }

 private:
  std::string topic_;
};

class Node {
 public:
  explicit Node(const std::string&) {}

  template <class Message>
  std::shared_ptr<Publisher<Message>> create_publisher(const std::string& topic, const QoS&) {
    StandIn& ros = StandIn::instance();
    const std::lock_guard lock(ros.mutex);
    ros.check(topic);
    ros.published[topic];
    return std::make_shared<Publisher<Message>>(topic);
  }

  template <class Message, class Callback>
  SubscriptionBase::SharedPtr create_subscription(const std::string& topic, const QoS& qos, Callback callback) {
    StandIn& ros = StandIn::instance();
    const std::lock_guard lock(ros.mutex);
    ros.check(topic);
    ros.subscribers[topic] = {qos.is_reliable, [callback](const std::any& message) {
                                callback(std::any_cast<std::shared_ptr<const Message>>(message));
                              }};
    return std::make_shared<SubscriptionBase>();
  }
};

inline void init(int argc, const char* const* argv, const InitOptions&, SignalHandlerOptions) {
  StandIn& ros = StandIn::instance();
  const std::lock_guard lock(ros.mutex);
  ros.runs = true;
  ros.subscribers.clear();
  ros.published.clear();
  ros.broken.clear();
  for (int i = 0; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (word.ends_with(":=//")) ros.broken.emplace(word.substr(0, word.size() - 4));
  }
}

inline void shutdown() {
  StandIn& ros = StandIn::instance();
  const std::lock_guard lock(ros.mutex);
  ros.runs = false;
  ros.changed.notify_all();
  std::cerr << "rclcpp: shut down" << std::endl;
}

// Without what stands between --ros-args and -- or the end. Throws for a rule that is none.
inline std::vector<std::string> remove_ros_arguments(int argc, const char* const* argv) {
  std::vector<std::string> others;
  bool is_for_ros = false;
  for (int i = 0; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (word == "--ros-args") is_for_ros = true;
    if (!is_for_ros) others.emplace_back(word);
    if (is_for_ros && argv[i - 1] == std::string_view("-r") && word.find(":=") == word.npos)
      throw std::runtime_error("Couldn't parse remap rule: '-r " + std::string(word) + "'");
    if (word == "--") is_for_ros = false;
  }
  return others;
}

namespace executors {

struct SingleThreadedExecutor {
  void add_node(const std::shared_ptr<Node>&) {}
  void spin() {
    StandIn& ros = StandIn::instance();
    std::unique_lock lock(ros.mutex);
    ros.changed.wait(lock, [&ros] { return !ros.runs; });
  }
};

}  // namespace executors

namespace stand_in {

// False: nobody listens to the topic.
template <class Message>
bool deliver(const std::string& topic, const Message& message) {
  StandIn& ros = StandIn::instance();
  const std::lock_guard lock(ros.mutex);
  const auto found = ros.subscribers.find(topic);
  if (found != ros.subscribers.end()) found->second.hear(std::make_shared<const Message>(message));
  return found != ros.subscribers.end();
}

// All that was published on a topic, in order.
template <class Message>
std::vector<Message> published(const std::string& topic) {
  StandIn& ros = StandIn::instance();
  const std::lock_guard lock(ros.mutex);
  std::vector<Message> messages;
  for (const std::any& message : ros.published[topic]) messages.push_back(std::any_cast<const Message&>(message));
  return messages;
}

}  // namespace stand_in

}  // namespace rclcpp
