// Long because the rules of commit_protocol.h are to be read in one place.
#include "planner_daemon/coordination/commit_protocol.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "lcmtypes/bus/crc32.h"
#include "planner_daemon/coordination/commit_delay.h"
#include "planner_daemon/coordination/deconfliction.h"

namespace swarm {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;

namespace {

constexpr double kRounding_m = 1e-3;  // of positions on the wire and of motions that touch a distance

// As an acknowledgement says it.
std::int32_t number_of(std::int64_t seq) {
  return static_cast<std::int32_t>(std::clamp<std::int64_t>(seq, 0, std::numeric_limits<std::int32_t>::max()));
}
bool gives_up(const ack_t& ack) {
  return ack.verdict == ack_t::kGivenUp;
}
// Of robots: two each and one more for the lowest id, so that two halves are never even.
bool is_majority(std::size_t votes, std::size_t num_robots) {
  return 2 * votes > 2 * num_robots + 1;
}
std::size_t votes_of(std::size_t place) {
  return place == 0 ? 3 : 2;
}

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
  number_places();
}

void CommitProtocol::number_places() {
  peers_[rules_.robot_id];
  std::vector<std::uint8_t> ids;
  for (const auto& [id, peer] : peers_) {
    if (id == rules_.robot_id) place_ = ids.size() / 2;
    ids.push_back(static_cast<std::uint8_t>(id >> 8));
    ids.push_back(static_cast<std::uint8_t>(id));
  }
  roster_crc_ = static_cast<std::int32_t>(crc32(ids));
  for (std::size_t place = 0; auto& [id, peer] : peers_) peer.place = place++;
  peers_.erase(rules_.robot_id);
}

void CommitProtocol::set_peers(const std::set<int>& ids) {
  std::erase_if(peers_, [&ids](const auto& entry) { return !ids.contains(entry.first); });
  for (const int id : ids) peers_[id];
  number_places();
  for (auto& [id, peer] : peers_) peer.acks.assign(num_robots(), {-1, 0, ack_t::kNone});  // they were of other places
  news_ = true;
}

void CommitProtocol::remember(std::int32_t roster_crc, const std::vector<ack_t>& acks) {
  if (roster_crc != roster_crc_ || acks.size() != num_robots()) return;
  for (auto& [id, peer] : peers_) {
    const ack_t& kept = acks[peer.place];
    peer.boot = kept.peer_boot;
    peer.is_forgotten = kept.peer_boot >= 0;
    if (!gives_up(kept) || kept.peer_boot < 0) continue;
    peer.given_up_boot = kept.peer_boot;
    peer.given_up_seq = kept.judged_seq;
  }
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

void CommitProtocol::set_tombstones(const std::vector<announcement_t>& tombstones) {
  tombstones_.clear();
  for (const announcement_t& message : tombstones) {
    Peer& tombstone = tombstones_.emplace_back();
    tombstone.motion = motion_of(message);
    tombstone.pending = pending_of(message);
    tombstone.radius_m = tombstone.least_radius_m = message.radius;
  }
}

void CommitProtocol::set_clock(Utime now, Duration step) {
  for (auto& [id, peer] : peers_) {
    for (Trajectory* known : {&peer.motion.committed, &peer.motion.next, &peer.pending}) known->shift(step);
    peer.hears_us = false;
  }
  for (Peer& tombstone : tombstones_)
    for (Trajectory* known : {&tombstone.motion.committed, &tombstone.motion.next, &tombstone.pending})
      known->shift(step);
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
                     [](const auto& entry) { return entry.second.given_up || entry.second.hears_us; });
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

bool CommitProtocol::keeps_off_tombstones(const Trajectory& trajectory) const {
  const auto keeps_off_all = [&](const Peer& peer) {
    return keeps_off(trajectory, peer.motion, peer) &&
           (peer.pending.empty() || keeps_off(trajectory, {peer.motion.committed, peer.pending}, peer));
  };
  return std::all_of(tombstones_.begin(), tombstones_.end(), keeps_off_all) &&
         std::all_of(peers_.begin(), peers_.end(), [&](const auto& entry) {
           return !entry.second.given_up || !entry.second.heard || keeps_off_all(entry.second);
         });
}

Rejection CommitProtocol::propose(Utime now, const Trajectory& candidate, bool urgent) {
  if (!motion_) return Rejection::kNoCommitted;
  if (!urgent && !all_hear()) return Rejection::kWaiting;
  if (!urgent && doubts_clocks_) return Rejection::kClock;
  if (!motion_->next.empty()) return Rejection::kBusy;
  if (!keeps_off_tombstones(candidate)) return Rejection::kConflict;
  for (const auto& [id, peer] : peers_) {
    if (!peer.heard || peer.given_up) continue;
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

void CommitProtocol::receive(Utime now, const announcement_t& message, const Keep& keep) {
  Peer* const peer = take(message, keep);
  if (peer == nullptr) return;
  judge(now, message.header.robot_id, peer);
  if (peer->is_never_answered() || bears_on_votes(message)) count_votes();
}

void CommitProtocol::learn(const announcement_t& message, const Keep& keep) {
  if (take(message, keep) != nullptr) count_votes();
}

bool CommitProtocol::bears_on_votes(const announcement_t& message) const {
  return std::any_of(message.acks.begin(), message.acks.end(), gives_up) ||
         std::any_of(peers_.begin(), peers_.end(), [](const auto& entry) { return entry.second.given_up; });
}

CommitProtocol::Peer* CommitProtocol::take(const announcement_t& message, const Keep& keep) {
  if (!is_of_roster(message)) return nullptr;
  Peer& peer = peers_.at(message.header.robot_id);
  if (std::pair(message.header.boot, message.header.seq) <= std::pair(peer.boot, peer.seq)) return nullptr;
  if (peer.boot != message.header.boot) {  // nothing said before counts
    const Peer before = std::exchange(peer, Peer());
    peer.place = before.place;
    if (before.heard) peer.least_radius_m = before.least_radius_m;
    peer.boot = message.header.boot;
    if (motion_ && !keep(promise())) {
      peer = before;
      return nullptr;
    }
  }
  news_ = news_ || !peer.heard;
  peer.heard = true;
  peer.seq = message.header.seq;
  peer.radius_m = message.radius;
  peer.least_radius_m = peer.least_radius_m > 0.0 ? std::min(peer.least_radius_m, peer.radius_m) : peer.radius_m;
  peer.motion = motion_of(message);
  peer.pending = pending_of(message);
  peer.stamp = to_utime(message.pending_stamp);
  peer.acks = message.acks;
  const ack_t& about_us = message.acks[place_];
  peer.our_boot = about_us.peer_boot;
  peer.hears_us = peer.our_boot == rules_.boot && !gives_up(about_us);
  peer.our_seq = peer.hears_us ? about_us.judged_seq : 0;
  peer.our_verdict = peer.hears_us ? about_us.verdict : ack_t::kNone;
  peer.is_forgotten = peer.is_forgotten && !peer.hears_us;
  return &peer;
}

void CommitProtocol::judge(Utime now, int peer_id, Peer* peer) {
  if (peer->pending.empty() || !motion_ || peer->is_never_answered()) return;
  const bool is_waited_for = waits_for_us(*peer);
  if (peer->pending.seq() <= peer->judged_seq) {
    is_asked_again_ |= is_waited_for;
    return;
  }
  peer->judged_seq = peer->pending.seq();
  peer->verdict = ack_t::kAck;
  answers_ |= is_waited_for;
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

// As it holds the pair, or is one of the majority of the lowest ids that live.
bool CommitProtocol::waits_for_us(const Peer& peer) const {
  if (place_ < peer.place || rules_.all_judge) return true;
  std::size_t judges = votes_of(peer.place);
  for (const auto& [id, other] : peers_)
    if (other.place < place_ && other.place != peer.place && !other.given_up) judges += votes_of(other.place);
  return !is_majority(judges, num_robots());
}

bool CommitProtocol::give_up(int id, const Keep& keep) {
  Peer& peer = peers_.at(id);
  if (!motion_ || peer.is_never_answered() || peer.is_forgotten) return false;
  const std::int32_t boot_before = std::exchange(peer.given_up_boot, peer.boot);
  const std::int64_t seq_before = std::exchange(peer.given_up_seq, peer.seq);
  if (!keep(promise())) {
    peer.given_up_boot = boot_before;
    peer.given_up_seq = seq_before;
    return false;
  }
  news_ = true;
  count_votes();
  return true;
}

// One after the other: who was given up has no vote any more.
void CommitProtocol::count_votes() {
  for (auto& entry : peers_) {
    Peer& peer = entry.second;
    const bool has_started_again = std::any_of(peers_.begin(), peers_.end(), [&peer](const auto& other) {
      return tells_of(other.second, peer) && other.second.acks[peer.place].peer_boot > peer.boot;
    });
    if (has_started_again) {
      peer.given_up = false;
    } else if (!peer.given_up && are_enough_against(peer)) {
      peer.given_up = news_ = true;
    }
  }
}

bool CommitProtocol::tells_of(const Peer& other, const Peer& peer) {
  return other.place != peer.place && other.heard && !other.given_up;
}

bool CommitProtocol::are_enough_against(const Peer& peer) const {
  std::size_t votes = peer.is_voted_out() ? votes_of(place_) : 0;
  for (const auto& [id, other] : peers_) {
    if (!tells_of(other, peer)) continue;
    const ack_t& vote = other.acks[peer.place];
    const bool knows_no_more = vote.peer_boot < 0 || (peer.heard && vote.judged_seq <= number_of(peer.seq));
    if (gives_up(vote) && vote.peer_boot == peer.boot && knows_no_more) votes += votes_of(other.place);
  }
  return is_majority(votes, num_robots());
}

bool CommitProtocol::must_repeat(int id) const {
  const Peer& peer = peers_.at(id);
  if (!peer.heard || !peer.is_voted_out()) return false;
  return std::any_of(peers_.begin(), peers_.end(), [&peer](const auto& entry) {
    const Peer& other = entry.second;
    if (!tells_of(other, peer)) return false;
    const ack_t& ack = other.acks[peer.place];
    if (ack.peer_boot != peer.boot) return ack.peer_boot < peer.boot;
    return !gives_up(ack) || ack.judged_seq < number_of(peer.seq);
  });
}

bool CommitProtocol::is_given_up() const {
  return std::any_of(peers_.begin(), peers_.end(), [this](const auto& entry) {
    const Peer& peer = entry.second;
    return peer.heard && !peer.given_up && gives_up(peer.acks[place_]) && peer.our_boot == rules_.boot;
  });
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

bool CommitProtocol::is_agreed() const {
  if (doubts_clocks_ || withholds_ || !all_hear()) return false;
  std::size_t judges = votes_of(place_);
  for (const auto& [id, peer] : peers_) {
    if (peer.given_up) continue;
    const bool has_judged = peer.our_seq == pending_.seq();
    if (rules_.all_judge && !has_judged) return false;
    if (id < rules_.robot_id && !(has_judged && peer.our_verdict == ack_t::kAck)) return false;
    if (has_judged) judges += votes_of(peer.place);
  }
  return is_majority(judges, num_robots());
}

bool CommitProtocol::may_commit(Utime now) const {
  if (pending_.empty() || now >= pending_.start_utime()) return false;
  const bool agreed = is_agreed();
  if (!agreed && !(urgent_ && now >= pending_.start_utime() - kLastMoment)) return false;
  if (!keeps_off_tombstones(pending_)) return false;
  return std::all_of(peers_.begin(), peers_.end(), [this, agreed](const auto& entry) {
    const auto& [id, peer] = entry;
    if (peer.given_up) return true;
    const bool judged_there = agreed && id < rules_.robot_id;  // our P against its C
    if (peer.heard && !judged_there && !keeps_off(pending_, peer.motion, peer)) return false;
    const bool counts = agreed ? peer.acknowledged() : !peer.pending.empty();
    return !counts || free_of(pending_, {peer.motion.committed, peer.pending}, peer.radius_m);
  });
}

bool CommitProtocol::commit(const Keep& keep) {
  const std::int32_t forced_before = forced_seq_;
  motion_->next = pending_;
  if (!is_agreed()) forced_seq_ = pending_.seq();
  if (!keep(promise())) {
    motion_->next = Trajectory();
    forced_seq_ = forced_before;
    withdraw();
    return false;
  }
  pending_ = Trajectory();
  ++commits_;
  if (forced_seq_ != forced_before) ++forced_, news_ = true;
  return true;
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
  message.acks.assign(num_robots(), {-1, 0, ack_t::kNone});
  for (const auto& [id, peer] : peers_) {
    ack_t& ack = message.acks[peer.place];
    ack.peer_boot = peer.boot;
    if (peer.is_voted_out()) {
      ack.judged_seq = number_of(peer.seq);
      ack.verdict = ack_t::kGivenUp;
    } else if (!peer.is_never_answered() && !peer.pending.empty() && peer.pending.seq() == peer.judged_seq) {
      ack.judged_seq = peer.judged_seq;  // else its peer has gone on
      ack.verdict = peer.verdict;
    }
  }
  message.num_acks = static_cast<std::int16_t>(message.acks.size());
  return message;
}

announcement_t CommitProtocol::promise() const {
  announcement_t message = state();
  for (const auto& [id, peer] : peers_) {
    if (peer.is_never_answered()) message.acks[peer.place] = {peer.boot, number_of(peer.given_up_seq), ack_t::kGivenUp};
  }
  return message;
}

CommitProtocol::News CommitProtocol::take_news() {
  const bool answers = std::exchange(answers_, false);
  if (std::exchange(news_, false)) return News::kMore;
  return answers ? News::kAnswers : News::kNone;
}

bool CommitProtocol::is_awaited(Utime now) const {
  if (!pending_.empty() || !all_hear()) return true;
  return is_asked_again_ || (motion_ && motion_->seq() == forced_seq_ && now < motion_->end_utime());
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
