#include "tools/ros2/ros2_node.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/receive.h"
#include "tools/scans/scan_message.h"

namespace swarm {
namespace {

constexpr Duration kRosAge = 1s, kMapAge = 1s;       // older messages are refused
constexpr Duration kViewPeriod = 200ms;              // of paths and clouds, which are to be looked at
constexpr double kPoses_s = 1.0, kPoseGap_s = 0.2;   // how long poses are kept; between two, one is known
constexpr std::size_t kWaitingClouds = 5;            // for odometry
constexpr Duration kWait = 1s;                       // the longest one, by their stamps
constexpr Duration kSilence = 50ms, kSample = 10ms;  // without setpoints the committed trajectory is followed
constexpr Duration kBroadcasterGone = 500ms;         // nothing was heard of it for so long
constexpr Duration kAtRest = 1s;                     // for which the place of rest is told after all has ended
constexpr double kRadians = std::numbers::pi / 180.0;

Eigen::Quaterniond rotation_of(const Eigen::Vector3d& roll_pitch_yaw_deg) {
  const Eigen::Vector3d angles = kRadians * roll_pitch_yaw_deg;
  return Eigen::AngleAxisd(angles.z(), Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(angles.y(), Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(angles.x(), Eigen::Vector3d::UnitX());
}

}  // namespace

void declare(OptionSet& options, Ros2Config& config) {
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("frame", &config.frame, "frame_id of the world that all robots share: z up");
  options.add("publish-state", &config.publish_state,
              "publish ROBOT_STATE; false: somebody else does, and odometry says where the LiDAR is");
  options.add("position-sigma", &config.sigmas.position_m, 0, 1000, "m",
              "standard deviation of an axis of obstacles' positions; 0: they are exact");
  options.add("velocity-sigma", &config.sigmas.velocity_mps, 0, 100, "m/s",
              "and of their velocities, where there are any");
  options.add("sensor", &config.sensor, 0, kMaxSensors - 1, "", "which of the robot's the clouds are of");
  options.add("lidar-frame", &config.lidar_frame, "frame_id of clouds that are in the LiDAR's own frame");
  options.add("lidar-position", &config.lidar_position, -100, 100, "m", "of the LiDAR in the body's frame");
  options.add("lidar-angles", &config.lidar_angles_deg, -360, 360, "deg",
              "roll, pitch and yaw of the LiDAR's frame in the body's");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s", "messages from further in the future are refused");
}

Ros2Node::Ros2Node(const Ros2Config& config, std::int32_t boot, RosOutbox& ros)
    : config_(config),
      ros_(ros),
      mount_(rotation_of(config.lidar_angles_deg)),
      state_headers_(config.robot_id, boot),
      goal_headers_(config.robot_id, boot),
      obstacle_headers_(config.robot_id, boot),
      scan_headers_(config.robot_id, boot),
      goal_boot_(boot) {}

std::vector<Subscription> Ros2Node::subscriptions() const {
  return {{BusId::kOnboard, channel::kGoal},
          {BusId::kOnboard, channel::kSetpoint},
          {BusId::kOnboard, channel::kOwnTrajectory},
          {BusId::kOnboard, channel::kPeerTrajectory},
          {BusId::kOnboard, channel::kSogm}};
}

template <class Translate>
void Ros2Node::take(const char* topic, const Translate& translate) {
  try {
    translate();
  } catch (const RosRefused& refused) {
    refuse(topic, refused);
  }
}

void Ros2Node::refuse(const char* topic, const RosRefused& refused) {
  ++report_.refused[static_cast<std::size_t>(refused.reason)];
  report_.words = std::string(topic) + ": " + refused.words;
}

void Ros2Node::check_stamp(Utime now, Utime utime, const Newest& newest) const {
  const Duration limit = to_duration(config_.clock_limit_s);
  if (check_time(utime, now, kRosAge, limit) != Refusal::kNone)
    throw RosRefused{RosRefusal::kTime, "stamp is " + std::to_string((now - utime) / 1ms) +
                                            " ms old: must be UTC, at most 1 s old and not of the future"};
  if (newest && utime <= *newest) throw RosRefused{RosRefusal::kOrder, "stamp: must be later than the one before"};
}

void Ros2Node::on_odometry(Utime now, const nav_msgs::msg::Odometry& odometry, Outbox& outbox) {
  take("odometry", [&] {
    sogm_swarm::robot_state_t state = state_of(odometry, config_.frame);
    const Utime utime = utime_of(odometry.header.stamp);
    check_stamp(now, utime, odometry_newest_);
    poses_.push_back(body_pose_of(odometry));
    odometry_newest_ = utime;
    while (poses_.front().t_s < poses_.back().t_s - kPoses_s) poses_.pop_front();
    if (config_.publish_state) {
      state.header = state_headers_.next(utime);
      outbox.publish(BusId::kOnboard, channel::kRobotState, state);
      ++report_.states;
    }
  });
  place_clouds(outbox);
}

void Ros2Node::on_goal(Utime now, const geometry_msgs::msg::PoseStamped& pose, Outbox& outbox) {
  take("goal", [&] {
    sogm_swarm::goal_t goal = goal_of(pose, config_.frame);
    goal.header = goal_headers_.next(now);
    (void)goal_gate_.pass(goal.header);
    outbox.publish(BusId::kOnboard, channel::kGoal, goal);
    ++report_.goals;
  });
}

void Ros2Node::on_obstacles(Utime now, const visualization_msgs::msg::MarkerArray& markers, Outbox& outbox) {
  take("obstacles", [&] {
    MarkerObstacles found = obstacles_of(markers, config_.frame, config_.sigmas, now);
    const Utime utime = to_utime(found.message.header.utime);
    check_stamp(now, utime, obstacles_newest_);
    obstacles_newest_ = utime;
    found.message.header = obstacle_headers_.next(utime);
    outbox.publish(BusId::kOnboard, channel::kObstacles, found.message);
    ++report_.obstacle_messages;
    report_.passed_over += found.passed_over;
  });
}

void Ros2Node::on_cloud(Utime now, const sensor_msgs::msg::PointCloud2& cloud, Outbox& outbox) {
  take("cloud", [&] {
    const std::string& frame = cloud.header.frame_id;
    if (frame != config_.frame && frame != config_.lidar_frame)
      throw RosRefused{RosRefusal::kFrame,
                       "frame_id '" + frame + "': must be '" + config_.lidar_frame + "' or '" + config_.frame + "'"};
    const Utime utime = utime_of(cloud.header.stamp);
    check_stamp(now, utime, cloud_newest_);
    clouds_.push_back({utime, frame == config_.frame, points_of(cloud)});
    cloud_newest_ = utime;
  });
  place_clouds(outbox);
  while (clouds_.size() > kWaitingClouds || (!clouds_.empty() && clouds_.front().utime < *cloud_newest_ - kWait)) {
    clouds_.pop_front();
    refuse("cloud", {RosRefusal::kPose, "no odometry since its stamp"});
  }
}

void Ros2Node::place_clouds(Outbox& outbox) {
  while (!clouds_.empty() && odometry_newest_ && clouds_.front().utime <= *odometry_newest_) {
    Cloud cloud = std::move(clouds_.front());
    clouds_.pop_front();
    take("cloud", [&] { place(cloud, outbox); });
  }
}

void Ros2Node::place(Cloud& cloud, Outbox& outbox) {
  const double t_s = to_seconds(cloud.utime.time_since_epoch());
  const auto later = std::ranges::lower_bound(poses_, t_s, {}, &TimedPose::t_s);
  const bool is_then = later->t_s == t_s;
  if (!is_then && (later == poses_.begin() || later->t_s - std::prev(later)->t_s > kPoseGap_s))
    throw RosRefused{RosRefusal::kPose, "odometry has a gap at its stamp"};
  const TimedPose body = is_then ? *later : pose_between(*std::prev(later), *later, t_s);
  const Eigen::Vector3d position = body.position + body.orientation * config_.lidar_position;
  const Eigen::Quaterniond orientation = (body.orientation * mount_).normalized();
  if (cloud.is_in_world) {
    for (Eigen::Vector3d& point : cloud.points) point = orientation.conjugate() * (point - position);
  }
  if (thin_to_fit(&cloud.points)) ++report_.thinned;
  publish_scan(scan_headers_.next(cloud.utime), config_.sensor, position, orientation, cloud.points, outbox);
  ++report_.scans;
}

void Ros2Node::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) {
  Refusal refusal = Refusal::kNone;
  if (channel == channel::kGoal) {
    refusal = on_goal_of_bus(bytes);
  } else if (channel == channel::kSetpoint) {
    refusal = on_setpoint(now, bytes);
  } else if (channel == channel::kSogm) {
    refusal = on_sogm(now, bytes);
  } else {
    refusal = on_announcement(now, channel == channel::kOwnTrajectory, bytes);
  }
  if (refusal != Refusal::kNone) report_.refused_from_bus.count(refusal);
}

// The planner takes newer goals only. Where another sender is ahead, the next goal of ROS has a boot beyond its.
Refusal Ros2Node::on_goal_of_bus(std::span<const std::uint8_t> bytes) {
  sogm_swarm::goal_t goal;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, TimeWindow(), AnyOrder(), &goal);
  if (refusal != Refusal::kNone) return refusal;
  const bool is_newest = goal_gate_.pass(goal.header) == Refusal::kNone;  // own ones come back, which are not
  if (is_newest && goal.header.boot >= goal_boot_) {
    goal_boot_ = std::min(goal.header.boot, std::numeric_limits<std::int32_t>::max() - 1) + 1;
    goal_headers_ = HeaderSource(config_.robot_id, goal_boot_);
  }
  return Refusal::kNone;
}

// Whatever its time: the broadcaster keeps its own until the robot rests, where the clock was set.
Refusal Ros2Node::on_setpoint(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::setpoint_t setpoint;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, TimeWindow(), setpoint_gate_, &setpoint);
  if (refusal != Refusal::kNone) return refusal;
  const Utime utime = to_utime(setpoint.header.utime);
  setpoint_heard_ = now;
  ahead_ = utime - now;
  yaw_rad_ = setpoint.yaw;
  report_.is_silent = false;
  // The trajectory may have been sampled beyond it meanwhile: the robot is never led backwards.
  if (utime <= commanded_utime_ && utime >= commanded_utime_ - kSilence) return Refusal::kNone;
  commanded_utime_ = utime;
  command(now,
          {Eigen::Vector3d(setpoint.position), Eigen::Vector3d(setpoint.velocity),
           Eigen::Vector3d(setpoint.acceleration), Eigen::Vector3d(setpoint.jerk)},
          setpoint.yaw_rate);
  return Refusal::kNone;
}

Refusal Ros2Node::on_announcement(Utime now, bool is_own, std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  const auto from = [&](const sogm_swarm::announcement_t& m) {
    const bool is_expected =
        is_own == (m.header.robot_id == config_.robot_id) &&
        (robots_.contains(m.header.robot_id) || std::ssize(robots_) < kMaxRosterRobots + kMaxStrangers);
    if (!is_expected) return Refusal::kRobot;
    const Utime end = motion_of(m).end_utime();
    return end <= to_utime(m.header.utime) + kMaxMotion ? Refusal::kNone : Refusal::kInconsistent;
  };
  const auto in_order = [&](const sogm_swarm::announcement_t& m) {
    return robots_[m.header.robot_id].gate.pass(m.header);
  };
  if (const Refusal refusal = receive(bytes, from, TimeWindow(), in_order, &message); refusal != Refusal::kNone)
    return refusal;
  const Motion motion = motion_of(message);
  Robot& robot = robots_[message.header.robot_id];
  if (now >= robot.path.due(now, kViewPeriod)) {
    const nav_msgs::msg::Path path = path_of(motion, to_utime(message.header.utime), config_.frame);
    count(ros_.publish_path(message.header.robot_id, path), &report_.paths);
    robot.path.done(now);
  }
  if (is_own) {
    motion_ = motion;
    announcement_heard_ = now;
  }
  return Refusal::kNone;
}

Refusal Ros2Node::on_sogm(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::sogm_t part;
  const TimeWindow window{now, kMapAge, to_duration(config_.clock_limit_s)};
  if (const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window, AnyOrder(), &part);
      refusal != Refusal::kNone)
    return refusal;
  const Assembly assembly = sogm_parts_.add(part, &sogm_);
  if (assembly.status == AssemblyStatus::kComplete && now >= occupied_.due(now, kViewPeriod)) {
    count(ros_.publish_occupied(cloud_of(sogm_, sogm_.frame_at(now), config_.frame)), &report_.clouds);
    occupied_.done(now);
  }
  return assembly.refusal;
}

void Ros2Node::command(Utime now, const MotionState& state, double yaw_rate_radps) {
  count(ros_.publish_command(command_of(now, state, yaw_rad_, yaw_rate_radps, config_.frame)), &report_.commands);
}

void Ros2Node::count(const std::string& failure, std::int64_t* published) {
  if (failure.empty()) {
    ++*published;
    return;
  }
  ++report_.unpublished;
  report_.unpublished_words = failure;
}

// Without setpoints the committed trajectory goes on, for peers count on it.
Utime Ros2Node::step(Utime now, Outbox&) {
  if (!setpoint_heard_) return kNever;
  if (now < *setpoint_heard_ + kSilence) return *setpoint_heard_ + kSilence;
  const Utime gone = std::max(*setpoint_heard_, announcement_heard_) + kBroadcasterGone;
  if (!motion_ || now >= std::max(gone, motion_->end_utime() - ahead_) + kAtRest) {
    setpoint_heard_.reset();
    return kNever;
  }
  report_.is_silent = true;
  if (now >= sample_.due_on_grid(now, kSample)) {
    commanded_utime_ = now + ahead_;
    command(now, motion_->at(commanded_utime_), 0.0);
    sample_.done(now);
  }
  return sample_.due_on_grid(now, kSample);
}

bool Ros2Node::on_clock_step(Utime, Duration step) {
  ahead_ -= step;
  announcement_heard_ += step;
  if (setpoint_heard_) *setpoint_heard_ += step;
  odometry_newest_ = obstacles_newest_ = cloud_newest_ = std::nullopt;
  poses_.clear();
  clouds_.clear();
  return true;
}

}  // namespace swarm
