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
//  3. Commit before t_b, when every roster peer was heard and has heard this start of the daemon and, for each of them,
//     (this robot holds the pair, or the peer acknowledged P) and P is free of what it acknowledged and, if it holds,
//     free of the peer's C. The commit is on disk before it is announced or flown.
//  4. Withdraw P at t_b, or when a holder refuses it. A number is never used again.
//  5. Restart: C comes from the disk, `boot` grows (where nothing was kept, or the robot is elsewhere, C is to hover
//     where it is: nobody was asked, but that is where it is). A new boot of a peer voids what it acknowledged, its P
//     and the verdict on it. Nothing is committed before every peer has echoed the new boot: it then no longer relies
//     on anything this robot said before the crash.
//  6. Last resort: a P that is urgent, because the robot will be hit on C, is committed a moment before t_b without
//     everybody's word, when it is free of every C and P that is known. Such a P is `forced`; it may meet what a holder
//     that has not answered commits meanwhile, what a peer commits that has not echoed this start (it may rely on an
//     answer from before), or a robot that was never heard. Two robots that are closer than they may be since then may
//     commit what does not bring them nearer.
//  7. A robot that is off its motion by up to an error bound announces its radius with it; what is new keeps that off.
//     Robots that are closer than that, but no closer than they may be without it, may likewise commit what does not
//     bring them nearer. One that has lost its motion altogether is bound to how it comes to rest: that is forced.
// Every announcement is the whole state (C, P, verdicts on what peers still announce), repeated for ever, and only
// newer ones (boot, seq) are read: so losses heal, and duplicates and reordering change nothing.
//
// Why it is safe, but for what is forced: what an asker flies or may still commit is always among what the holder knows
// (its C, or a P that the holder acknowledged and keeps), and the holder commits nothing that conflicts with that. An
// asker commits nothing without the holder's word, given against the holder's own C and P. Who waits for whom: an asker
// for the answers of robots with lower ids, a robot that starts for everybody's echo. A robot that falls silent keeps
// its C (and its acknowledged P) for ever: its holders fly on around it, its askers come to rest where they promised
// to. Nobody waits in a circle, for ids only fall: the lowest id that flies waits for nobody, and so on upwards; a P
// that loses to another is withdrawn, not kept waiting.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
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
  };
  // What is known of a peer.
  struct Peer {
    bool heard = false;
    bool hears_us = false;       // it has echoed this start of ours
    std::int32_t our_boot = -1;  // that it has echoed
    std::int32_t boot = -1;
    double radius_m = 0.0;        // as announced: with what it may err by
    double least_radius_m = 0.0;  // that it ever announced: what it is without
    Motion motion;                // what it is bound to
    Trajectory pending;           // announced, not yet committed; may be empty
    Utime stamp{};                // of pending
    std::int32_t judged_seq = 0;  // newest pending trajectory of this boot that was judged here, and the verdict
    std::int8_t verdict = 0;
    std::int32_t our_seq = 0;  // newest of ours that it judged, and its verdict
    std::int8_t our_verdict = 0;

    bool acknowledged() const;  // by us: what it announces
  };

  explicit CommitProtocol(const Rules& rules);

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
  bool all_hear() const;  // and were heard
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
  // A peer's announcement, newer than all before; others change nothing.
  void receive(Utime now, const sogm_swarm::announcement_t& message);
  // Switches to and withdraws what is due.
  void advance(Utime now);
  // Whether what is pending may be committed now; then commit() does it, unless `keep` fails: what it is handed must
  // survive a crash.
  bool may_commit(Utime now) const;
  void commit(const std::function<bool(const sogm_swarm::announcement_t&)>& keep);

  // All but the header and what is known of clocks.
  sogm_swarm::announcement_t state() const;
  // Whether state() has changed since the last call in what peers wait for or have to know soon: not by the switch to
  // what they know as next, nor by a verdict for a robot that goes by right of way.
  bool take_news();
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
  void judge(Utime now, int peer_id, Peer* peer);
  void withdraw();
  bool everybody_agrees() const;
  double radius_m() const { return rules_.radius_m + error_bound_m_; }
  double apart_m(double radius_m, double other_radius_m) const {
    return radius_m + other_radius_m + rules_.separation_m;
  }
  bool free_of(const Trajectory& trajectory, const Motion& other, double other_radius_m) const;
  // The trajectory, this robot's or the peer's, of the motion that the other one is bound to: or does not come nearer
  // to it, where they are too close already.
  bool keeps_off(const Trajectory& trajectory, const Motion& bound, const Peer& peer) const;

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
  bool news_ = false;
  int commits_ = 0, forced_ = 0, withdrawn_ = 0;
};

}  // namespace swarm
