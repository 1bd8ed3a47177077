#include "planner_daemon/coordination/commit_protocol.h"

#include <algorithm>
#include <utility>

#include "lcmtypes/bus/crc32.h"
#include "planner_daemon/coordination/commit_delay.h"
#include "planner_daemon/coordination/deconfliction.h"

namespace swarm {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;

namespace {

constexpr double kRounding_m = 1e-3;  // of positions on the wire and of motions that touch a distance

}  // namespace

const char* to_string(Rejection rejection) {
  static constexpr const char* kNames[kNumRejections] = {"none",  "no committed",  "waiting", "busy",
                                                         "time",  "discontinuous", "limits",  "conflict",
                                                         "clock", "twin",          "not led"};
  return kNames[static_cast<int>(rejection)];
}

bool CommitProtocol::Peer::acknowledged() const {
  return !pending.empty() && pending.seq() == judged_seq && verdict == ack_t::kAck;
}

CommitProtocol::CommitProtocol(const Rules& rules) : rules_(rules) {
  for (const int id : rules.roster) peers_[id];
  peers_[rules.robot_id];
  std::vector<std::uint8_t> ids;
  for (const auto& [id, peer] : peers_) {
    if (id == rules.robot_id) place_ = ids.size() / 2;
    ids.push_back(static_cast<std::uint8_t>(id >> 8));
    ids.push_back(static_cast<std::uint8_t>(id));
  }
  roster_crc_ = static_cast<std::int32_t>(crc32(ids));
  peers_.erase(rules.robot_id);
}

void CommitProtocol::start(const Motion& motion, std::int32_t forced_seq) {
  motion_ = motion;
  forced_seq_ = forced_seq;
  next_seq_ = motion.seq() + 1;
  news_ = true;
}

void CommitProtocol::set_boot(std::int32_t boot) {
  rules_.boot = boot;
  for (auto& [id, peer] : peers_) peer.hears_us = false, peer.our_seq = 0, peer.our_verdict = ack_t::kNone;
  if (!pending_.empty()) withdraw();
  news_ = true;
}

void CommitProtocol::set_clock(Utime now, Duration step) {
  for (auto& [id, peer] : peers_) {
    for (Trajectory* known : {&peer.motion.committed, &peer.motion.next, &peer.pending}) known->shift(step);
    peer.hears_us = false;
  }
  if (!pending_.empty()) withdraw();
  if (!motion_ || motion_->end_utime() <= now) return;
  motion_ = Motion{Trajectory::hover(next_seq_++, now, motion_->at(motion_->end_utime()).position), {}};
  news_ = true;
}

void CommitProtocol::force(const Trajectory& motion) {
  if (!pending_.empty()) withdraw();
  motion_ = Motion{motion, {}};
  motion_->committed.set_seq(next_seq_++);
  forced_seq_ = motion_->seq();
  ++commits_;
  ++forced_;
  news_ = true;
}

bool CommitProtocol::all_hear() const {
  return std::all_of(peers_.begin(), peers_.end(),
                     [](const auto& entry) { return entry.second.heard && entry.second.hears_us; });
}

bool CommitProtocol::free_of(const Trajectory& trajectory, const Motion& other, double other_radius_m) const {
  return motions_separated({trajectory, {}}, other, trajectory.start_utime(), apart_m(radius_m(), other_radius_m),
                           rules_.clock_error_s);
}

bool CommitProtocol::keeps_off(const Trajectory& trajectory, const Motion& bound, const Peer& peer) const {
  if (free_of(trajectory, bound, peer.radius_m)) return true;
  const Utime start = trajectory.start_utime();
  const double now_m = (trajectory.knot(0).position - bound.at(start).position).norm();
  if (now_m >= apart_m(radius_m(), peer.radius_m)) return false;
  const double least_m = apart_m(rules_.radius_m, peer.least_radius_m);  // what is new, again and again, stays beyond
  const double stays_m = now_m < least_m ? now_m - kRounding_m : std::max(now_m - kRounding_m, least_m);
  return motions_separated({trajectory, {}}, bound, start, stays_m);
}

Rejection CommitProtocol::propose(Utime now, const Trajectory& candidate, bool urgent) {
  if (!motion_) return Rejection::kNoCommitted;
  if (!urgent && !all_hear()) return Rejection::kWaiting;
  if (!urgent && doubts_clocks_) return Rejection::kClock;
  if (!motion_->next.empty()) return Rejection::kBusy;
  for (const auto& [id, peer] : peers_) {
    if (!peer.heard) continue;
    if (!keeps_off(candidate, peer.motion, peer)) return Rejection::kConflict;
    if (peer.acknowledged() && !free_of(candidate, {peer.motion.committed, peer.pending}, peer.radius_m))
      return Rejection::kConflict;
  }
  if (!pending_.empty()) withdraw();  // a newer plan replaces the one that waits
  pending_ = candidate;
  pending_.set_seq(next_seq_++);
  stamp_ = now;
  urgent_ = urgent;
  news_ = true;
  return Rejection::kNone;
}

bool CommitProtocol::is_of_roster(const announcement_t& message) const {
  return peers_.contains(message.header.robot_id) && message.roster_crc == roster_crc_ &&
         message.acks.size() == peers_.size() + 1;
}

void CommitProtocol::receive(Utime now, const announcement_t& message) {
  if (!is_of_roster(message)) return;
  const auto entry = peers_.find(message.header.robot_id);
  Peer& peer = entry->second;
  if (!peer.heard || peer.boot != message.header.boot) {  // nothing said before counts
    const double least_radius_m = peer.heard ? peer.least_radius_m : message.radius;
    peer = Peer();
    peer.heard = news_ = true;
    peer.least_radius_m = least_radius_m;
    peer.boot = message.header.boot;
  }
  peer.radius_m = message.radius;
  peer.least_radius_m = std::min(peer.least_radius_m, peer.radius_m);
  peer.motion = motion_of(message);
  peer.pending = pending_of(message);
  peer.stamp = to_utime(message.pending_stamp);
  const ack_t& about_us = message.acks[place_];
  peer.our_boot = about_us.peer_boot;
  peer.hears_us = peer.our_boot == rules_.boot;
  peer.our_seq = peer.hears_us ? about_us.judged_seq : 0;
  peer.our_verdict = peer.hears_us ? about_us.verdict : ack_t::kNone;
  judge(now, entry->first, &peer);
}

void CommitProtocol::judge(Utime now, int peer_id, Peer* peer) {
  if (peer->pending.empty() || peer->pending.seq() <= peer->judged_seq || !motion_) return;
  peer->judged_seq = peer->pending.seq();
  peer->verdict = ack_t::kAck;
  news_ = news_ || peer_id > rules_.robot_id;                                                // it waits for the answer
  const bool late = peer->pending.start_utime() + to_duration(rules_.clock_error_s) <= now;  // by any clock
  if (late || !keeps_off(peer->pending, *motion_, *peer)) {
    peer->verdict = ack_t::kNack;
  } else if (!pending_.empty() && !free_of(peer->pending, {motion_->committed, pending_}, peer->radius_m)) {
    if (std::pair(stamp_, rules_.robot_id) < std::pair(peer->stamp, peer_id)) {
      peer->verdict = ack_t::kNack;
    } else {
      withdraw();
    }
  }
}

void CommitProtocol::advance(Utime now) {
  if (!motion_) return;
  if (!motion_->next.empty() && now >= motion_->next.start_utime()) motion_ = Motion{motion_->next, {}};
  if (pending_.empty()) return;
  const bool refused = std::any_of(peers_.begin(), peers_.end(), [this](const auto& entry) {
    const auto& [id, peer] = entry;
    return id < rules_.robot_id && peer.our_seq == pending_.seq() && peer.our_verdict == ack_t::kNack;
  });
  if (refused || now >= pending_.start_utime()) withdraw();
}

bool CommitProtocol::everybody_agrees() const {
  return !doubts_clocks_ && all_hear() && std::all_of(peers_.begin(), peers_.end(), [this](const auto& entry) {
    const auto& [id, peer] = entry;
    return rules_.robot_id < id || (peer.our_seq == pending_.seq() && peer.our_verdict == ack_t::kAck);
  });
}

bool CommitProtocol::may_commit(Utime now) const {
  if (pending_.empty() || now >= pending_.start_utime()) return false;
  const bool agreed = everybody_agrees();
  if (!agreed && !(urgent_ && now >= pending_.start_utime() - kLastMoment)) return false;
  return std::all_of(peers_.begin(), peers_.end(), [this, agreed](const auto& entry) {
    const auto& [id, peer] = entry;
    const bool judged_there = agreed && id < rules_.robot_id;  // our P against its C
    if (peer.heard && !judged_there && !keeps_off(pending_, peer.motion, peer)) return false;
    const bool counts = agreed ? peer.acknowledged() : !peer.pending.empty();
    return !counts || free_of(pending_, {peer.motion.committed, peer.pending}, peer.radius_m);
  });
}

void CommitProtocol::commit(const std::function<bool(const announcement_t&)>& keep) {
  const std::int32_t forced_before = forced_seq_;
  motion_->next = pending_;
  if (!everybody_agrees()) forced_seq_ = pending_.seq();
  if (!keep(state())) {
    motion_->next = Trajectory();
    forced_seq_ = forced_before;
    return withdraw();
  }
  pending_ = Trajectory();
  ++commits_;
  forced_ += forced_seq_ != forced_before;
  news_ = true;
}

void CommitProtocol::withdraw() {
  pending_ = Trajectory();
  ++withdrawn_;
  news_ = true;
}

announcement_t CommitProtocol::state() const {
  announcement_t message{};
  message.radius = static_cast<float>(radius_m());
  message.committed = motion_->committed.to_wire();
  message.pending_state = announcement_t::kNone;
  if (!motion_->next.empty()) {
    message.pending = motion_->next.to_wire();
    message.pending_state = announcement_t::kCommitted;
  } else if (!pending_.empty()) {
    message.pending = pending_.to_wire();
    message.pending_state = announcement_t::kAnnounced;
  }
  message.pending_stamp = message.pending_state == announcement_t::kNone ? 0 : to_us(stamp_);
  message.roster_crc = roster_crc_;
  message.forced_seq = forced_seq_;
  message.least_delay_us = announcement_t::kUnknown;
  for (const auto& [id, peer] : peers_) {
    if (message.acks.size() == place_) message.acks.push_back({-1, 0, ack_t::kNone});
    const bool counts = !peer.pending.empty() && peer.pending.seq() == peer.judged_seq;  // else its peer has gone on
    message.acks.push_back({peer.boot, counts ? peer.judged_seq : 0, counts ? peer.verdict : ack_t::kNone});
  }
  if (message.acks.size() == place_) message.acks.push_back({-1, 0, ack_t::kNone});
  message.num_acks = static_cast<std::int16_t>(message.acks.size());
  return message;
}

bool CommitProtocol::take_news() {
  return std::exchange(news_, false);
}

bool CommitProtocol::is_awaited(Utime now) const {
  if (!pending_.empty() || !all_hear()) return true;
  if (motion_ && motion_->seq() == forced_seq_ && now < motion_->end_utime()) return true;
  return std::any_of(peers_.begin(), peers_.end(), [&](const auto& entry) {
    const auto& [id, peer] = entry;
    return id > rules_.robot_id && !peer.pending.empty() && now < peer.pending.start_utime();
  });
}

Utime CommitProtocol::due_utime(Utime now) const {
  Utime due = kNever;
  if (!pending_.empty()) {
    due = pending_.start_utime();
    if (urgent_ && now < due - kLastMoment) due -= kLastMoment;
  }
  if (motion_ && !motion_->next.empty()) due = std::min(due, motion_->next.start_utime());
  return due;
}

}  // namespace swarm
