// ros2_bridge: see ros2_node.h.
#include <algorithm>
#include <exception>
#include <iostream>
#include <utility>

#include "lcmtypes/bus/boot.h"
#include "tools/ros2/ros2_link.h"

namespace swarm {
namespace {

int run(int argc, const char* const* argv) {
  const std::vector<std::string> words = rclcpp::remove_ros_arguments(argc, argv);
  std::vector<const char*> ours(words.size());
  std::ranges::transform(words, ours.begin(), [](const std::string& word) { return word.c_str(); });
  Ros2Config config;
  Ros2Node* node = nullptr;
  std::shared_ptr<Ros2Link> link;
  return daemon_main(
      "ros2_bridge",
      "Connects a robot's onboard bus with ROS 2. In: odometry, goal, obstacles, cloud; out: path,\n"
      "peers/robot_ID/path, command/trajectory, occupied. Topics are renamed as ever: --ros-args -r odometry:=/odom",
      static_cast<int>(ours.size()), ours.data(), DaemonBuses::kOnboard,
      [&](OptionSet& options) { declare(options, config); },
      [&] {
        link = std::make_shared<Ros2Link>(config.robot_id, argc, argv);
        auto made = std::make_unique<Ros2Node>(config, new_boot(), *link);
        node = made.get();
        return made;
      },
      [&](RealtimeHost& host) {
        const auto own = std::exchange(link, nullptr);  // it ends before the host does, also where this throws
        own->connect(host, *node);
        return own;
      });
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) try { return swarm::run(argc, argv); } catch (const std::exception& error) {
  std::cerr << "ros2_bridge: " << error.what() << std::endl;
  return 2;
}
