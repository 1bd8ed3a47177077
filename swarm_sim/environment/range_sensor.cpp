#include "swarm_sim/environment/range_sensor.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "lcmtypes/bus/portable_math.h"

namespace swarm {
namespace {

using sogm_swarm::depth_image_t;
using sogm_swarm::lidar_scan_t;

constexpr double kDegree = std::numbers::pi / 180.0;

// A LiDAR that turns ten times a second, and a depth camera.
constexpr int kBeams = 16, kAzimuths = 900;
constexpr double kLowestBeam_rad = -15.0 * kDegree, kBetweenBeams_rad = 2.0 * kDegree;
constexpr double kLidarRange_m = 40.0, kLidarLeast_m = 0.1;
constexpr Duration kLidarPeriod = 100ms;
constexpr double kPointUnit_m = 0.005;
constexpr int kWidth = 160, kHeight = 120;
constexpr double kHalfWidth_rad = 43.5 * kDegree, kHalfHeight_rad = 29.0 * kDegree;
constexpr double kDepthRange_m = 20.0, kDepthLeast_m = 0.3;

// What both do: ranges err by so much, more with the square of the distance for a camera; rays are lost; rays that meet
// an edge mix what is before it with what is behind.
constexpr double kNoise_m = 0.02, kDepthNoise_m = 0.005, kDepthNoisePerM2 = 0.0015;
constexpr double kLost = 0.02, kMixed = 0.2, kEdge_m = 0.3;

constexpr double kStep_s = 0.01;

}  // namespace

Eigen::Quaterniond attitude_of(const Eigen::Vector3d& acceleration, double yaw_rad) {
  const Eigen::Vector3d up = (acceleration + Eigen::Vector3d(0, 0, MotionLimits::kGravity_mps2)).normalized();
  const auto [sin, cos] = sin_cos(yaw_rad);
  const Eigen::Vector3d left = up.cross(Eigen::Vector3d(cos, sin, 0)).normalized();
  Eigen::Matrix3d axes;
  axes << left.cross(up), left, up;
  return Eigen::Quaterniond(axes);
}

Pose pose_of(const Mount& mount) {
  const auto about = [](double degrees, const Eigen::Vector3d& axis) {
    const SinCos half = sin_cos(0.5 * degrees * kDegree);
    const Eigen::Vector3d turn = half.sin * axis;
    return Eigen::Quaterniond(half.cos, turn.x(), turn.y(), turn.z());
  };
  return {mount.position,
          about(mount.yaw_deg, Eigen::Vector3d::UnitZ()) * about(mount.pitch_deg, Eigen::Vector3d::UnitY())};
}

RangeSensors::RangeSensors(const World& world, int robot_id)
    : options_(world.sensor),
      random_(seed_of(world.name + " range sensor " + std::to_string(robot_id))),
      position_error_(&random_),
      turn_error_(&random_) {
  for (const Mount& mount : parse_mounts(options_.mounts)) mounts_.push_back(pose_of(mount));
  if (options_.kind == "lidar") {
    for (int beam = 0; beam < kBeams; ++beam) {
      const SinCos up = sin_cos(kLowestBeam_rad + beam * kBetweenBeams_rad);
      for (int i = 0; i < kAzimuths; ++i) {
        const SinCos around = sin_cos(2.0 * std::numbers::pi * i / kAzimuths);
        directions_.emplace_back(up.cos * around.cos, up.cos * around.sin, up.sin);
      }
    }
  } else if (options_.kind == "depth") {
    const SinCos side = sin_cos(kHalfWidth_rad), up = sin_cos(kHalfHeight_rad);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        directions_.push_back(Eigen::Vector3d((2.0 * (x + 0.5) / kWidth - 1.0) * side.sin / side.cos,
                                              (2.0 * (y + 0.5) / kHeight - 1.0) * up.sin / up.cos, 1.0)
                                  .normalized());
  }
}

Duration RangeSensors::period() const {
  return options_.kind == "lidar" ? kLidarPeriod : to_duration(1.0 / options_.rate_hz);
}

Pose RangeSensors::with_error(const Pose& pose, double t_s) {
  if (options_.pose_noise_m == 0.0 && options_.pose_noise_deg == 0.0) return pose;
  for (; last_t_s_ + kStep_s <= t_s; last_t_s_ += kStep_s) {
    position_error_.step(kStep_s, &random_);
    turn_error_.step(kStep_s, &random_);
  }
  Pose wrong = pose;
  wrong.position += position_error_.value(options_.pose_noise_m);
  const Eigen::Vector3d turn = 0.5 * turn_error_.value(options_.pose_noise_deg * kDegree);  // of a quaternion
  wrong.orientation =
      Eigen::Quaterniond(Eigen::Quaterniond(1.0, turn.x(), turn.y(), turn.z()).normalized() * pose.orientation);
  return wrong;
}

void RangeSensors::measure(RayCaster& caster, const Eigen::Matrix3d& to_world, int width, double least_m,
                           double range_m, double noise_per_m2) {
  const std::size_t rays = directions_.size();
  true_m_.resize(rays);
  measured_m_.resize(rays);
  for (std::size_t i = 0; i < rays; ++i) true_m_[i] = caster.cast(to_world * directions_[i]);
  const double noise_m = options_.kind == "lidar" ? kNoise_m : kDepthNoise_m;
  for (std::size_t i = 0; i < rays; ++i) {
    double length = true_m_[i];
    // The ray's neighbours: beside it, and below it.
    for (const std::size_t step : {std::size_t{1}, static_cast<std::size_t>(width)}) {
      const bool ends_row = step == 1 && (i + 1) % static_cast<std::size_t>(width) == 0;
      if (i + step >= rays || ends_row) continue;
      const double other = true_m_[i + step];
      if (std::abs(other - length) > kEdge_m && random_.uniform() < kMixed)
        length += random_.uniform() * (other - length);
    }
    const bool is_lost = random_.uniform() < kLost;
    if (length < range_m) length += (noise_m + noise_per_m2 * length * length) * random_.normal();
    measured_m_[i] = is_lost || length < least_m ? 0.0 : std::min(length, range_m);
  }
}

namespace {

template <class Message>
void set_pose(const Pose& pose, Message* message) {
  Eigen::Map<Eigen::Vector3d>(message->position) = pose.position;
  const Eigen::Quaterniond& q = pose.orientation;
  message->orientation[0] = q.w(), message->orientation[1] = q.x();
  message->orientation[2] = q.y(), message->orientation[3] = q.z();
}

}  // namespace

std::vector<lidar_scan_t> RangeSensors::scan(RayCaster& caster, const std::vector<RayCaster::Ball>& robots, double t_s,
                                             const Pose& truth, const Pose& believed) {
  constexpr std::size_t kPointsPerPart = lidar_scan_t::kMaxCoordinates / 3;
  std::vector<lidar_scan_t> messages;
  for (std::size_t sensor = 0; sensor < mounts_.size(); ++sensor) {
    const Pose at = truth * mounts_[sensor];
    caster.look(t_s, at.position, kLidarRange_m, robots);
    measure(caster, at.orientation.toRotationMatrix(), kAzimuths, kLidarLeast_m, kLidarRange_m, 0.0);
    const Pose pose = with_error(believed, t_s) * mounts_[sensor];
    const std::size_t parts = (directions_.size() + kPointsPerPart - 1) / kPointsPerPart;
    for (std::size_t p = 0; p < parts; ++p) {
      lidar_scan_t& part = messages.emplace_back();
      part.sensor = static_cast<std::int16_t>(sensor);
      set_pose(pose, &part);
      part.part = static_cast<std::int16_t>(p);
      part.num_parts = static_cast<std::int16_t>(parts);
      for (std::size_t i = p * kPointsPerPart; i < std::min((p + 1) * kPointsPerPart, directions_.size()); ++i) {
        if (measured_m_[i] == 0.0) continue;
        const Eigen::Vector3d point = measured_m_[i] / kPointUnit_m * directions_[i];
        for (const double value : point) part.coordinates.push_back(static_cast<std::int16_t>(std::floor(value + 0.5)));
      }
      part.num_coordinates = static_cast<std::int32_t>(part.coordinates.size());
    }
  }
  return messages;
}

std::vector<depth_image_t> RangeSensors::images(RayCaster& caster, const std::vector<RayCaster::Ball>& robots,
                                                double t_s, const Pose& truth, const Pose& believed) {
  // x ahead, y left, z up of the body; z ahead, x right, y down of the camera.
  Eigen::Matrix3d axes;
  axes << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Pose camera{Eigen::Vector3d::Zero(), Eigen::Quaterniond(axes)};
  const SinCos side = sin_cos(kHalfWidth_rad), up = sin_cos(kHalfHeight_rad);
  std::vector<depth_image_t> messages;
  for (std::size_t sensor = 0; sensor < mounts_.size(); ++sensor) {
    const Pose at = truth * mounts_[sensor] * camera;
    caster.look(t_s, at.position, kDepthRange_m, robots);
    measure(caster, at.orientation.toRotationMatrix(), kWidth, kDepthLeast_m, kDepthRange_m, kDepthNoisePerM2);
    depth_image_t& message = messages.emplace_back();
    message.sensor = static_cast<std::int16_t>(sensor);
    set_pose(with_error(believed, t_s) * mounts_[sensor] * camera, &message);
    message.focal_px[0] = static_cast<float>(kWidth / 2.0 * side.cos / side.sin);
    message.focal_px[1] = static_cast<float>(kHeight / 2.0 * up.cos / up.sin);
    message.center_px[0] = kWidth / 2.0f - 0.5f, message.center_px[1] = kHeight / 2.0f - 0.5f;
    message.width = kWidth;
    message.num_pixels = kWidth * kHeight;
    message.depth_mm.reserve(measured_m_.size());
    for (std::size_t i = 0; i < measured_m_.size(); ++i)
      message.depth_mm.push_back(static_cast<std::int16_t>(1e3 * measured_m_[i] * directions_[i].z() + 0.5));
  }
  return messages;
}

}  // namespace swarm
