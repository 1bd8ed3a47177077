#include "planner_daemon/broadcast_node.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "lcmtypes/bus/channels.h"
#include "map_daemon/portable_math.h"
#include "planner_daemon/deconfliction.h"

namespace swarm {
namespace {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;

constexpr std::int64_t kMaxAge_us = 1'000'000;  // of messages from peers and planner
constexpr std::int64_t kMaxBranchAhead_us = 2'000'000;
constexpr std::int64_t kStatusPeriod_us = 1'000'000;

std::int64_t to_us(double seconds) {
  return std::llround(seconds * 1e6);
}

double wrap_angle(double angle) {
  return std::remainder(angle, 2 * std::numbers::pi);
}

}  // namespace

const char* to_string(Rejection rejection) {
  static constexpr const char* kNames[kNumRejections] = {"none", "no committed",  "waiting", "busy",
                                                         "time", "discontinuous", "limits",  "conflict"};
  return kNames[static_cast<int>(rejection)];
}

void declare(OptionSet& options, BroadcastConfig& config) {
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("roster", &config.roster, 0, 32767, "ids of all robots that fly; this one may be among them");
  options.add("radius", &config.radius_m, 0.01, 10, "m", "of the sphere that holds the robot");
  options.add("v-max", &config.v_max, 0.01, 100, "m/s", "speed limit per axis");
  options.add("a-max", &config.a_max, 0.01, 1000, "m/s^2", "acceleration limit per axis");
  options.add("separation", &config.separation_m, 0, 10, "m", "kept between the surfaces of committed motions");
  options.add("announce-period", &config.announce_s, 0.005, 10, "s", "repetition of the announcement");
  options.add("setpoint-rate", &config.setpoint_rate_hz, 1, 1000, "Hz", "of setpoints");
  options.add("yaw-rate-max", &config.yaw_rate_max, 0, 100, "rad/s",
              "how fast the robot turns into its direction of flight");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s", "messages from further in the future are refused");
}

void verify(const BroadcastConfig& config) {
  if (config.roster.size() > 49)
    throw OptionError("--roster: " + std::to_string(config.roster.size()) + " robots; at most 49");
}

BroadcastNode::BroadcastNode(const BroadcastConfig& config, std::int32_t boot)
    : config_(config),
      boot_(boot),
      announcement_headers_(config.robot_id, boot),
      setpoint_headers_(config.robot_id, boot),
      status_headers_(config.robot_id, boot) {
  verify(config);
  for (int id : config.roster) {
    if (id != config.robot_id) peers_[id];
  }
}

std::vector<Subscription> BroadcastNode::subscriptions() const {
  return {{BusId::kOnboard, channel::kRobotState},
          {BusId::kOnboard, channel::kCandidate},
          {BusId::kSwarm, channel::kTrajectory}};
}

void BroadcastNode::on_message(std::int64_t now_us, BusId bus, std::string_view channel,
                               std::span<const std::uint8_t> bytes, Outbox& outbox) {
  Refusal refusal = Refusal::kNone;
  advance(now_us);
  if (bus == BusId::kSwarm) {
    refusal = on_peer(now_us, bytes, outbox);
  } else if (channel == channel::kRobotState) {
    refusal = on_state(now_us, bytes);
  } else if (channel == channel::kCandidate) {
    refusal = on_candidate(now_us, bytes);
  }
  if (refusal != Refusal::kNone) refused_.count(refusal);
  advance(now_us);
  if (changed_ && motion_) announce(now_us, outbox);
}

Refusal BroadcastNode::on_state(std::int64_t now_us, std::span<const std::uint8_t> bytes) {
  sogm_swarm::robot_state_t state;
  if (const Refusal refusal = decode(bytes, &state); refusal != Refusal::kNone) return refusal;
  if (state.header.robot_id != config_.robot_id) return Refusal::kRobot;
  if (const Refusal refusal = check_time(state.header.utime, now_us, kMaxAge_us, to_us(config_.clock_limit_s));
      refusal != Refusal::kNone)
    return refusal;
  if (const Refusal refusal = state_gate_.pass(state.header); refusal != Refusal::kNone) return refusal;
  if (!motion_) {  // the first promise: hover where the robot is
    motion_ = Motion{Trajectory::hover(next_seq_++, now_us, Eigen::Vector3d(state.position)), {}};
    yaw_ = state.yaw;
    changed_ = true;
  }
  return Refusal::kNone;
}

Refusal BroadcastNode::on_candidate(std::int64_t now_us, std::span<const std::uint8_t> bytes) {
  sogm_swarm::candidate_t message;
  if (const Refusal refusal = decode(bytes, &message); refusal != Refusal::kNone) return refusal;
  if (message.header.robot_id != config_.robot_id) return Refusal::kRobot;
  if (const Refusal refusal = check_time(message.header.utime, now_us, kMaxAge_us, to_us(config_.clock_limit_s));
      refusal != Refusal::kNone)
    return refusal;
  if (const Refusal refusal = candidate_gate_.pass(message.header); refusal != Refusal::kNone) return refusal;
  ++candidates_;
  Trajectory candidate = Trajectory::from_wire(message.trajectory);
  const Rejection rejection = examine(now_us, candidate);
  ++rejected_[static_cast<std::size_t>(rejection)];
  if (rejection != Rejection::kNone) return Refusal::kNone;
  if (!announced_.empty()) withdraw();  // a newer plan replaces the one that waits
  candidate.set_seq(next_seq_++);
  announced_ = candidate;
  stamp_ = now_us;
  changed_ = true;
  return Refusal::kNone;
}

Rejection BroadcastNode::examine(std::int64_t now_us, const Trajectory& candidate) const {
  if (!motion_) return Rejection::kNoCommitted;
  if (!std::all_of(peers_.begin(), peers_.end(), [](const auto& entry) { return entry.second.heard; }))
    return Rejection::kWaiting;
  if (!motion_->next.empty()) return Rejection::kBusy;
  const std::int64_t start = candidate.start_utime();
  if (candidate.empty() || start <= now_us || start > now_us + kMaxBranchAhead_us) return Rejection::kTime;
  const MotionState branch = motion_->at(start), first = candidate.knot(0);
  if ((branch.position - first.position).norm() > 1e-4 || (branch.velocity - first.velocity).norm() > 1e-3 ||
      (branch.acceleration - first.acceleration).norm() > 1e-2) {
    return Rejection::kDiscontinuous;
  }
  for (std::int64_t t = start; t < candidate.end_utime(); t += 10'000) {
    const MotionState state = candidate.at(t);
    if (state.velocity.cwiseAbs().maxCoeff() > 1.01 * config_.v_max ||
        state.acceleration.cwiseAbs().maxCoeff() > 1.01 * config_.a_max) {
      return Rejection::kLimits;
    }
  }
  for (const auto& [id, peer] : peers_) {
    if (!free_of(candidate, peer.motion, peer.radius_m)) return Rejection::kConflict;
    const bool promised = !peer.announced.empty() && peer.verdict == ack_t::kAck;
    if (promised && !free_of(candidate, {peer.motion.committed, peer.announced}, peer.radius_m))
      return Rejection::kConflict;
  }
  return Rejection::kNone;
}

bool BroadcastNode::free_of(const Trajectory& mine, const Motion& other, double other_radius_m) const {
  const double distance = config_.radius_m + other_radius_m + config_.separation_m;
  return motions_separated({mine, {}}, other, mine.start_utime(), distance);
}

Refusal BroadcastNode::on_peer(std::int64_t now_us, std::span<const std::uint8_t> bytes, Outbox& outbox) {
  announcement_t message;
  if (const Refusal refusal = decode(bytes, &message); refusal != Refusal::kNone) return refusal;
  const int id = message.header.robot_id;
  if (id == config_.robot_id) return Refusal::kNone;  // multicast returns our own
  const auto entry = peers_.find(id);
  if (entry == peers_.end()) return Refusal::kRobot;
  if (const Refusal refusal = check_time(message.header.utime, now_us, kMaxAge_us, to_us(config_.clock_limit_s));
      refusal != Refusal::kNone)
    return refusal;
  PeerState& peer = entry->second;
  if (const Refusal refusal = peer.gate.pass(message.header); refusal != Refusal::kNone) return refusal;

  if (peer.heard && peer.boot == message.header.boot) {
    peer.lost += static_cast<std::int32_t>(std::min<std::int64_t>(message.header.seq - peer.seq - 1, 1'000'000));
  } else {  // first heard or restarted: nothing said before counts
    peer.judged_seq = peer.mine_seq = 0;
    peer.verdict = peer.mine_verdict = ack_t::kNone;
  }
  peer.heard = true;
  peer.heard_us = now_us;
  peer.utime = message.header.utime;
  peer.boot = message.header.boot;
  peer.seq = message.header.seq;
  peer.radius_m = message.radius;
  read_announcement(message, &peer.motion, &peer.announced);
  peer.stamp = message.pending_stamp;
  for (const ack_t& ack : message.acks) {
    if (ack.peer_id != config_.robot_id || ack.peer_boot != boot_) continue;
    peer.mine_seq = ack.judged_seq;
    peer.mine_verdict = ack.verdict;
  }
  judge(now_us, peer, id);
  outbox.publish_bytes(BusId::kOnboard, channel::kPeerTrajectory, bytes);
  return Refusal::kNone;
}

void BroadcastNode::judge(std::int64_t now_us, PeerState& peer, int peer_id) {
  if (peer.announced.empty() || peer.announced.seq() <= peer.judged_seq || !motion_) return;
  peer.judged_seq = peer.announced.seq();
  peer.verdict = ack_t::kAck;
  changed_ = true;
  const bool late = peer.announced.start_utime() <= now_us;
  if (late || !free_of(peer.announced, *motion_, peer.radius_m)) {
    peer.verdict = ack_t::kNack;
  } else if (!announced_.empty() && !free_of(peer.announced, {motion_->committed, announced_}, peer.radius_m)) {
    // Both are pending: the older stamp wins, then the lower id.
    const bool ours_wins = std::pair(stamp_, config_.robot_id) < std::pair(peer.stamp, peer_id);
    if (ours_wins) {
      peer.verdict = ack_t::kNack;
    } else {
      withdraw();
    }
  }
}

bool BroadcastNode::may_commit() const {
  for (const auto& [id, peer] : peers_) {
    if (!peer.heard) return false;
    const bool hold = config_.robot_id < id;
    const bool acked = peer.mine_seq == announced_.seq() && peer.mine_verdict == ack_t::kAck;
    if (!hold && !acked) return false;
    const bool promised = !peer.announced.empty() && peer.verdict == ack_t::kAck;
    if (promised && !free_of(announced_, {peer.motion.committed, peer.announced}, peer.radius_m)) return false;
    if (hold && !free_of(announced_, peer.motion, peer.radius_m)) return false;
  }
  return true;
}

void BroadcastNode::withdraw() {
  announced_ = Trajectory();
  ++withdrawn_;
  changed_ = true;
}

void BroadcastNode::advance(std::int64_t now_us) {
  if (!motion_) return;
  if (!motion_->next.empty() && now_us >= motion_->next.start_utime()) {
    motion_ = Motion{motion_->next, {}};
    changed_ = true;
  }
  if (announced_.empty()) return;
  const bool refused = std::any_of(peers_.begin(), peers_.end(), [this](const auto& entry) {
    const auto& [id, peer] = entry;
    return id < config_.robot_id && peer.mine_seq == announced_.seq() && peer.mine_verdict == ack_t::kNack;
  });
  if (refused || now_us >= announced_.start_utime()) {
    withdraw();
  } else if (may_commit()) {
    motion_->next = announced_;
    announced_ = Trajectory();
    ++commits_;
    changed_ = true;
  }
}

std::int64_t BroadcastNode::step(std::int64_t now_us, Outbox& outbox) {
  advance(now_us);
  if (motion_ && (changed_ || now_us >= next_announce_us_)) announce(now_us, outbox);
  const std::int64_t setpoint_period = to_us(1.0 / config_.setpoint_rate_hz);
  if (motion_ && now_us >= next_setpoint_us_) {
    publish_setpoint(now_us, outbox);
    next_setpoint_us_ = (now_us / setpoint_period + 1) * setpoint_period;
  }
  if (now_us >= next_status_us_) {
    publish_status(now_us, outbox);
    next_status_us_ = now_us + kStatusPeriod_us;
  }
  if (!motion_) return next_status_us_;
  std::int64_t wake = std::min({next_announce_us_, next_setpoint_us_, next_status_us_});
  if (!announced_.empty()) wake = std::min(wake, announced_.start_utime());
  if (!motion_->next.empty()) wake = std::min(wake, motion_->next.start_utime());
  return std::max(wake, now_us + 1);
}

void BroadcastNode::announce(std::int64_t now_us, Outbox& outbox) {
  announcement_t message{};
  message.header = announcement_headers_.next(now_us);
  message.radius = static_cast<float>(config_.radius_m);
  message.committed = motion_->committed.to_wire();
  message.pending_state = announcement_t::kNone;
  if (!motion_->next.empty()) {
    message.pending = motion_->next.to_wire();
    message.pending_state = announcement_t::kCommitted;
  } else if (!announced_.empty()) {
    message.pending = announced_.to_wire();
    message.pending_state = announcement_t::kAnnounced;
  }
  message.pending_stamp = message.pending_state == announcement_t::kNone ? 0 : stamp_;
  for (const auto& [id, peer] : peers_) {
    if (!peer.heard) continue;
    ack_t ack;
    ack.peer_id = static_cast<std::int16_t>(id);
    ack.peer_boot = peer.boot;
    ack.judged_seq = peer.judged_seq;
    ack.verdict = peer.verdict;
    message.acks.push_back(ack);
  }
  message.num_acks = static_cast<std::int16_t>(message.acks.size());
  outbox.publish(BusId::kSwarm, channel::kTrajectory, message);
  outbox.publish(BusId::kOnboard, channel::kOwnTrajectory, message);
  changed_ = false;
  next_announce_us_ = now_us + to_us(config_.announce_s);
}

void BroadcastNode::publish_setpoint(std::int64_t utime, Outbox& outbox) {
  const MotionState state = motion_->at(utime);
  sogm_swarm::setpoint_t setpoint{};
  setpoint.header = setpoint_headers_.next(utime);
  Eigen::Map<Eigen::Vector3d>(setpoint.position) = state.position;
  Eigen::Map<Eigen::Vector3d>(setpoint.velocity) = state.velocity;
  Eigen::Map<Eigen::Vector3d>(setpoint.acceleration) = state.acceleration;
  Eigen::Map<Eigen::Vector3d>(setpoint.jerk) = state.jerk;
  // Turn into the direction of flight; slow motion has none worth turning to.
  const double turn = 1.0 / config_.setpoint_rate_hz * config_.yaw_rate_max;
  double step = 0.0;
  if (state.velocity.head<2>().norm() > 0.3) {
    step = std::clamp(wrap_angle(direction(state.velocity.x(), state.velocity.y()) - yaw_), -turn, turn);
  }
  yaw_ = wrap_angle(yaw_ + step);
  setpoint.yaw = yaw_;
  setpoint.yaw_rate = step * config_.setpoint_rate_hz;
  outbox.publish(BusId::kOnboard, channel::kSetpoint, setpoint);
}

std::int32_t BroadcastNode::lost() const {
  std::int32_t sum = 0;
  for (const auto& [id, peer] : peers_) sum += peer.lost;
  return sum;
}

void BroadcastNode::publish_status(std::int64_t now_us, Outbox& outbox) {
  using sogm_swarm::broadcast_status_t;
  broadcast_status_t status{};
  status.header = status_headers_.next(now_us);
  status.state = motion_ ? broadcast_status_t::kFlying : broadcast_status_t::kNoState;
  status.candidates = candidates_;
  status.commits = commits_;
  status.withdrawn = withdrawn_;
  std::copy(rejected_.begin(), rejected_.end(), status.rejected);
  status.lost = lost();
  for (const auto& [id, peer] : peers_) {
    if (!peer.heard && motion_) status.state = broadcast_status_t::kWaiting;
    if (!peer.heard || now_us - peer.heard_us > 1'000'000) continue;
    ++status.peers_heard;
    status.max_age_ms = std::max(status.max_age_ms, 1e-3f * static_cast<float>(now_us - peer.heard_us));
    // Delay and offset cannot be told apart from one direction: this bounds the offset.
    status.max_clock_offset_ms =
        std::max(status.max_clock_offset_ms, 1e-3f * static_cast<float>(std::abs(peer.heard_us - peer.utime)));
  }
  refused_.copy_to(status.refused);
  outbox.publish(BusId::kOnboard, channel::kBroadcastStatus, status);
}

}  // namespace swarm
