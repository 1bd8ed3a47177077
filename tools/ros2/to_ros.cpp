#include "tools/ros2/to_ros.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

namespace swarm {
namespace {

constexpr Duration kPathPeriod = 100ms;

template <class Xyz>
void assign(const Eigen::Vector3d& values, Xyz* xyz) {
  xyz->x = values.x();
  xyz->y = values.y();
  xyz->z = values.z();
}

// Of the occupied voxels' centres: x, y, z of one after the other [m].
std::vector<float> occupied_centers(const Sogm& sogm, int frame) {
  std::vector<float> centers;
  const GridGeometry& geometry = sogm.geometry;
  for (int x = 0; x < geometry.size.x(); ++x) {
    for (int y = 0; y < geometry.size.y(); ++y) {
      const std::uint64_t* const column = sogm.column(frame, x, y);
      for (int word = 0; word < geometry.words_per_column(); ++word) {
        for (std::uint64_t bits = column[word]; bits != 0; bits &= bits - 1) {
          const Eigen::Vector3d center = geometry.center_of({x, y, 64 * word + std::countr_zero(bits)});
          for (const double value : center) centers.push_back(static_cast<float>(value));
        }
      }
    }
  }
  return centers;
}

}  // namespace

builtin_interfaces::msg::Time stamp_of(Utime utime) {
  builtin_interfaces::msg::Time stamp;
  stamp.sec = static_cast<std::int32_t>(to_us(utime) / 1'000'000);
  stamp.nanosec = static_cast<std::uint32_t>(to_us(utime) % 1'000'000 * 1000);
  return stamp;
}

nav_msgs::msg::Path path_of(const Motion& motion, Utime from, const std::string& frame) {
  nav_msgs::msg::Path path;
  path.header.stamp = stamp_of(from);
  path.header.frame_id = frame;
  const auto add = [&](Utime utime) {
    auto& pose = path.poses.emplace_back();
    pose.header.stamp = stamp_of(utime);
    pose.header.frame_id = frame;
    assign(motion.at(utime).position, &pose.pose.position);
  };
  const Utime begin = std::max(from, motion.committed.start_utime());
  for (Utime utime = begin; utime < motion.end_utime(); utime += kPathPeriod) add(utime);
  add(std::max(begin, motion.end_utime()));
  return path;
}

trajectory_msgs::msg::MultiDOFJointTrajectory command_of(Utime utime, const MotionState& state, double yaw_rad,
                                                         double yaw_rate_radps, const std::string& frame) {
  trajectory_msgs::msg::MultiDOFJointTrajectory command;
  command.header.stamp = stamp_of(utime);
  command.header.frame_id = frame;
  command.joint_names = {"base_link"};
  auto& point = command.points.emplace_back();
  auto& transform = point.transforms.emplace_back();
  assign(state.position, &transform.translation);
  transform.rotation.z = std::sin(0.5 * yaw_rad);
  transform.rotation.w = std::cos(0.5 * yaw_rad);
  auto& velocity = point.velocities.emplace_back();
  assign(state.velocity, &velocity.linear);
  velocity.angular.z = yaw_rate_radps;
  assign(state.acceleration, &point.accelerations.emplace_back().linear);
  return command;
}

sensor_msgs::msg::PointCloud2 cloud_of(const Sogm& sogm, int frame_of_map, const std::string& frame) {
  using sensor_msgs::msg::PointField;
  const std::vector<float> centers = occupied_centers(sogm, frame_of_map);
  sensor_msgs::msg::PointCloud2 cloud;
  cloud.header.stamp = stamp_of(sogm.start_utime + frame_of_map * sogm.frame_duration);
  cloud.header.frame_id = frame;
  for (const char* const name : {"x", "y", "z"}) {
    PointField& field = cloud.fields.emplace_back();
    field.name = name;
    field.offset = static_cast<std::uint32_t>((cloud.fields.size() - 1) * sizeof(float));
    field.datatype = PointField::FLOAT32;
    field.count = 1;
  }
  cloud.point_step = 3 * sizeof(float);
  cloud.height = 1;
  cloud.width = static_cast<std::uint32_t>(centers.size() / 3);
  cloud.row_step = cloud.width * cloud.point_step;
  cloud.is_bigendian = false;
  cloud.is_dense = true;
  cloud.data.resize(cloud.row_step);
  if (!centers.empty()) std::memcpy(cloud.data.data(), centers.data(), cloud.data.size());
  return cloud;
}

}  // namespace swarm
