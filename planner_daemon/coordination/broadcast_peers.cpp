// What the broadcast daemon hears from other robots, and makes of those that fall silent, do not answer, err or are of
// another roster.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "lcmtypes/bus/packed_announcement.h"
#include "planner_daemon/coordination/broadcast_node.h"

namespace swarm {
namespace {

using sogm_swarm::announcement_t;

constexpr std::int64_t kMostLost = 1'000'000;  // that are counted, of a peer: the sum of all fits its field
constexpr Duration kNeverHeard = 10s;          // after its start a robot has heard all that are there
constexpr Duration kSlept = 500ms;             // between two steps: far more than between two setpoints
constexpr Duration kVotePeriod = 100ms;
constexpr Duration kWordsPeriod = 500ms;  // and fifty times as seldom as announcements may come
constexpr Duration kTombstonePeriod = 500ms;
constexpr int kMostJudged = 4;  // peers at once: far less time than between two setpoints

bool ends_in_time(const announcement_t& message) {
  const Utime end = std::max(motion_of(message).end_utime(), pending_of(message).end_utime());
  return end <= to_utime(message.header.utime) + kMaxMotion;
}

}  // namespace

// Only what costs little: what it means is for judge_peers().
Refusal BroadcastNode::on_peer(Utime now, std::span<const std::uint8_t> bytes) {
  CellAnnouncement said;
  announcement_t& message = said.robot;
  if (const Refusal refusal = decode_packed(bytes, &message); refusal != Refusal::kNone) return refusal;
  if (message.header.robot_id == config_.robot_id) return on_own_returned(now, message.header);
  if (!protocol_.is_of_roster(message)) return on_stranger(now, &message);
  return heard(now, std::move(said));
}

// Multicast returns our own.
Refusal BroadcastNode::on_own_returned(Utime now, const sogm_swarm::header_t& header) {
  return identity_.is_of_twin(now, BusId::kSwarm, header) ? Refusal::kRobot : Refusal::kNone;
}

Refusal BroadcastNode::heard(Utime now, CellAnnouncement said) {
  announcement_t& message = said.robot;
  const int id = message.header.robot_id;
  PeerLink& link = links_.at(id);
  // Its time comes last: a clock is not doubted for what was recorded and is played again.
  const auto is_good = [&link](const announcement_t& m) {
    if (!link.gate.is_newer(m.header)) return Refusal::kSequence;
    return ends_in_time(m) ? Refusal::kNone : Refusal::kInconsistent;
  };
  const Refusal refusal = admit(message, is_good, lately(now), link.gate);
  if (refusal == Refusal::kTime) on_other_time(now, &message);
  if (refusal != Refusal::kNone) return refusal;
  if (strangers_.forget(id)) protocol_.set_tombstones(strangers_.tombstones());
  if (link.boot == message.header.boot) {
    const std::int64_t missing = std::min(message.header.seq - link.seq - 1, kMostLost);  // any number may come
    link.lost = static_cast<std::int32_t>(std::min(link.lost + missing, kMostLost));
  }
  link.heard = now;
  link.clock.heard(now, to_utime(message.header.utime));
  if (agreement_.told_about(said) == config_.robot_id && message.least_delay_us != announcement_t::kUnknown)
    link.clock.told(Duration(message.least_delay_us));
  if (link.clock.beyond(to_duration(config_.clock_error_s))) doubt_clock_of(id, now, -*link.clock.offset());
  link.boot = message.header.boot;
  link.seq = message.header.seq;
  link.newest = std::move(said);
  link.turn.wait();
  link.is_of_other_time = false;
  return Refusal::kNone;
}

Refusal BroadcastNode::on_stranger(Utime now, announcement_t* message) {
  const auto from_stranger = [this](const announcement_t& m) {
    const auto link = links_.find(m.header.robot_id);
    if (link != links_.end() && m.header.boot <= link->second.boot)
      return Refusal::kRobot;  // but a later start of a peer
    return ends_in_time(m) ? Refusal::kNone : Refusal::kInconsistent;
  };
  const auto in_order = [this](const announcement_t& m) { return strangers_.admit(m); };
  const Refusal refusal = admit(*message, from_stranger, lately(now), in_order);
  if (refusal != Refusal::kNone) return refusal;
  strangers_.heard(std::move(*message));
  protocol_.set_tombstones(strangers_.tombstones());
  return Refusal::kNone;
}

void BroadcastNode::relay_strangers(Utime now, Outbox& outbox) {
  while (auto message = strangers_.take_due(now)) {
    shift(offered_step_, &*message);
    outbox.publish(BusId::kOnboard, channel::kPeerTrajectory, *message);
  }
}

void BroadcastNode::on_other_time(Utime now, announcement_t* message) {
  const int id = message->header.robot_id;
  const Duration age = now - to_utime(message->header.utime);
  if (age < 0us) doubt_clock_of(id, now, -age);
  // What is old may have been held up by the network, but not longer than motions last, nor when our clock was set.
  const bool is_by_other_clock = age < 0us || age > kMaxMotion || now < clock_set_until_;
  PeerLink& link = links_.at(id);
  if (!is_by_other_clock || link.other_time.pass(message->header) != Refusal::kNone) return;
  shift(age, message);
  link.newest = {std::move(*message), {}, {}};
  link.turn.wait();
  link.is_of_other_time = true;
}

// By a clock that is doubted it is not known when its robot moved.
Refusal BroadcastNode::on_last_words(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::last_words_t words;
  announcement_t message;
  const auto from_peer = [this](const sogm_swarm::last_words_t& m) {
    return links_.contains(m.header.robot_id) && links_.contains(m.robot_id) ? Refusal::kNone : Refusal::kRobot;
  };
  Refusal refusal = decode(bytes, &words);
  if (refusal == Refusal::kNone && words.header.robot_id == config_.robot_id) return Refusal::kNone;  // our own
  if (refusal == Refusal::kNone) refusal = admit(words, from_peer, lately(now), AnyOrder());
  if (refusal == Refusal::kNone) refusal = unpack(words, &message);
  if (refusal == Refusal::kNone && !protocol_.is_of_roster(message)) refusal = Refusal::kRobot;
  if (refusal != Refusal::kNone) return refusal;
  if (!clocks_agree(now)) return Refusal::kTime;
  protocol_.learn(message, RosterProtocol::alone(keeper(now)));
  if (is_known(message)) links_.at(words.robot_id).last_words = std::move(message);
  return Refusal::kNone;
}

void BroadcastNode::follow_peers() {
  const std::map<int, CommitProtocol::Peer>& peers = protocol_.peers();
  gap_ = to_duration(static_cast<double>(peers.size() + 1) / config_.swarm_rate_hz);
  if (std::ranges::equal(
          links_, peers, {}, [](const auto& link) { return link.first; }, [](const auto& peer) { return peer.first; }))
    return;
  std::erase_if(links_, [&](const auto& entry) { return !peers.contains(entry.first); });
  for (const auto& entry : peers) links_[entry.first];
}

bool BroadcastNode::is_known(const announcement_t& message) const {
  const CommitProtocol::Peer& peer = protocol_.peers().at(message.header.robot_id);
  return peer.heard && std::pair(peer.boot, peer.seq) == std::pair(message.header.boot, message.header.seq);
}

bool BroadcastNode::is_silent(Utime now, const PeerLink& link) const {
  const Duration after = to_duration(config_.give_up_after_s);
  if (after == 0us) return false;
  return link.boot >= 0 ? now - link.heard >= after : now - *began_ >= std::max(after, kNeverHeard);
}

bool BroadcastNode::is_in_vain(const CommitProtocol::Peer& peer, PeerLink* link) const {
  if (std::exchange(link->answered_seq, peer.our_seq) != peer.our_seq || peer.is_never_answered()) link->in_vain = 0us;
  const bool asks = !protocol_.pending().empty() && peer.our_seq != protocol_.pending().seq();
  const bool errs = link->clock.beyond(to_duration(config_.clock_error_s));
  if (peer.heard && (asks || !peer.hears_us || errs)) link->in_vain += kVotePeriod;
  const Duration after = to_duration(config_.give_up_after_s);
  return after > 0us && link->in_vain >= after;
}

void BroadcastNode::give_up(Utime now) {
  if (cells_ || !motion()) return;  // in cells it is for their keepers
  if (!began_) began_ = stepped_ = now;
  if (const Duration slept = now - stepped_; slept > kSlept) {  // who has slept has heard nobody
    for (auto& [id, link] : links_) link.heard += slept;
    *began_ += slept;
  }
  stepped_ = now;
  if (protocol_.is_given_up() && !identity_.has_twin(now) && identity_.start_anew(now)) {
    set_boot(identity_.boot());
    keep_promise(now);
  }
  if (now < vote_.due(now, kVotePeriod)) return;
  vote_.done(now);
  for (auto& [id, link] : links_) {
    const bool is_no_help = is_in_vain(protocol_.peers().at(id), &link);
    if (!(is_no_help || is_silent(now, link)) || !protocol_.give_up(id, RosterProtocol::alone(keeper(now)))) continue;
    spdlog::warn("robot {} gives robot {} up: it {}", config_.robot_id, id,
                 link.boot < 0 ? "was never heard"
                 : is_no_help  ? "does not answer, or its clock is wrong"
                               : "has fallen silent");
  }
}

bool BroadcastNode::go_on_without(Utime now, int id) {
  if (cells_ || !links_.contains(id)) return false;  // in cells it is for their keepers
  if (protocol_.give_up(id, RosterProtocol::alone(keeper(now))))
    spdlog::warn("robot {} gives robot {} up: by the operator's word", config_.robot_id, id);
  return protocol_.peers().at(id).is_voted_out();
}

void BroadcastNode::repeat_last_words(Utime now, Outbox& outbox) {
  if (now < words_.due(now, std::max<Duration>(kWordsPeriod, 50 * gap_))) return;
  words_.done(now);
  for (auto& [id, link] : links_) {
    if (!clocks_agree(now) || !protocol_.must_repeat(id)) continue;
    sogm_swarm::last_words_t words = last_words_of(&link.last_words);
    words.header = words_headers_.next(now);
    outbox.publish(BusId::kSwarm, channel::kLastWords, words);
  }
}

void BroadcastNode::show_tombstones(Utime now, Outbox& outbox) {
  if (now < tombstones_.due(now, kTombstonePeriod)) return;
  tombstones_.done(now);
  std::vector<announcement_t> tombstones = agreement_.tombstones();
  std::ranges::move(strangers_.told(), std::back_inserter(tombstones));
  for (const auto& [id, link] : links_) {
    const CommitProtocol::Peer& peer = protocol_.peers().at(id);
    if (peer.heard && (peer.given_up || peer.is_never_answered())) tombstones.push_back(link.last_words);
  }
  for (announcement_t& message : tombstones) {
    shift(offered_step_, &message);
    message.header.utime = to_us(now + offered_step_);  // a planner that started since takes it as new
    outbox.publish(BusId::kOnboard, channel::kPeerTrajectory, message);
  }
}

void BroadcastNode::judge_peers(Utime now, Outbox& outbox) {
  for (int judged = 0; judged < kMostJudged; ++judged) {
    const auto waits_longest = std::ranges::min_element(
        links_, {}, [&](auto& entry) { return std::pair(entry.second.turn.due(now, gap_), entry.second.heard); });
    if (waits_longest == links_.end()) return;
    auto& [id, link] = *waits_longest;
    if (link.turn.due(now, gap_) > now) return;
    link.turn.taken(now, gap_ / 2, gap_ / 2);
    if (!link.is_of_other_time) {
      agreement_.receive(now, link.newest, keeper(now));
      if (is_known(link.newest.robot)) link.last_words = link.newest.robot;
    }
    shift(offered_step_, &link.newest.robot);
    outbox.publish(BusId::kOnboard, channel::kPeerTrajectory, link.newest.robot);
    if (link.is_of_other_time) continue;
    if (identity_.outdo(now, protocol_.peers().at(id).our_boot, protocol_.commits() > 0)) {
      set_boot(identity_.boot());
      if (motion()) keep_promise(now);
    }
  }
}

// For a while, and at least as long as the peer moves; but not of one that was given up meanwhile.
void BroadcastNode::doubt_clock_of(int id, Utime now, Duration ahead) {
  const CommitProtocol::Peer& peer = protocol_.peers().at(id);
  if (peer.given_up) return;  // nobody waits for it
  doubt_ = {id, ahead};
  const Utime rests = peer.heard ? std::min(peer.motion.end_utime(), now + kMaxMotion) : Utime();
  clock_doubt_until_ = std::max({clock_doubt_until_, now + kClockDoubt, rests});
}

}  // namespace swarm
