#include "tools/ros2/from_ros.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <span>
#include <string_view>

#include "lcmtypes/bus/crc32.h"
#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/portable_math.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

using geometry_msgs::msg::Pose;
using sensor_msgs::msg::PointCloud2;
using sensor_msgs::msg::PointField;
using sogm_swarm::obstacle_t;
using visualization_msgs::msg::Marker;

static_assert(std::endian::native == std::endian::little);  // as clouds are

constexpr double kUnit = 0.01;      // so near to 1 is a quaternion's length
constexpr double kUpright = 0.999;  // cosine of the tilt, 2.6 degrees, up to which a cylinder stands upright
constexpr Duration kOneArray = 1s;  // within which its markers are stamped
constexpr std::string_view kVelocity = "/velocity";

[[noreturn]] void refuse(RosRefusal reason, std::string words) {
  throw RosRefused{reason, std::move(words)};
}

void check_frame(const std::string& frame_id, const std::string& frame) {
  if (frame_id != frame) refuse(RosRefusal::kFrame, "frame_id '" + frame_id + "': must be '" + frame + "'");
}

// Of a point or a vector. Refuses what is not within the bound on an axis.
template <class Xyz>
Eigen::Vector3d bounded(const Xyz& xyz, double bound, const char* what) {
  const Eigen::Vector3d values(xyz.x, xyz.y, xyz.z);
  if (!(values.array().abs() <= bound).all())
    refuse(RosRefusal::kValue, std::string(what) + " " + text_of(values) + ": must be within " + text_of(bound));
  return values;
}

Eigen::Quaterniond orientation_of(const Pose& pose) {
  const auto& q = pose.orientation;
  const Eigen::Quaterniond orientation(q.w, q.x, q.y, q.z);
  if (!(std::abs(orientation.norm() - 1.0) <= kUnit))
    refuse(RosRefusal::kQuaternion,
           "orientation (x, y, z, w) " + text_of(orientation.coeffs()) + ": must have length 1");
  return orientation.normalized();
}

Eigen::Vector3d position_of(const Pose& pose) {
  return bounded(pose.position, kMaxPosition_m, "position");
}

double yaw_of(const Eigen::Quaterniond& orientation) {
  const Eigen::Vector3d ahead = orientation * Eigen::Vector3d::UnitX();
  return direction(ahead.x(), ahead.y());
}

bool is_shape(const Marker& marker) {
  return marker.type == Marker::CUBE || marker.type == Marker::SPHERE || marker.type == Marker::CYLINDER;
}

std::string name_of(const std::string& ns, std::int32_t id) {
  return ns + "/" + std::to_string(id);
}

// The same for the same name, always.
std::int32_t obstacle_id_of(const std::string& name) {
  const std::span bytes(reinterpret_cast<const std::uint8_t*>(name.data()), name.size());
  return static_cast<std::int32_t>(crc32(bytes) & 0x7FFFFFFF);
}

obstacle_t obstacle_of(const Marker& marker) {
  const Eigen::Vector3d scale = bounded(marker.scale, kMaxObstacleSize_m, "scale");
  if (!(scale.array() > 0.0).all()) refuse(RosRefusal::kValue, "scale " + text_of(scale) + ": must be greater than 0");
  const Eigen::Quaterniond orientation = orientation_of(marker.pose);
  obstacle_t obstacle{};
  Eigen::Map<Eigen::Vector3d>(obstacle.position) = position_of(marker.pose);
  Eigen::Map<Eigen::Vector3d> size(obstacle.size);
  const bool is_upright = std::abs((orientation * Eigen::Vector3d::UnitZ()).z()) >= kUpright;
  if (marker.type == Marker::SPHERE) {
    obstacle.shape = obstacle_t::kSphere;
    size.x() = scale.maxCoeff();
  } else if (marker.type == Marker::CYLINDER && is_upright) {
    obstacle.shape = obstacle_t::kColumn;
    size.x() = std::max(scale.x(), scale.y());
    size.y() = scale.z();
  } else {
    obstacle.shape = obstacle_t::kBox;
    obstacle.yaw = yaw_of(orientation);
    const Eigen::Matrix3d level =
        Eigen::AngleAxisd(-obstacle.yaw, Eigen::Vector3d::UnitZ()) * orientation.toRotationMatrix();
    size = (level.cwiseAbs() * scale).cwiseMin(kMaxObstacleSize_m);
  }
  return obstacle;
}

// Of an arrow that says where something will be in a second, W [m/s].
Eigen::Vector3d velocity_of(const Marker& arrow) {
  if (arrow.points.size() != 2)
    refuse(RosRefusal::kLayout,
           "velocity: an arrow of " + std::to_string(arrow.points.size()) + " points: must have 2");
  const Eigen::Vector3d from = bounded(arrow.points[0], kMaxPosition_m, "velocity from");
  const Eigen::Vector3d velocity =
      orientation_of(arrow.pose) * (bounded(arrow.points[1], kMaxPosition_m, "velocity to") - from);
  if (!(velocity.array().abs() <= kMaxVelocity_mps).all())
    refuse(RosRefusal::kValue, "velocity " + text_of(velocity) + ": must be within " + text_of(kMaxVelocity_mps));
  return velocity;
}

// Where a coordinate stands in a point.
struct Coordinate {
  std::size_t offset = 0;
  bool is_double = false;
};

Coordinate coordinate_of(const PointCloud2& cloud, const std::string& name) {
  const auto field = std::ranges::find(cloud.fields, name, &PointField::name);
  if (field == cloud.fields.end()) refuse(RosRefusal::kLayout, "has no field " + name);
  if (field->datatype != PointField::FLOAT32 && field->datatype != PointField::FLOAT64)
    refuse(RosRefusal::kLayout, "field " + name + ": must be FLOAT32 or FLOAT64");
  const Coordinate coordinate{field->offset, field->datatype == PointField::FLOAT64};
  if (coordinate.offset + (coordinate.is_double ? sizeof(double) : sizeof(float)) > cloud.point_step)
    refuse(RosRefusal::kLayout, "field " + name + ": must end within point_step");
  return coordinate;
}

double read(const std::uint8_t* point, const Coordinate& coordinate) {
  if (coordinate.is_double) {
    double value;
    std::memcpy(&value, point + coordinate.offset, sizeof value);
    return value;
  }
  float value;
  std::memcpy(&value, point + coordinate.offset, sizeof value);
  return value;
}

}  // namespace

const char* to_string(RosRefusal reason) {
  switch (reason) {
    case RosRefusal::kFrame:
      return "frame";
    case RosRefusal::kTime:
      return "time";
    case RosRefusal::kOrder:
      return "order";
    case RosRefusal::kValue:
      return "value";
    case RosRefusal::kQuaternion:
      return "quaternion";
    case RosRefusal::kLayout:
      return "layout";
    case RosRefusal::kPose:
      return "pose";
  }
  return "?";
}

Utime utime_of(const builtin_interfaces::msg::Time& stamp) {
  return to_utime(std::int64_t{stamp.sec} * 1'000'000 + stamp.nanosec / 1000);
}

sogm_swarm::robot_state_t state_of(const nav_msgs::msg::Odometry& odometry, const std::string& frame) {
  check_frame(odometry.header.frame_id, frame);
  const Eigen::Quaterniond orientation = orientation_of(odometry.pose.pose);
  Eigen::Vector3d velocity = bounded(odometry.twist.twist.linear, kMaxVelocity_mps, "velocity");
  if (odometry.child_frame_id != frame) velocity = orientation * velocity;
  sogm_swarm::robot_state_t state{};
  Eigen::Map<Eigen::Vector3d>(state.position) = position_of(odometry.pose.pose);
  Eigen::Map<Eigen::Vector3d>(state.velocity) = velocity.cwiseMax(-kMaxVelocity_mps).cwiseMin(kMaxVelocity_mps);
  state.yaw = yaw_of(orientation);
  return state;
}

TimedPose body_pose_of(const nav_msgs::msg::Odometry& odometry) {
  return {to_seconds(utime_of(odometry.header.stamp).time_since_epoch()), position_of(odometry.pose.pose),
          orientation_of(odometry.pose.pose)};
}

sogm_swarm::goal_t goal_of(const geometry_msgs::msg::PoseStamped& pose, const std::string& frame) {
  check_frame(pose.header.frame_id, frame);
  (void)orientation_of(pose.pose);
  sogm_swarm::goal_t goal{};
  goal.num_waypoints = 1;
  goal.waypoints.resize(1);
  Eigen::Map<Eigen::Vector3d>(goal.waypoints[0].position) = position_of(pose.pose);
  return goal;
}

MarkerObstacles obstacles_of(const visualization_msgs::msg::MarkerArray& markers, const std::string& frame,
                             const MarkerSigmas& sigmas, Utime now) {
  struct Shape {
    obstacle_t obstacle;
    Utime utime;
  };
  MarkerObstacles found{};
  std::map<std::string, Shape> shapes;                // by the names of their markers
  std::map<std::string, Eigen::Vector3d> velocities;  // by the names of what has them
  for (const Marker& marker : markers.markers) {
    const std::string name = name_of(marker.ns, marker.id);
    if (marker.action == Marker::DELETEALL) {
      shapes.clear();
      velocities.clear();
      found.message.complete = true;
    } else if (marker.action == Marker::DELETE) {
      shapes.erase(name);
    } else if (is_shape(marker)) {
      check_frame(marker.header.frame_id, frame);
      shapes.insert_or_assign(name, Shape{obstacle_of(marker), utime_of(marker.header.stamp)});
    } else if (marker.type == Marker::ARROW && marker.ns.ends_with(kVelocity)) {
      check_frame(marker.header.frame_id, frame);
      const std::string of = name_of(marker.ns.substr(0, marker.ns.size() - kVelocity.size()), marker.id);
      velocities.insert_or_assign(of, velocity_of(marker));
    } else {
      ++found.passed_over;
    }
  }
  if (shapes.size() > static_cast<std::size_t>(kMaxTrackedObstacles))
    refuse(RosRefusal::kValue,
           std::to_string(shapes.size()) + " obstacles: must be at most " + std::to_string(kMaxTrackedObstacles));
  std::optional<Utime> newest;
  for (const auto& [name, shape] : shapes) newest = std::max(newest.value_or(shape.utime), shape.utime);
  for (auto& [name, shape] : shapes) {
    if (*newest - shape.utime > kOneArray) refuse(RosRefusal::kTime, "stamps of its markers differ by more than 1 s");
    obstacle_t& obstacle = found.message.obstacles.emplace_back(shape.obstacle);
    obstacle.id = obstacle_id_of(name);
    obstacle.age_s = to_seconds(*newest - shape.utime);
    obstacle.position_sigma = static_cast<float>(sigmas.position_m);
    obstacle.velocity_sigma = -1.0f;
    if (const auto velocity = velocities.find(name); velocity != velocities.end()) {
      Eigen::Map<Eigen::Vector3d>(obstacle.velocity) = velocity->second;
      obstacle.velocity_sigma = static_cast<float>(sigmas.velocity_mps);
    }
  }
  found.message.num_obstacles = static_cast<std::int32_t>(found.message.obstacles.size());
  found.message.header.utime = to_us(newest.value_or(now));
  return found;
}

std::vector<Eigen::Vector3d> points_of(const PointCloud2& cloud) {
  if (cloud.is_bigendian) refuse(RosRefusal::kLayout, "is_bigendian: must be false");
  const std::array<Coordinate, 3> coordinates = {coordinate_of(cloud, "x"), coordinate_of(cloud, "y"),
                                                 coordinate_of(cloud, "z")};
  if (std::uint64_t{cloud.width} * cloud.point_step > cloud.row_step ||
      std::uint64_t{cloud.height} * cloud.row_step > cloud.data.size())
    refuse(RosRefusal::kLayout,
           "width, height, point_step, row_step: must fit its " + std::to_string(cloud.data.size()) + " bytes");
  std::vector<Eigen::Vector3d> points;
  if (cloud.width == 0) return points;  // however many rows there are of nothing
  for (std::size_t row = 0; row < cloud.height; ++row) {
    for (std::size_t column = 0; column < cloud.width; ++column) {
      const std::uint8_t* const bytes = cloud.data.data() + row * cloud.row_step + column * cloud.point_step;
      const Eigen::Vector3d point(read(bytes, coordinates[0]), read(bytes, coordinates[1]),
                                  read(bytes, coordinates[2]));
      if ((point.array().abs() <= kMaxPosition_m).all()) points.push_back(point);
    }
  }
  return points;
}

}  // namespace swarm
