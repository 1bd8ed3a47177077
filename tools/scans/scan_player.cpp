#include "tools/scans/scan_player.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/portable_math.h"
#include "sogm_swarm/robot_state_t.hpp"
#include "tools/scans/point_cloud_file.h"
#include "tools/scans/scan_message.h"

namespace swarm {
namespace {

constexpr Duration kStatePeriod = 20ms, kLate = 100ms;

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
  if (thin_to_fit(&next_)) ++thinned_;
  points_ += std::ssize(next_);
  const TimedPose pose = poses_.at(t_s);
  publish_scan(scan_headers_.next(utime), config_.sensor, pose.position, pose.orientation, next_, outbox);
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
