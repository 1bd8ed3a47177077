// ROS 2 to the onboard bus and back, for one robot: where it is, where it shall go, what is around it; what it is bound
// to fly, its setpoints, its map. Neither LCM nor rclcpp: ros2_link.h has the topics.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/recurring.h"
#include "map_daemon/sogm_codec.h"
#include "tools/ros2/from_ros.h"
#include "tools/ros2/to_ros.h"

namespace swarm {

struct Ros2Config {
  int robot_id = 0;
  std::string frame = "world";  // frame_id of W
  bool publish_state = true;
  MarkerSigmas sigmas;
  int sensor = 0;                                              // what clouds are of
  std::string lidar_frame = "lidar";                           // frame_id of clouds that are not in W
  Eigen::Vector3d lidar_position = Eigen::Vector3d::Zero();    // in the body's frame [m]
  Eigen::Vector3d lidar_angles_deg = Eigen::Vector3d::Zero();  // roll, pitch, yaw of the LiDAR's frame in the body's
  double clock_limit_s = 0.1;                                  // what is from further in the future is refused
};

void declare(OptionSet& options, Ros2Config& config);

// Where the node puts what is for ROS. Returned: why it was not published, in words; empty when it was.
class RosOutbox {
 public:
  virtual ~RosOutbox() = default;
  [[nodiscard]] virtual std::string publish_path(int robot_id, const nav_msgs::msg::Path& path) = 0;
  [[nodiscard]] virtual std::string publish_command(const trajectory_msgs::msg::MultiDOFJointTrajectory& command) = 0;
  [[nodiscard]] virtual std::string publish_occupied(const sensor_msgs::msg::PointCloud2& cloud) = 0;
};

struct Ros2Report {
  std::int64_t states = 0, goals = 0, obstacle_messages = 0, scans = 0;  // from ROS to the bus
  std::int64_t commands = 0, paths = 0, clouds = 0;                      // from the bus to ROS
  std::int64_t overtaken = 0;                                            // from ROS, before this heard them
  std::int64_t unpublished = 0;                                          // that ROS did not take
  std::string unpublished_words;                                         // why it did not take the newest of them
  std::int64_t passed_over = 0;                                          // markers that are no obstacles
  std::int64_t thinned = 0;                                              // clouds with more points than fit a scan
  std::array<std::int64_t, kNumRosRefusals> refused{};                   // from ROS
  std::string words;                                                     // what was wrong with the newest of them
  RefusalCounts refused_from_bus;
  bool is_silent = false;  // no setpoints: the committed trajectory is followed
};

class Ros2Node : public Node {
 public:
  // `boot` as in HeaderSource; `ros` must outlive every call.
  Ros2Node(const Ros2Config& config, std::int32_t boot, RosOutbox& ros);

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;
  bool on_clock_step(Utime now, Duration step) override;

  // What comes from ROS.
  void on_odometry(Utime now, const nav_msgs::msg::Odometry& odometry, Outbox& outbox);
  // Holds from now on, whatever its stamp: who asks for something asks for it until told otherwise. Also where another
  // sender has told a goal before.
  void on_goal(Utime now, const geometry_msgs::msg::PoseStamped& pose, Outbox& outbox);
  void on_obstacles(Utime now, const visualization_msgs::msg::MarkerArray& markers, Outbox& outbox);
  // In W or in the LiDAR's frame, with the motion during the turn taken out. Clouds wait for the odometry that is not
  // older, which says where the robot was: five of the last second.
  void on_cloud(Utime now, const sensor_msgs::msg::PointCloud2& cloud, Outbox& outbox);
  // So many messages were not handed over, for newer ones had come.
  void on_overtaken(std::int64_t messages) { report_.overtaken += messages; }

  const Ros2Report& report() const { return report_; }

 private:
  // Of a topic: the newest time that was taken.
  using Newest = std::optional<Utime>;
  struct Cloud {
    Utime utime{};
    bool is_in_world = false;
    std::vector<Eigen::Vector3d> points;
  };
  struct Robot {
    SequenceGate gate;
    Recurring path;  // published
  };

  // Calls `translate`, counts what it refuses.
  template <class Translate>
  void take(const char* topic, const Translate& translate);
  void refuse(const char* topic, const RosRefused& refused);
  // Throws RosRefused for what is too old, from the future, or not newer than before.
  void check_stamp(Utime now, Utime utime, const Newest& newest) const;
  // Of the clouds that wait those for which odometry has come.
  void place_clouds(Outbox& outbox);
  // One for which it has.
  void place(Cloud& cloud, Outbox& outbox);

  Refusal on_goal_of_bus(std::span<const std::uint8_t> bytes);
  Refusal on_setpoint(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_announcement(Utime now, bool is_own, std::span<const std::uint8_t> bytes);
  Refusal on_sogm(Utime now, std::span<const std::uint8_t> bytes);
  void command(Utime now, const MotionState& state, double yaw_rate_radps);
  // What a publish_... of RosOutbox has returned.
  void count(const std::string& failure, std::int64_t* published);

  Ros2Config config_;
  RosOutbox& ros_;
  Eigen::Quaterniond mount_;  // from the LiDAR's frame to the body's
  Ros2Report report_;

  HeaderSource state_headers_, goal_headers_, obstacle_headers_, scan_headers_;
  Newest odometry_newest_, obstacles_newest_, cloud_newest_;
  std::deque<TimedPose> poses_;  // of the body, of the last second
  std::deque<Cloud> clouds_;     // wait for odometry, in order

  std::int32_t goal_boot_;  // of goal_headers_
  SequenceGate goal_gate_;  // of all goals, own and others'
  SequenceGate setpoint_gate_;
  std::map<int, Robot> robots_;  // that were heard, this one too
  SogmAssembler sogm_parts_;
  Sogm sogm_;
  Recurring occupied_;  // published

  std::optional<Motion> motion_;         // what the robot is bound to, by the broadcaster's time
  Duration ahead_{};                     // how far that time is ahead of this node's
  std::optional<Utime> setpoint_heard_;  // none: none yet, or all has ended
  Utime announcement_heard_{};
  Utime commanded_utime_{};  // of the newest command, by the broadcaster's time
  double yaw_rad_ = 0.0;     // of the newest setpoint
  Recurring sample_;         // of the motion, while there are no setpoints
};

}  // namespace swarm
