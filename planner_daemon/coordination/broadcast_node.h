// The broadcast daemon's node: owns the committed trajectory, runs the commit protocol with the peers, samples
// setpoints, and knows where the robot is in its flight.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/receive.h"
#include "lcmtypes/bus/recurring.h"
#include "planner_daemon/coordination/broadcast_config.h"
#include "planner_daemon/coordination/cell_protocol.h"
#include "planner_daemon/coordination/flight_state.h"
#include "planner_daemon/coordination/identity.h"
#include "planner_daemon/coordination/peer_link.h"
#include "planner_daemon/coordination/promise_store.h"
#include "planner_daemon/coordination/roster_protocol.h"
#include "planner_daemon/coordination/strangers.h"
#include "planner_daemon/coordination/tracking_monitor.h"

namespace swarm {

class BroadcastNode : public Node {
 public:
  // Goes on with what `store` kept, which must outlive the node; `first_boot` where it kept nothing.
  BroadcastNode(const BroadcastConfig& config, PromiseStore& store, std::int32_t first_boot);

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;
  // Not while the robot moves, or its setpoints would jump: what is committed is flown to its end by the time it was
  // committed in, and nothing is committed meanwhile.
  bool on_clock_step(Utime now, Duration step) override;
  Activity activity(Utime now) const override;

  const CommitProtocol& protocol() const { return protocol_; }
  // The motion this robot is bound to; none before the first robot state.
  const std::optional<Motion>& motion() const { return protocol_.motion(); }
  std::int32_t rejected(Rejection reason) const { return rejected_[static_cast<std::size_t>(reason)]; }
  const RefusalCounts& refused() const { return refused_; }
  std::int32_t lost() const;

 private:
  // What the robot itself says (broadcast_onboard.cpp). Its other daemons follow the wall clock at once: where this
  // one does not yet, their messages are in that time, and `ahead` is by how much.
  template <class T>
  Refusal receive_onboard(Utime now, std::span<const std::uint8_t> bytes, SequenceGate& gate, T* message,
                          Duration* ahead) const;
  Refusal on_state(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_order(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_vehicle(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_candidate(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_own(Utime now, std::span<const std::uint8_t> bytes);
  // How far the robot is from its motion; one that has left it goes on from where it is.
  void track(Utime now, const sogm_swarm::robot_state_t& state);
  // What is wrong with a candidate as a motion of this robot.
  Rejection examine(Utime now, const Trajectory& candidate) const;
  void fly(Utime now);                        // from the ground to the ground: what comes next by itself
  FlightState::Robot robot(Utime now) const;  // of flight_; there is a motion

  // What others say (broadcast_peers.cpp).
  Refusal on_peer(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_own_returned(Utime now, const sogm_swarm::header_t& header);
  Refusal on_last_words(Utime now, std::span<const std::uint8_t> bytes);
  // Of somebody who is not of the roster.
  Refusal on_stranger(Utime now, sogm_swarm::announcement_t* message);
  void relay_strangers(Utime now, Outbox& outbox);
  // Of a peer, from whatever channel.
  Refusal heard(Utime now, CellAnnouncement said);
  // What a peer says by a clock that is wrong, or was heard since ours was set: nothing that was promised is known by
  // it, but where the peer is.
  void on_other_time(Utime now, sogm_swarm::announcement_t* message);
  void doubt_clock_of(int id, Utime now, Duration ahead);  // by so much it is ahead, or more
  TimeWindow lately(Utime now) const { return {now, kMaxAge, to_duration(config_.clock_error_s)}; }
  // Has what waits from peers judged and relayed: of each peer the newest, twice as often as it may speak at most, and
  // of few peers at once. The rest waits until after the setpoint.
  void judge_peers(Utime now, Outbox& outbox);
  void follow_peers();  // who come and go
  // Those that were not heard for too long; and starts anew where that was this one.
  void give_up(Utime now);
  // By the operator's word; whether it is given up by this robot now.
  bool go_on_without(Utime now, int id);
  bool is_silent(Utime now, const PeerLink& link) const;
  // It speaks, but does not hear this robot, or by a clock by which nobody can commit. Called once each kVotePeriod.
  bool is_in_vain(const CommitProtocol::Peer& peer, PeerLink* link) const;
  bool is_known(const sogm_swarm::announcement_t& message) const;  // to the protocol, as a peer's newest
  // Of those that were given up, to peers that know less.
  void repeat_last_words(Utime now, Outbox& outbox);
  // What those may fly that are not asked any more, to the planner: it may have started since.
  void show_tombstones(Utime now, Outbox& outbox);

  // In cells (broadcast_cells.cpp).
  static std::unique_ptr<CellProtocol> in_cells(const CommitProtocol::Rules& rules, double edge_m);  // null: 0 m
  Refusal on_cell_announcement(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_cell_roster(Utime now, std::span<const std::uint8_t> bytes);
  void listen_in_cells(Outbox& outbox);  // that it has to do with

  Rejection propose(Utime now, const Trajectory& candidate, bool urgent = false);
  void advance(Utime now);
  void commit(Utime now);                          // what is agreed on
  bool keep(Utime now, CellAnnouncement promise);  // see store_fails_
  void keep_promise(Utime now);                    // the present one
  FlightAgreement::Keep keeper(Utime now);
  void set_boot(std::int32_t boot);
  bool clocks_agree(Utime now) const { return offered_step_ == 0us && now > clock_doubt_until_; }

  Utime announce_due(Utime now);
  void announce(Utime now, Outbox& outbox);
  void say(CellAnnouncement* message, Outbox& outbox);  // to the roster or in cells
  void publish_own(Utime now, sogm_swarm::announcement_t message, Outbox& outbox);
  void publish_setpoint(Utime now, Outbox& outbox);

  // What it says of itself (broadcast_activity.cpp).
  std::int16_t state(Utime now) const;        // one of broadcast_status_t's
  Activity flight_activity(Utime now) const;  // of one that may commit
  void publish_status(Utime now, Outbox& outbox);
  void publish_flight_status(Utime now, Outbox& outbox);

  static constexpr Duration kMaxAge = 1s;  // of messages from peers, keepers and planner
  static constexpr Duration kClockDoubt = 1s;

  BroadcastConfig config_;
  PromiseStore& store_;
  KeptPromise kept_;
  HeaderSource announcement_headers_, own_headers_, words_headers_, setpoint_headers_, status_headers_, flight_headers_,
      promise_headers_;
  std::unique_ptr<CellProtocol> cells_;  // null: it flies by the roster
  RosterProtocol by_roster_;
  FlightAgreement& agreement_;  // the one or the other
  CommitProtocol& protocol_;
  std::set<Cell> listens_in_;
  std::set<std::string> listens_on_;  // channels
  bool fits_frame_ = true;            // what it has to say in cells
  Identity identity_;
  TrackingMonitor tracking_;
  FlightState flight_;
  MotionState measured_;  // position and velocity of the newest robot state
  RefusalCounts refused_;
  std::array<std::int32_t, kNumRejections> rejected_{};
  std::map<int, PeerLink> links_;  // by peer
  Strangers strangers_;
  SequenceGate state_gate_, candidate_gate_, order_gate_, vehicle_gate_;
  double yaw_rad_ = 0.0;
  bool store_fails_ = false;

  Duration gap_{};                  // between announcements on average, at least: two may go at once
  Duration pause_{};                // after the newest one
  Utime news_may_go_{};             // no earlier
  bool has_answers_alone_ = false;  // of the news
  Utime answers_since_{};
  Utime clock_doubt_until_{};  // a peer's message came from the future, or its clock was found wrong
  Utime clock_set_until_{};    // our clock was set lately
  Duration offered_step_{};    // of the wall clock, which is followed when the robot rests; 0: it was not set
  bool has_news_ = false, has_own_news_ = false;  // for peers; for the planner
  std::optional<Utime> began_;                    // to wait for peers that were never heard
  Utime stepped_{};
  Recurring vote_, words_, tombstones_, news_, announcement_, setpoint_, status_, flight_status_, leg_;
  std::int32_t candidates_ = 0;
  struct InVain {  // candidates since one was committed, or any could be
    int count = 0;
    Utime first{}, newest{};
    std::array<std::int32_t, kNumRejections> rejected{};
  };
  InVain in_vain_;
  struct Doubt {  // whose clock was found wrong last
    int id = -1;  // none: the own one was set
    Duration ahead{};
  };
  Doubt doubt_;
};

}  // namespace swarm
