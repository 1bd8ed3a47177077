// The planner daemon's node: plans once per SOGM, from the committed motion, towards the goal.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/receive.h"
#include "lcmtypes/bus/recurring.h"
#include "map_daemon/sogm_codec.h"
#include "planner_daemon/coordination/commit_delay.h"
#include "planner_daemon/give_way.h"
#include "planner_daemon/planner.h"
#include "planner_daemon/rehearsal.h"
#include "planner_daemon/trajectory/mission.h"

namespace swarm {

struct PlannerNodeConfig {
  int robot_id = 0;
  PlannerConfig planner;
  double lead_s = 0.025;        // from the start of planning to the announcement, until that was measured
  double period_s = 0.04;       // least time between plans
  double calm_period_s = 0.25;  // the same, while nothing asks for one
  double stale_map_s = 0.35;    // an older SOGM is not planned with
  double clock_limit_s = 0.1;   // messages from further in the future are refused
};

void declare(OptionSet& options, PlannerNodeConfig& config);
// Throws OptionError on combinations that cannot work.
void verify(const PlannerNodeConfig& config);

class PlannerNode : public Node {
 public:
  // `boot`: grows at every start. Unless `durations_count` what the stopwatch (may be null) says changes nothing, also
  // no message: in simulated time planning takes what the host says.
  PlannerNode(const PlannerNodeConfig& config, std::int32_t boot, Stopwatch stopwatch, bool durations_count = true);

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;
  bool on_clock_step(Utime now, Duration step) override;
  Activity activity(Utime now) const override;

  const PlanResult& newest_plan() const { return newest_ != nullptr ? *newest_ : no_plan_; }
  const PlanRequest& newest_request() const { return request_; }  // what it was made for; only right after the plan
  int plans() const { return plans_; }
  int missed() const { return missed_; }
  const RefusalCounts& refused() const { return refused_; }

 private:
  Refusal on_sogm(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_seen_space(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_own(std::span<const std::uint8_t> bytes);
  Refusal on_peer(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_goal(std::span<const std::uint8_t> bytes);
  Refusal on_flight_status(Utime now, std::span<const std::uint8_t> bytes);
  TimeWindow window(Utime now) const;  // how old maps and announcements may be, and how far ahead
  Duration calm_period(Utime now) const;
  bool is_calm(Utime now) const;  // nothing asks for a plan
  bool flies_newest() const;      // the plan: it was committed, or is to go on hovering
  // When an obstacle comes within the clearance of what the robot is bound to; kNever: not until then.
  Utime touch_utime(Utime now, Utime until) const;
  Utime start_utime(Utime now, bool is_slow);  // of the next plan
  PlanDelay& delay_of(bool is_slow) { return plan_delays_[is_slow ? 1 : 0]; }
  void plan(Utime now, Outbox& outbox);
  void forget_peers(Utime now);
  void publish_corridors(Utime now, Outbox& outbox);
  bool is_stale(Utime now) const;                                                          // the map
  bool is_led() const { return flight_.led_to != sogm_swarm::flight_status_t::kNowhere; }  // by this planner
  std::optional<Eigen::Vector3d> destination() const;                                      // none: it keeps its place
  std::int16_t state(Utime now) const;                                                     // one of planner_status_t's
  std::int16_t planning_state() const;
  void publish_status(Utime now, std::int16_t state, Outbox& outbox);

  PlannerNodeConfig config_;
  bool durations_count_;
  Planner planner_;
  SogmAssembler assembler_;
  RefusalCounts refused_;
  HeaderSource candidate_headers_, corridor_headers_, status_headers_;

  Sogm map_;                   // the newest complete one
  Duration map_period_{};      // it came so long after the one before
  bool map_is_new_ = false;    // not planned with yet
  bool map_can_wait_ = false;  // nor need it be soon: the next one may come first
  SogmAssembler seen_parts_;
  Sogm seen_;                           // two frames: what stands, and what was not seen; none before the first
  Utime ways_utime_{};                  // of the map with which the ways to another goal were worked out last
  std::optional<Rehearsal> rehearsal_;  // until it is over
  std::optional<Motion> own_;
  bool peers_come_and_go_ = false;     // as robots in cells do
  double margin_m_ = 0.0;              // beyond the clearance, as the broadcaster announces it
  Trajectory pending_;                 // of our plans: waits for acknowledgements; may be empty
  Utime pending_stamp_{};              // when it was announced
  std::optional<Utime> urgent_start_;  // of the newest plan; none: it is not urgent
  struct Planned {
    Utime begun, start;
    double took_s;
    bool is_slow;
  };
  std::optional<Utime> asked_;            // the start of the newest plan's candidate; none: it was to go on hovering
  std::optional<Planned> planned_;        // the newest candidate, until it is announced
  std::array<PlanDelay, 2> plan_delays_;  // of plans that are not slow, and of slow ones
  CommitDelay commit_delay_;
  MissionProgress mission_;
  sogm_swarm::flight_status_t flight_ = [] {  // the newest; it flies to its goal until there is one
    sogm_swarm::flight_status_t status{};
    status.state = sogm_swarm::flight_status_t::kFlying;
    status.led_to = sogm_swarm::flight_status_t::kGoal;
    return status;
  }();
  GiveWay give_way_;
  std::optional<Eigen::Vector3d> hold_;  // where it rested when planning began: the goal until there is one
  SequenceGate own_gate_, goal_gate_, flight_gate_;
  struct PeerEntry {
    SequenceGate gate;
    std::size_t place;      // in peer_list_
    Utime heard{}, told{};  // something new of it; or the same again
  };
  std::map<int, PeerEntry> peers_;
  std::vector<Peer> peer_list_;  // as heard, handed to the planner
  PlanRequest request_;
  std::optional<Eigen::Vector3d> planned_to_;  // the destination of the newest plan

  const PlanResult* newest_ = nullptr;
  const PlanResult no_plan_{};    // before the first
  std::deque<Utime> plan_times_;  // within the last second
  Recurring plan_, status_;
  std::int32_t plans_ = 0, missed_ = 0, candidate_seq_ = 0;
};

}  // namespace swarm
