// The commit protocol (design: ack with right of way): whatever the network does, no two committed motions ever come
// closer than the sum of the radii, as long as no two clocks differ by more than `clock_error_s`. Knows neither bus
// nor clock nor files; commit_protocol_test searches its states exhaustively on small cases.
//
// For each pair of robots the lower id is the holder of the right of way, the other the asker. Every robot is bound to
// its committed motion C, which ends at rest, and may announce one pending trajectory P that leaves C at a time t_b.
//  1. Announce: P is free of every peer's C and of every P of a peer that this robot acknowledged.
//  2. Judge a peer's P, once: what has begun by any clock (`clock_error_s`) is refused, and what conflicts with the own
//     C; of two P in conflict the older stamp wins (then the lower id), and the loser is refused or withdrawn; all else
//     is acknowledged. An acknowledgement binds: the peer's P counts as flown until a newer announcement of the peer no
//     longer shows it. It never expires.
//  3. Commit before t_b, when every peer that was not given up was heard and has heard this start of the daemon, every
//     holder among them has acknowledged P, a majority of the whole roster (rule 8) has judged it, this robot included,
//     and P is free of what this robot acknowledged and of the C of those for whom it holds. The commit is on disk
//     before it is announced or flown.
//  4. Withdraw P at t_b, or when a holder refuses it. A number is never used again.
//  5. Restart: C comes from the disk, `boot` grows (where nothing was kept, or the robot is elsewhere, C is to hover
//     where it is: nobody was asked, but that is where it is). A new boot of a peer voids what it acknowledged, its P
//     and the verdict on it. Nothing is committed before every peer has echoed the new boot: it then no longer relies
//     on anything this robot said before the crash.
//  6. Last resort: a P that is urgent, because the robot will be hit on C, is committed a moment before t_b without
//     everybody's word, when it is free of every C and P that is known. Such a P is `forced`; it may meet what others
//     force meanwhile, what a holder that has not answered commits meanwhile, what a peer commits that has not echoed
//     this start (it may rely on an answer from before), or a robot that was never heard. Two robots that are closer
//     than they may be since then may commit what does not bring them nearer.
//  7. A robot that is off its motion by up to an error bound announces its radius with it; what is new keeps that off.
//     Robots that are closer than that, but no closer than they may be without it, may likewise commit what does not
//     bring them nearer. One that has lost its motion altogether is bound to how it comes to rest: that is forced.
//  8. Give up: who does not hear a peer, or gets no answers of it, votes it out, for the boot of it that is known (-1:
//  never heard), and says up
//     to which of its announcements it is known. Such a boot is never answered again: the vote is on disk before it is
//     said, as is each new boot of a peer before it is echoed. Who has restarted since it answered that boot, and was
//     not echoed by it, does not know what it answered, and has no vote on it.
//     A robot counts a peer as given up when a majority of the whole roster votes so, itself and robots that it has not
//     given up, that know no more of it than itself (of the lowest id the vote is one and a half, so that of two robots
//     one goes on). Whoever knows more repeats the last announcement for the others. Nobody that was given up is
//     waited for; its C, its next and its newest P, whatever the verdict, are kept off for ever, each as if it were
//     flown. It is waited for again as soon as it, or any robot that is not given up, shows a later boot of it; and
//     whoever sees that its own boot was voted out takes the next one (rule 5).
// Every announcement is the whole state (C, P, verdicts on what peers still announce), repeated for ever, and only
// newer ones (boot, seq) are read: so losses heal, and duplicates and reordering change nothing.
//
// Why it is safe, but for what is forced. Of two robots that wait for each other: what an asker flies or may still
// commit is always among what the holder knows (its C, or a P that the holder acknowledged and keeps), and the holder
// commits nothing that conflicts with that. An asker commits nothing without the holder's word, given against the
// holder's own C and P.
// Whatever j commits was judged by a majority, and a majority without j votes a boot of j out for i: one, k, is in
// both. k judged it before it voted, i knows no less of j than k: i keeps off all that j ever commits in that boot, at
// whatever time. There remain a boot that i counts as given up and a later one in which j commits. Where j waits for i,
// i has echoed the later one, and waits for j from then on; what it committed before it shows with the echo. Where j
// counts on the absence of an older boot of i as well, neither counts the other among its judges, so some k judged what
// each commits, in the boot that it commits it in, one after the other. The answer to the second shows the later boot
// of the first robot, which is waited for from then on.
//
// Who waits for whom: everybody for the lower ids and for the first to answer of the others, who judge at once, and a P
// that loses to another is withdrawn, not kept waiting. A robot that falls silent keeps its C (and its P) for ever; the
// higher ids stop until it is given up, then they fly on around it. Who cannot hear a majority comes to rest where it
// promised to.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// Why a candidate was not announced; index into broadcast_status_t.rejected.
enum class Rejection : std::uint8_t {
  kNone = 0,
  kNoCommitted,    // no robot state yet
  kWaiting,        // a roster peer was never heard, or has not heard this start of the daemon
  kBusy,           // a committed trajectory has not begun yet
  kTime,           // starts in the past or too far in the future, or ends too late
  kDiscontinuous,  // does not start on the committed motion
  kLimits,         // exceeds speed or acceleration
  kConflict,       // comes too close to a peer's motion
  kClock,          // a peer's clock differs too much, or the own one was set
  kTwin,           // another broadcaster speaks under this robot's id
  kNotLed,         // the robot stands, or goes straight up or down
};
inline constexpr int kNumRejections = 11;
const char* to_string(Rejection rejection);

class CommitProtocol {
 public:
  struct Rules {
    int robot_id = 0;
    std::int32_t boot = 1;
    std::vector<int> roster;  // ids of all robots that fly, in any order; this one may be among them
    double radius_m = 0.2;
    double separation_m = 0.02;  // kept between surfaces of committed motions
    double clock_error_s = 0.0;  // and kept as well when a peer's clock is wrong by this
    bool all_judge = false;      // what is committed: not only a majority
  };
  // Whether it is kept and will survive a crash.
  using Keep = std::function<bool(const sogm_swarm::announcement_t& promise)>;
  // What is known of a peer.
  struct Peer {
    std::size_t place = 0;  // in the roster, and of what is said of it in acks
    bool heard = false;
    bool hears_us = false;        // it has echoed this start of ours
    std::int32_t our_boot = -1;   // that it has echoed
    std::int32_t boot = -1;       // its newest start that is known
    std::int64_t seq = -1;        // header.seq of its newest announcement that is known
    double radius_m = 0.0;        // as announced: with what it may err by
    double least_radius_m = 0.0;  // that it ever announced: what it is without
    Motion motion;                // what it is bound to
    Trajectory pending;           // announced, not yet committed; may be empty
    Utime stamp{};                // of pending
    std::int32_t judged_seq = 0;  // newest pending trajectory of this boot that was judged here, and the verdict
    std::int8_t verdict = 0;
    std::int32_t our_seq = 0;  // newest of ours that it judged, and its verdict
    std::int8_t our_verdict = 0;
    std::vector<sogm_swarm::ack_t> acks;  // what it says of all robots

    // Rule 8.
    static constexpr std::int32_t kNoBoot = -2;
    bool is_forgotten = false;  // an earlier start of ours answered this boot: what, is not known
    // That is never answered again, and all that it was answered by then was said in announcements up to this one.
    std::int32_t given_up_boot = kNoBoot;
    std::int64_t given_up_seq = -1;
    bool given_up = false;  // by so many that nobody waits for it

    bool acknowledged() const;  // by us: what it announces
    bool is_never_answered() const { return given_up_boot == boot; }
    bool is_voted_out() const { return is_never_answered() && seq >= given_up_seq; }  // by us
  };

  explicit CommitProtocol(const Rules& rules);

  // What an earlier start kept, before anything else: which peers it has answered, and gave up.
  void remember(std::int32_t roster_crc, const std::vector<sogm_swarm::ack_t>& acks);

  // The first promise: to hover somewhere, or what was kept over a restart, with the newest trajectory that was forced.
  void start(const Motion& motion, std::int32_t forced_seq = 0);
  // This start is a later one after all, before anything was committed: nothing that was said of it before counts.
  void set_boot(std::int32_t boot);
  // So far from its motion the robot may be: announced as a part of the radius, which is kept free around what is new.
  // What is closer to another already may stay so.
  void set_error_bound(double bound_m) { error_bound_m_ = bound_m; }
  // While a peer's clock is known to be wrong, nothing is committed but what is urgent.
  void doubt_clocks(bool doubt) { doubts_clocks_ = doubt; }
  const std::optional<Motion>& motion() const { return motion_; }
  const Trajectory& pending() const { return pending_; }  // waits for acknowledgements; may be empty
  const std::map<int, Peer>& peers() const { return peers_; }
  bool all_hear() const;  // and were heard, but for those that were given up
  double radius_m() const { return rules_.radius_m + error_bound_m_; }  // as announced

  // For who flies in cells (cell_protocol.h). From now on these are the peers; who stays among them stays known.
  void set_peers(const std::set<int>& ids);
  std::int32_t roster_crc() const { return roster_crc_; }
  // The newest announcements of robots that are no peers, and that nobody asks: of each the committed motion and the
  // pending trajectory are kept off as if flown, as those of a peer that was given up.
  void set_tombstones(const std::vector<sogm_swarm::announcement_t>& tombstones);
  // Nothing is committed but what is urgent, whoever agrees.
  void withhold(bool withholds) { withholds_ = withholds; }

  // The own clock is set, by `step` to `now`, while the robot rests: what is pending is withdrawn, and where what
  // it has flown ends in the future now, it is bound to hover there. That asks nobody, but it is what it does. Peers
  // move when they did, by the new clock; nothing is committed before each was heard again, as after a restart (rule
  // 5).
  void set_clock(Utime now, Duration step);

  // The robot has left its motion: from now on it is bound to `motion` from where it really is, whoever is there. It is
  // forced (rule 6), as it is what the robot does.
  void force(const Trajectory& motion);

  // Announces a candidate that leaves the committed motion in the future. kNone, kNoCommitted, kWaiting or kClock (not
  // when it is urgent), kBusy or kConflict. One that still waits is withdrawn.
  Rejection propose(Utime now, const Trajectory& candidate, bool urgent = false);
  // Whether a peer sent it, and knows the same roster.
  bool is_of_roster(const sogm_swarm::announcement_t& message) const;
  // A peer's announcement, newer than all before; others change nothing. A new start of a peer is kept before it is
  // answered; where that fails, it was not heard.
  void receive(Utime now, const sogm_swarm::announcement_t& message, const Keep& keep);
  // The same announcement as another one repeats it: what is known of the peer, not to be answered.
  void learn(const sogm_swarm::announcement_t& message, const Keep& keep);
  // The peer is not to be waited for: this start of it is given up, once that is kept. False: it cannot be, or was
  // before.
  bool give_up(int id, const Keep& keep);
  // Whether a peer may know less of this one, which was given up here, than is known here.
  bool must_repeat(int id) const;
  // A peer that was not given up itself has given this start of this robot up: it has to start anew (set_boot()).
  bool is_given_up() const;
  // Switches to and withdraws what is due.
  void advance(Utime now);
  // Whether what is pending may be committed now; then commit() does it, unless `keep` fails: what it is handed must
  // survive a crash.
  bool may_commit(Utime now) const;
  bool commit(const Keep& keep);

  // All but the header and what is known of clocks.
  sogm_swarm::announcement_t state() const;
  // What has to survive a crash: the same, and what was said of peers that were not heard since the last one.
  sogm_swarm::announcement_t promise() const;
  // Whether state() has changed since the last call in what peers wait for or have to know soon: not by a commit of
  // what they have agreed to, nor by the switch to it. Of answers alone: several may be given together.
  enum class News : std::uint8_t { kNone, kAnswers, kMore };
  News take_news();
  // state() was said; what peers announce once more after this they still wait for.
  void said() { is_asked_again_ = false; }
  // Whether what state() says is still to arrive: somebody waits for an answer of this robot, it for theirs, or it
  // flies what they were not asked for.
  bool is_awaited(Utime now) const;
  // It hovers, and asks for nothing else.
  bool rests(Utime now) const { return pending_.empty() && motion_ && motion_->end_utime() <= now; }
  int commits() const { return commits_; }
  int forced() const { return forced_; }  // of them
  int withdrawn() const { return withdrawn_; }
  // When advance() has something to do; kNever: not.
  Utime due_utime(Utime now) const;

 private:
  void number_places();
  // The peer, where the announcement is its newest.
  Peer* take(const sogm_swarm::announcement_t& message, const Keep& keep);
  void judge(Utime now, int peer_id, Peer* peer);
  bool waits_for_us(const Peer& peer) const;
  void withdraw();
  bool bears_on_votes(const sogm_swarm::announcement_t& message) const;
  void count_votes();
  static bool tells_of(const Peer& other, const Peer& peer);
  bool are_enough_against(const Peer& peer) const;
  std::size_t num_robots() const { return peers_.size() + 1; }
  bool is_agreed() const;
  double apart_m(double radius_m, double other_radius_m) const {
    return radius_m + other_radius_m + rules_.separation_m;
  }
  bool free_of(const Trajectory& trajectory, const Motion& other, double other_radius_m) const;
  // The trajectory, this robot's or the peer's, of the motion that the other one is bound to: or does not come nearer
  // to it, where they are too close already.
  bool keeps_off(const Trajectory& trajectory, const Motion& bound, const Peer& peer) const;
  // The trajectory of all that robots may fly that are not asked: peers that were given up, whatever was said to them,
  // and others.
  bool keeps_off_tombstones(const Trajectory& trajectory) const;

  Rules rules_;
  std::int32_t roster_crc_ = 0;
  std::size_t place_ = 0;  // of this robot in the roster
  std::optional<Motion> motion_;
  Trajectory pending_;
  Utime stamp_{};
  bool urgent_ = false;  // what is pending
  std::int32_t forced_seq_ = 0;
  bool doubts_clocks_ = false;
  double error_bound_m_ = 0.0;
  std::int32_t next_seq_ = 1;
  std::map<int, Peer> peers_;  // all of the roster but this one
  std::vector<Peer> tombstones_;
  bool withholds_ = false;
  bool news_ = false, answers_ = false, is_asked_again_ = false;
  int commits_ = 0, forced_ = 0, withdrawn_ = 0;
};

}  // namespace swarm
