#include "tools/scans/scan_player.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/portable_math.h"
#include "sogm_swarm/lidar_scan_t.hpp"
#include "sogm_swarm/robot_state_t.hpp"
#include "tools/scans/point_cloud_file.h"

namespace swarm {
namespace {

using sogm_swarm::lidar_scan_t;

constexpr double kPointUnit_m = 0.005;
constexpr double kReach_m = 32'000 * kPointUnit_m;  // what is further away is free up to there
constexpr std::size_t kPointsPerPart = lidar_scan_t::kMaxCoordinates / 3;
constexpr std::size_t kMostPoints = kPointsPerPart * lidar_scan_t::kMaxParts;
constexpr Duration kStatePeriod = 20ms, kLate = 100ms;

// Of them evenly so many that they fit.
void thin(std::size_t every, std::vector<Eigen::Vector3d>* points) {
  for (std::size_t i = 0; i * every < points->size(); ++i) (*points)[i] = (*points)[i * every];
  points->resize((points->size() + every - 1) / every);
}

}  // namespace

ScanPlayer::ScanPlayer(const ScanPlayerConfig& config, std::vector<RecordedScan> scans, PoseTrack poses,
                       std::int32_t boot)
    : config_(config),
      scans_(std::move(scans)),
      poses_(std::move(poses)),
      scan_headers_(config.robot_id, boot),
      state_headers_(config.robot_id, boot) {
  for (const RecordedScan& scan : scans_) {
    if (scan.t_s < poses_.begin_s() || scan.t_s > poses_.end_s())
      throw std::runtime_error(scan.file.string() + ": time " + std::to_string(scan.t_s) +
                               ": must be within that of the poses, [" + std::to_string(poses_.begin_s()) + ", " +
                               std::to_string(poses_.end_s()) + "] s");
  }
}

double ScanPlayer::played_at(Utime utime) const {
  return scans_.front().t_s + config_.speed * to_seconds(utime - *began_);
}

Utime ScanPlayer::due(double t_s) const {
  return *began_ + to_duration((t_s - scans_.front().t_s) / config_.speed);
}

Utime ScanPlayer::step(Utime now, Outbox& outbox) {
  if (is_over()) return kNever;
  if (!began_) {
    next_ = read_point_cloud(scans_.front().file);
    began_ = now;
  }
  if (config_.state && now >= state_.due(now, kStatePeriod)) {
    publish_state(now, outbox);
    state_.done(now);
  }
  const Utime scan_due = due(scans_[played_].t_s);
  if (now >= scan_due) {
    if (now > scan_due + kLate) ++late_;
    play(scan_due, scans_[played_].t_s, outbox);
    if (++played_ == scans_.size()) return kNever;
    next_ = read_point_cloud(scans_[played_].file);
  }
  const Utime wake = due(scans_[played_].t_s);
  return std::max(config_.state ? std::min(wake, state_.due(now, kStatePeriod)) : wake, now + 1us);
}

void ScanPlayer::play(Utime utime, double t_s, Outbox& outbox) {
  const std::size_t every = (next_.size() + kMostPoints - 1) / kMostPoints;
  if (every > 1) thin(every, &next_), ++thinned_;
  points_ += std::ssize(next_);
  const TimedPose pose = poses_.at(t_s);
  lidar_scan_t scan{};
  scan.header = scan_headers_.next(utime);
  scan.sensor = static_cast<std::int16_t>(config_.sensor);
  Eigen::Map<Eigen::Vector3d>(scan.position) = pose.position;
  scan.orientation[0] = pose.orientation.w();
  Eigen::Map<Eigen::Vector3d>(scan.orientation + 1) = pose.orientation.vec();
  scan.num_parts =
      static_cast<std::int16_t>(std::max<std::size_t>(1, (next_.size() + kPointsPerPart - 1) / kPointsPerPart));
  for (; scan.part < scan.num_parts; ++scan.part) {
    const std::size_t from = static_cast<std::size_t>(scan.part) * kPointsPerPart;
    scan.coordinates.clear();
    for (std::size_t i = from; i < std::min(from + kPointsPerPart, next_.size()); ++i) {
      const double reach_m = next_[i].cwiseAbs().maxCoeff();
      const Eigen::Vector3d point = next_[i] * (reach_m > kReach_m ? kReach_m / reach_m : 1.0) / kPointUnit_m;
      for (const double value : point) scan.coordinates.push_back(static_cast<std::int16_t>(std::floor(value + 0.5)));
    }
    scan.num_coordinates = static_cast<std::int32_t>(scan.coordinates.size());
    outbox.publish(BusId::kOnboard, channel::kLidarScan, scan);
  }
}

void ScanPlayer::publish_state(Utime now, Outbox& outbox) {
  const double t_s = played_at(now);
  const TimedPose pose = poses_.at(t_s);
  sogm_swarm::robot_state_t state{};
  state.header = state_headers_.next(now);
  Eigen::Map<Eigen::Vector3d>(state.position) = pose.position;
  Eigen::Map<Eigen::Vector3d>(state.velocity) = config_.speed * poses_.velocity_at(t_s);
  const Eigen::Vector3d ahead = pose.orientation * Eigen::Vector3d::UnitX();
  state.yaw = direction(ahead.x(), ahead.y());
  outbox.publish(BusId::kOnboard, channel::kRobotState, state);
}

}  // namespace swarm
