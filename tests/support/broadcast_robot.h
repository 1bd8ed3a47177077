// One node among peers whose announcements the test writes.
#pragma once

#include <algorithm>
#include <map>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/crc32.h"
#include "planner_daemon/coordination/broadcast_node.h"
#include "tests/support/harness.h"

namespace swarm::test {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;
using sogm_swarm::broadcast_status_t;
using sogm_swarm::candidate_t;
using sogm_swarm::trajectory_t;

inline constexpr std::int32_t kBoot = 77;
inline constexpr std::uint8_t kRosterIds[] = {0, 0, 0, 1, 0, 2};
inline const auto kRosterCrc = static_cast<std::int32_t>(crc32(kRosterIds));

inline bool same(const trajectory_t& a, const trajectory_t& b) {
  return a.seq == b.seq && a.start_utime == b.start_utime && a.piece_us == b.piece_us && a.num_pieces == b.num_pieces &&
         std::equal(&a.knots[0][0], &a.knots[0][0] + 11 * 9, &b.knots[0][0]);
}

// A peer as its announcements show it.
struct Peer {
  int id;
  Trajectory committed;
  Trajectory pending = {};
  std::int8_t pending_state = announcement_t::kNone;
  Utime stamp{};
  ack_t about_us{kBoot, 0, ack_t::kNone};  // to the robot under test
  std::int32_t boot = 9;
  std::int64_t seq = 0;
  std::int32_t least_delay_us = announcement_t::kUnknown;

  // To robot `to` of the roster 0, 1, 2.
  announcement_t message(Utime utime, int to) {
    announcement_t message{};
    message.header = make_header(id, boot, seq++, utime);
    message.radius = 0.2f;
    message.committed = committed.to_wire();
    message.pending = pending.to_wire();
    message.pending_state = pending_state;
    message.pending_stamp = to_us(stamp);
    message.roster_crc = kRosterCrc;
    message.least_delay_us = least_delay_us;
    message.num_acks = 3;
    message.acks.assign(3, {-1, 0, ack_t::kNone});
    message.acks[static_cast<std::size_t>(to)] = about_us;
    return message;
  }
  void pends(const Trajectory& trajectory, Utime its_stamp, std::int8_t state = announcement_t::kAnnounced) {
    pending = trajectory;
    pending.set_seq(pending.seq() + 100);
    pending_state = state;
    stamp = its_stamp;
  }
  void pends_nothing() { pending = {}, pending_state = announcement_t::kNone, stamp = {}; }
};

// What outlives a node, and is there before it.
struct Kept {
  MemoryPromiseStore promises;
};

// Robot `id` at (0, 0, 1), which has heard robots 0, 1 and 2 hover 10 m apart, itself excepted.
class Robot : public Kept, public Bench<BroadcastNode> {
 public:
  explicit Robot(int id, bool started = true, MemoryPromiseStore store = {}, std::int32_t boot = kBoot,
                 const MotionLimits& limits = {}, double give_up_after_s = 0.0)
      : Kept{store}, Bench(make_config(id, limits, give_up_after_s), promises, boot), peers_agree(id == 0), id_(id) {
    for (int other = 0; other < 3; ++other) {
      if (other != id) peers.emplace(other, Peer{other, Trajectory::hover(1, kStart, {10.0 + 10 * other, 0, 1})});
    }
    if (!started) return;
    send_state();
    for (auto& [other, peer] : peers) hear(other);
  }
  static BroadcastConfig make_config(int id, const MotionLimits& limits = {}, double give_up_after_s = 0.0) {
    BroadcastConfig config;
    config.limits = limits;
    config.robot_id = id;
    config.roster = {0, 1, 2};
    config.swarm_rate_hz = 1e9;
    config.give_up_after_s = give_up_after_s;  // 0: peers speak when the test has something to say
    return config;
  }

  void send_state() { send(channel::kRobotState, state_at(id_, {0, 0, 1}, next_state_++, now)); }
  void hear(int other) { send(channel::kAnnouncement, peers.at(other).message(now, id_), BusId::kSwarm); }
  // `other` judges our pending trajectory `seq`.
  void hear_verdict(int other, std::int32_t seq, std::int8_t verdict, std::int32_t boot = kBoot) {
    peers.at(other).about_us = {boot, seq, verdict};
    hear(other);
  }
  // From the motion in force after `lead_s` to rest at `to`.
  Trajectory plan(const Eigen::Vector3d& to, double lead_s = 0.1, double seconds = 2.0) const {
    const Utime start = now + to_duration(lead_s);
    return quintic_to(node.motion()->at(start), start, to, seconds);
  }
  void propose(const Trajectory& trajectory, bool urgent = false) {
    candidate_t candidate{};
    candidate.urgent = urgent ? 1 : 0;
    candidate.header = make_header(id_, 1, next_candidate_++, std::min(now, trajectory.start_utime()));
    candidate.trajectory = trajectory.to_wire();
    send(channel::kCandidate, candidate);
    if (peers_agree) agree();
  }
  // All peers acknowledge what is pending.
  void agree() {
    const std::int32_t seq = node.protocol().pending().seq();
    for (auto& [other, peer] : peers) {
      if (seq == 0) continue;
      peer.about_us = {peer.about_us.peer_boot, seq, ack_t::kAck};
      hear(other);
    }
  }
  // 50 us later, when it may have announced again.
  announcement_t announced() {
    run_for(50e-6);
    return out.newest<announcement_t>(channel::kAnnouncement, BusId::kSwarm);
  }
  // Our verdict about robot `other`.
  ack_t verdict_on(int other) { return announced().acks[static_cast<std::size_t>(other)]; }

  std::map<int, Peer> peers;
  bool peers_agree;  // with what is proposed, at once

 private:
  int id_;
  std::int64_t next_state_ = 0, next_candidate_ = 0;
};

}  // namespace swarm::test
