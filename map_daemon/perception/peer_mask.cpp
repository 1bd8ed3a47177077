#include "map_daemon/perception/peer_mask.h"

namespace swarm {

void PeerMask::hear(const sogm_swarm::announcement_t& announcement, Utime now) {
  const Motion motion = motion_of(announcement);
  Robot& robot = robots_[announcement.header.robot_id];
  const auto begins_later = [&](const Trajectory& flown) {
    return !flown.empty() && flown.start_utime() < motion.committed.start_utime();
  };
  if (begins_later(robot.motion.committed)) robot.before = robot.motion.committed;
  robot.motion = motion;
  robot.radius_m = double{announcement.radius};
  robot.heard = now;
}

void PeerMask::shift(Duration step) {
  for (auto& [id, robot] : robots_) {
    robot.heard += step;
    robot.motion.committed.shift(step);
    robot.motion.next.shift(step);
    robot.before.shift(step);
  }
}

const std::vector<PeerMask::Ball>& PeerMask::at(Utime utime) {
  std::erase_if(robots_, [&](const auto& entry) { return utime - entry.second.heard > timeout_; });
  balls_.clear();
  for (const auto& [id, robot] : robots_) {
    const bool is_before = utime < robot.motion.committed.start_utime() && !robot.before.empty();
    const MotionState state = is_before ? robot.before.at(utime) : robot.motion.at(utime);
    balls_.push_back({state.position, robot.radius_m + margin_m_});
  }
  return balls_;
}

}  // namespace swarm
