// The broadcast daemon's node: owns the committed trajectory, runs the commit protocol with the peers, samples
// setpoints.
//
// The protocol, for each pair of robots: the lower id is the holder, the other the asker. A robot announces a pending
// trajectory P that leaves its committed one C at its start time, and commits it before that time when, for every peer
// j of the roster, (it holds the pair, or j acknowledged P) and P is free of what it acknowledged of j and, if it
// holds, free of j's C. An acknowledgement binds until a newer announcement of the peer no longer shows that P. So what
// an asker flies or may still commit is always known to the holder, whose own commits stay free of it; whatever is
// delayed or lost, no two committed motions conflict. Every announcement is the whole state, repeated, so losses heal.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/option_set.h"
#include "planner_daemon/trajectory.h"

namespace swarm {

struct BroadcastConfig {
  int robot_id = 0;
  double radius_m = 0.2;
  std::vector<int> roster;     // ids of all other robots: nothing is committed before each was heard
  double v_max = 2.0;          // per axis [m/s]: candidates beyond are rejected
  double a_max = 6.0;          // per axis [m/s^2]
  double separation_m = 0.02;  // kept between surfaces of committed motions
  double announce_s = 0.05;    // repetition of the announcement
  double setpoint_rate_hz = 100;
  double yaw_rate_max = 1.5;   // [rad/s]
  double clock_limit_s = 0.1;  // messages from further in the future are refused
};

void declare(OptionSet& options, BroadcastConfig& config);
// Throws OptionError on combinations that cannot work.
void verify(const BroadcastConfig& config);

// Why a candidate was rejected; index into broadcast_status_t.rejected.
enum class Rejection : std::uint8_t {
  kNone = 0,
  kNoCommitted,    // no robot state yet
  kWaiting,        // a roster peer was never heard
  kBusy,           // a committed trajectory has not begun yet
  kTime,           // starts in the past or too far in the future
  kDiscontinuous,  // does not start on the committed motion
  kLimits,         // exceeds speed or acceleration
  kConflict,       // comes too close to a peer's motion
};
inline constexpr int kNumRejections = 8;
const char* to_string(Rejection rejection);

class BroadcastNode : public Node {
 public:
  BroadcastNode(const BroadcastConfig& config, std::int32_t boot);

  std::vector<Subscription> subscriptions() const override;
  void on_message(std::int64_t now_us, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  std::int64_t step(std::int64_t now_us, Outbox& outbox) override;

  // The motion this robot is bound to; none before the first robot state.
  const std::optional<Motion>& motion() const { return motion_; }
  int commits() const { return commits_; }
  int withdrawn() const { return withdrawn_; }
  std::int32_t rejected(Rejection reason) const { return rejected_[static_cast<std::size_t>(reason)]; }
  const RefusalCounts& refused() const { return refused_; }
  std::int32_t lost() const;

 private:
  struct PeerState {
    SequenceGate gate;
    bool heard = false;
    std::int64_t heard_us = 0, utime = 0;
    std::int32_t boot = 0;
    std::int64_t seq = 0;
    std::int32_t lost = 0;
    double radius_m = 0.0;
    Motion motion;                // what the peer is bound to
    Trajectory announced;         // its pending trajectory, not yet committed; may be empty
    std::int64_t stamp = 0;       // of announced
    std::int32_t judged_seq = 0;  // newest pending trajectory of the peer that was judged here, and the verdict
    std::int8_t verdict = 0;
    std::int32_t mine_seq = 0;  // newest of ours that the peer judged, and its verdict
    std::int8_t mine_verdict = 0;
  };

  Refusal on_state(std::int64_t now_us, std::span<const std::uint8_t> bytes);
  Refusal on_candidate(std::int64_t now_us, std::span<const std::uint8_t> bytes);
  Refusal on_peer(std::int64_t now_us, std::span<const std::uint8_t> bytes, Outbox& outbox);
  Rejection examine(std::int64_t now_us, const Trajectory& candidate) const;
  void judge(std::int64_t now_us, PeerState& peer, int peer_id);
  bool may_commit() const;
  void advance(std::int64_t now_us);  // commit, withdraw, switch: whatever is due
  void withdraw();
  bool free_of(const Trajectory& mine, const Motion& other, double other_radius_m) const;

  void announce(std::int64_t now_us, Outbox& outbox);
  void publish_setpoint(std::int64_t utime, Outbox& outbox);
  void publish_status(std::int64_t now_us, Outbox& outbox);

  BroadcastConfig config_;
  std::int32_t boot_;
  HeaderSource announcement_headers_, setpoint_headers_, status_headers_;
  RefusalCounts refused_;
  std::array<std::int32_t, kNumRejections> rejected_{};

  std::optional<Motion> motion_;
  Trajectory announced_;  // our pending trajectory while it waits for acknowledgements
  std::int64_t stamp_ = 0;
  std::int32_t next_seq_ = 1;
  std::map<int, PeerState> peers_;  // the roster
  SequenceGate state_gate_, candidate_gate_;
  double yaw_ = 0.0;

  bool changed_ = false;  // the announcement has news
  std::int64_t next_announce_us_ = 0, next_setpoint_us_ = 0, next_status_us_ = 0;
  std::int32_t candidates_ = 0, commits_ = 0, withdrawn_ = 0;
};

}  // namespace swarm
