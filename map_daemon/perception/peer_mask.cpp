#include "map_daemon/perception/peer_mask.h"

namespace swarm {

void PeerMask::hear(const sogm_swarm::announcement_t& announcement, Utime now) {
  robots_.insert_or_assign(announcement.header.robot_id,
                           Robot{motion_of(announcement), double{announcement.radius}, now});
}

void PeerMask::shift(Duration step) {
  for (auto& [id, robot] : robots_) {
    robot.heard += step;
    robot.motion.committed.shift(step);
    robot.motion.next.shift(step);
  }
}

const std::vector<PeerMask::Ball>& PeerMask::at(Utime utime) {
  std::erase_if(robots_, [&](const auto& entry) { return utime - entry.second.heard > timeout_; });
  balls_.clear();
  for (const auto& [id, robot] : robots_)
    balls_.push_back({robot.motion.at(utime).position, robot.radius_m + margin_m_});
  return balls_;
}

}  // namespace swarm
