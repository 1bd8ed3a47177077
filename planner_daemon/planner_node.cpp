// Long because a daemon's whole reaction to each message, and all that it says, is to be read in one place.
#include "planner_daemon/planner_node.h"

#include <algorithm>
#include <iterator>
#include <stdexcept>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/text.h"
#include "planner_daemon/space/first_touch.h"

namespace swarm {
namespace {

using sogm_swarm::announcement_t;
using sogm_swarm::flight_status_t;
using sogm_swarm::planner_status_t;

constexpr Duration kMaxAge = 1s;
constexpr Duration kStatusPeriod = 1s;
constexpr Duration kElsewhere = 3s;   // where peers come and go, one that was not heard for so long has flown elsewhere
constexpr Duration kSilent = 500ms;   // a peer that was not heard for so long may have to step aside unseen
constexpr Duration kUrgent = 1s;      // before an obstacle comes, a plan must begin to get out of its way
constexpr Duration kGetAway = 600ms;  // and can begin at the latest
constexpr Duration kMostMapPeriod = 100ms;  // that a calm plan is timed by
constexpr double kCalmWay_m = 0.5;          // flown between two plans, at most, while nothing asks for one
constexpr double kSamePlace_m = 1e-3, kRest_mps = 1e-2, kRest_mps2 = 0.1;

// From then on at rest at one place, as near as anybody sees.
bool hovers(const Motion& motion, Utime from, const Eigen::Vector3d& place) {
  for (Utime t = from; t != kNever; t = motion.next_knot_after(t)) {
    const MotionState state = motion.at(t);
    if ((state.position - place).norm() > kSamePlace_m || state.velocity.norm() > kRest_mps ||
        state.acceleration.norm() > kRest_mps2)
      return false;
  }
  return true;
}

// Where the robot hovers by then anyhow, a plan to hover on says nothing new.
bool is_hover_again(const Motion& own, const Trajectory& plan) {
  const Eigen::Vector3d place = own.at(own.end_utime()).position;
  return hovers({plan, {}}, plan.start_utime(), place) && hovers(own, plan.start_utime(), place);
}

}  // namespace

void declare(OptionSet& options, PlannerNodeConfig& config) {
  PlannerConfig& planner = config.planner;
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("radius", &planner.space.radius_m, 0.01, 10, "m", "of the sphere that holds the robot");
  options.add("clearance", &planner.space.clearance_m, 0, 5, "m",
              "beyond the radius, to occupied voxels: free space of search, corridor and check");
  options.add("emergency-clearance", &planner.space.emergency_clearance_m, 0, 5, "m",
              "in an emergency, when nothing survives: given up last before a collision");
  options.add("inflation", &planner.space.inflation_m, 0, 5, "m",
              "beyond the clearance: avoided where that costs little time");
  options.add("silent-peer-margin", &planner.space.silent_peer_margin_m, 0, 5, "m",
              "around peers that have fallen silent, where that costs little time: they may have to step aside unseen");
  options.add("recently-occupied", &planner.space.recently_occupied_s, 0, 2, "s",
              "where an obstacle was until this long before is avoided: it may turn");
  declare(options, planner.limits);
  options.add("space-min", &planner.limits.space_min, -1e5, 1e5, "m",
              "flight space of the robot's centre, lower corner");
  options.add("space-max", &planner.limits.space_max, -1e5, 1e5, "m",
              "flight space of the robot's centre, upper corner");
  options.add("static-map", &planner.static_map, "OctoMap file (.bt or .ot) that leads to the goal; empty: none");
  options.add("explores", &planner.explores,
              "with sensors that do not see all and without static-map: ways keep off what is above and below what is "
              "seen to stand, as long as nobody looked there");
  options.add("piece-us", &planner.search.piece, 10ms, 10s, "duration of a motion primitive and trajectory piece");
  options.add("pieces", &planner.search.num_pieces, 2, Trajectory::kMaxPieces, "",
              "horizon in pieces, braking to rest included");
  options.add("max-expansions", &planner.search.max_expansions, 10, 5000, "", "budget of the search; 10 kB each");
  options.add("inflation-weight", &planner.search.inflation_weight, 0, 100, "",
              "cost of a second within the inflation, in seconds of flight");
  options.add("recently-occupied-weight", &planner.search.recently_occupied_weight, 0, 100, "",
              "cost of a second where an obstacle was recently, on top, in seconds of flight");
  options.add("corridor-extent", &planner.corridor.extent_m, 0.1, 10, "m",
              "how far a corridor extends beyond its piece");
  options.add("lead", &config.lead_s, 0.005, to_seconds(kMaxAhead) - CommitDelay::kLongest_s, "s",
              "from the start of planning to the announcement, until that was measured; the plan begins later still by "
              "what the "
              "peers' answers take");
  options.add("period", &config.period_s, 0, 10, "s", "least time between plans");
  options.add("calm-period", &config.calm_period_s, 0, 10, "s",
              "the same, while nothing comes into the way of what is flown and the goal stays");
  options.add("stale-map", &config.stale_map_s, 0.05, 10, "s", "an older map is not planned with");
  options.add(
      "clock-error", &planner.space.clock_error_s, 0, 1, "s",
      "clocks of two robots differ by at most this: peers are avoided as if they came so much earlier or later");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s", "messages from further in the future are refused");
}

void verify(const PlannerNodeConfig& config) {
  const SearchLimits& limits = config.planner.limits;
  verify(limits);
  for (int axis = 0; axis < 3; ++axis) {
    if (limits.space_min[axis] >= limits.space_max[axis]) {
      throw OptionError("--space-min: must be below --space-max on every axis");
    }
  }
  if (config.planner.space.emergency_clearance_m > config.planner.space.clearance_m)
    throw OptionError("--emergency-clearance: must be at most --clearance");
  if (const Duration horizon = config.planner.search.num_pieces * config.planner.search.piece;
      horizon > kMaxMotion - kMaxAhead) {
    throw OptionError("--pieces, --piece-us: " + text_of(to_seconds(horizon)) + " s in all; must be at most " +
                      text_of(to_seconds(kMaxMotion - kMaxAhead)) + " s");
  }
  try {
    [[maybe_unused]] const Primitives probe(limits, config.planner.search);
  } catch (const std::invalid_argument& error) {
    throw OptionError(std::string("--pieces, --piece-us: ") + error.what());
  }
}

PlannerNode::PlannerNode(const PlannerNodeConfig& config, std::int32_t boot, Stopwatch stopwatch, bool durations_count)
    : config_(config),
      durations_count_(durations_count && stopwatch),
      planner_((verify(config), config.planner), std::move(stopwatch)),
      candidate_headers_(config.robot_id, boot),
      corridor_headers_(config.robot_id, boot),
      status_headers_(config.robot_id, boot),
      plan_delays_{PlanDelay(config.lead_s), PlanDelay(config.lead_s)},
      give_way_(config.robot_id, config.planner) {
  if (durations_count_) rehearsal_.emplace(config.planner.limits);
}

std::vector<Subscription> PlannerNode::subscriptions() const {
  return {{BusId::kOnboard, channel::kSogm},           {BusId::kOnboard, channel::kOwnTrajectory},
          {BusId::kOnboard, channel::kPeerTrajectory}, {BusId::kOnboard, channel::kGoal},
          {BusId::kOnboard, channel::kFlightStatus},   {BusId::kOnboard, channel::kSeenSpace}};
}

void PlannerNode::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) {
  Refusal refusal = Refusal::kNone;
  if (channel == channel::kSogm) {
    refusal = on_sogm(now, bytes);
  } else if (channel == channel::kOwnTrajectory) {
    refusal = on_own(bytes);
  } else if (channel == channel::kPeerTrajectory) {
    refusal = on_peer(now, bytes);
  } else if (channel == channel::kSeenSpace) {
    refusal = on_seen_space(now, bytes);
  } else if (channel == channel::kGoal) {
    refusal = on_goal(bytes);
  } else if (channel == channel::kFlightStatus) {
    refusal = on_flight_status(now, bytes);
  }
  if (refusal != Refusal::kNone) refused_.count(refusal);
}

TimeWindow PlannerNode::window(Utime now) const {
  return {now, kMaxAge, to_duration(config_.clock_limit_s)};
}

Refusal PlannerNode::on_sogm(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::sogm_t part;
  // Parts of one map have one number: in which order is for the assembler to say.
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), AnyOrder(), &part);
  if (refusal != Refusal::kNone) return refusal;
  const Utime before = map_.start_utime;
  const Assembly assembly = assembler_.add(part, &map_);
  if (assembly.status == AssemblyStatus::kComplete) {
    map_period_ = std::clamp<Duration>(map_.start_utime - before, 0us, kMostMapPeriod);
    if (map_is_new_ && !map_can_wait_ && is_led()) ++missed_;
    map_is_new_ = true;
    map_can_wait_ = false;
  }
  return assembly.refusal;
}

Refusal PlannerNode::on_seen_space(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::sogm_t part;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), AnyOrder(), &part);
  if (refusal != Refusal::kNone) return refusal;
  if (part.num_frames != 2) return Refusal::kInconsistent;
  return seen_parts_.add(part, &seen_).refusal;
}

Refusal PlannerNode::on_own(std::span<const std::uint8_t> bytes) {
  announcement_t message;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, TimeWindow(), own_gate_, &message);
  if (refusal != Refusal::kNone) return refusal;
  const Utime sent = to_utime(message.header.utime), announced = to_utime(message.pending_stamp);
  const std::int32_t bound_to = own_ ? own_->next.seq() : 0;
  const Trajectory waited = pending_;
  own_ = motion_of(message);
  peers_come_and_go_ = message.num_acks == 0;
  margin_m_ = std::max(0.0f, message.radius - static_cast<float>(config_.planner.space.radius_m));
  pending_ = pending_of(message);
  const Trajectory& newest = pending_.empty() ? own_->next : pending_;
  if (planned_ && !newest.empty() && newest.start_utime() == planned_->start) {
    delay_of(planned_->is_slow).took(to_seconds(announced - planned_->begun));
    planned_.reset();
  }
  if (!own_->next.empty() && own_->next.seq() != bound_to && own_->next.seq() == message.forced_seq) {
    commit_delay_.missed(to_seconds(own_->next.start_utime() - announced));
  } else if (!own_->next.empty() && own_->next.seq() != bound_to) {
    commit_delay_.committed(to_seconds(sent - announced));
  } else if (pending_.seq() != waited.seq() && !waited.empty() && sent >= waited.start_utime()) {
    commit_delay_.missed(to_seconds(waited.start_utime() - pending_stamp_));
  }
  pending_stamp_ = announced;
  return Refusal::kNone;
}

Refusal PlannerNode::on_peer(Utime now, std::span<const std::uint8_t> bytes) {
  announcement_t message;
  const auto from_peer = [this](const announcement_t& m) {
    const int id = m.header.robot_id;
    const bool is_one_more = !peers_.contains(id) && std::ssize(peers_) == kMaxRosterRobots + kMaxStrangers;
    return id == config_.robot_id || is_one_more ? Refusal::kRobot : Refusal::kNone;
  };
  const auto in_order = [this](const announcement_t& m) {
    const auto [found, is_new] = peers_.try_emplace(m.header.robot_id, PeerEntry{{}, peer_list_.size()});
    if (is_new) peer_list_.emplace_back();
    return found->second.gate.pass(m.header);
  };
  const Refusal refusal = receive(bytes, from_peer, window(now), in_order, &message);
  if (refusal == Refusal::kSequence) peers_.at(message.header.robot_id).told = now;  // it is where it was
  if (refusal != Refusal::kNone) return refusal;
  PeerEntry& entry = peers_.at(message.header.robot_id);
  if (!rehearsal_) commit_delay_.heard(to_seconds(std::max(0us, now - to_utime(message.header.utime))));
  Peer& peer = peer_list_[entry.place];
  peer.motion = motion_of(message);
  peer.pending = pending_of(message);
  peer.id = message.header.robot_id;
  peer.radius_m = message.radius;
  entry.heard = entry.told = now;
  peer.space = space_of(peer.motion, peer.pending);
  return Refusal::kNone;
}

Refusal PlannerNode::on_goal(std::span<const std::uint8_t> bytes) {
  sogm_swarm::goal_t message;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, TimeWindow(), goal_gate_, &message);
  if (refusal != Refusal::kNone) return refusal;
  mission_.fly(mission_of(message));
  return Refusal::kNone;
}

// A robot that landed has arrived: it does not fly on to its goal when it takes off again.
Refusal PlannerNode::on_flight_status(Utime now, std::span<const std::uint8_t> bytes) {
  flight_status_t message;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), flight_gate_, &message);
  if (refusal != Refusal::kNone) return refusal;
  if (message.state == flight_status_t::kOnGround && flight_.state != flight_status_t::kOnGround)
    mission_ = MissionProgress();
  if (message.led_to != flight_.led_to) hold_.reset();
  flight_ = message;
  return Refusal::kNone;
}

std::optional<Eigen::Vector3d> PlannerNode::destination() const {
  if (flight_.led_to == flight_status_t::kDestination) return Eigen::Vector3d(flight_.destination);
  if (mission_.empty()) return std::nullopt;
  return mission_.waypoint().position;
}

// All moves when it did; by which clock that is told anew.
bool PlannerNode::on_clock_step(Utime, Duration step) {
  const auto shift = [step](Motion& motion, Trajectory& pending) {
    for (Trajectory* known : {&motion.committed, &motion.next, &pending}) known->shift(step);
  };
  if (own_) shift(*own_, pending_);
  pending_stamp_ += step;
  planned_.reset();
  if (asked_) *asked_ += step;
  if (urgent_start_) *urgent_start_ += step;
  map_.start_utime += step;
  seen_.start_utime += step;
  for (Peer& peer : peer_list_) shift(peer.motion, peer.pending);
  for (auto& [id, entry] : peers_) entry.heard += step, entry.told += step;
  give_way_.shift(step);
  mission_.shift(step);
  return true;
}

Utime PlannerNode::step(Utime now, Outbox& outbox) {
  const bool has_map = map_.num_frames > 0;
  if (has_map && rehearsal_) {
    if (!rehearsal_->plan(map_, &planner_)) rehearsal_.reset();
    map_is_new_ = false;  // it took its time
    return now + 1us;
  }
  Utime wake = std::max(status_.due(now, kStatusPeriod), now + 1us);
  if (map_is_new_ && own_ && !is_stale(now) && is_led()) {
    // One plan at a time: one that has not begun yet is waited for, whether it is committed or pending.
    const Utime period_due = plan_.due(now, to_duration(config_.period_s));
    Utime due = period_due;
    for (const Trajectory* coming : {&own_->next, &pending_}) {
      if (!coming->empty()) due = std::max(due, coming->start_utime());
    }
    // But not for a patient one while an obstacle comes.
    const bool is_patient = own_->next.empty() && !pending_.empty() && pending_.start_utime() != urgent_start_;
    const Utime latest = std::min(pending_.start_utime(), now + kMaxAhead);
    if (now < due && is_patient && touch_utime(now, latest + kUrgent) != kNever) due = period_due;
    // A calm plan is made as soon as the map comes that is the nearest to when it is due.
    const Utime calm_due = plan_.due(now, calm_period(now));
    if (now >= due && now + map_period_ / 2 < calm_due && !map_can_wait_ && is_calm(now)) {
      map_can_wait_ = true;  // looked at once for each map
      request_.own = *own_;
      request_.start_utime = now;
      planner_.prepare_meanwhile(request_);
    }
    if (map_can_wait_ && planned_to_ == destination()) due = std::max(due, calm_due + map_period_ / 2);
    if (now < due) {
      wake = std::min(wake, due);
    } else {
      plan(now, outbox);
      if (map_is_new_) wake = now + 1us;
    }
  }
  if (now >= status_.due(now, kStatusPeriod)) {
    publish_status(now, state(now), outbox);
    wake = std::min(wake, status_.due(now, kStatusPeriod));
  }
  return std::max(wake, now + 1us);
}

// Who is fast is soon elsewhere.
Duration PlannerNode::calm_period(Utime now) const {
  const double speed_mps = own_->at(now).velocity.cwiseAbs().maxCoeff();
  return to_duration(std::min(config_.calm_period_s, kCalmWay_m / std::max(speed_mps, 1e-3)));
}

// The newest plan leads to where the robot is to go and is flown, and that keeps clear of all that is known; but who
// sees by itself knows less, and each scan says more.
bool PlannerNode::is_calm(Utime now) const {
  return seen_.num_frames == 0 && newest_ != nullptr && newest_->fly && planned_to_ == destination() &&
         flies_newest() && keeps_clear(*own_, map_, peer_list_, config_.planner.space.blocked_m(), now);
}

bool PlannerNode::flies_newest() const {
  return !asked_ || (!own_->next.empty() ? own_->next : own_->committed).start_utime() == *asked_;
}

Utime PlannerNode::touch_utime(Utime now, Utime until) const {
  return first_touch(map_, *own_, config_.planner.space.blocked_m(), now, until);
}

// Late enough for the peers' answers; but an obstacle's way is left before it comes, and the earlier the more time
// there is for answers until then.
Utime PlannerNode::start_utime(Utime now, bool is_slow) {
  const Utime planned = now + to_duration(delay_of(is_slow).lead_s());
  const Utime patient = planned + to_duration(commit_delay_.lead_s());
  const Utime touch = touch_utime(now, patient + kUrgent);
  urgent_start_.reset();
  if (touch == kNever) return patient;
  const Utime answered = planned + to_duration(commit_delay_.usual_s()) + kLastMoment;
  const Utime early = std::max(answered, touch - kUrgent), late = touch - kGetAway;
  urgent_start_ = std::max(planned + 2 * kLastMoment, std::min(early, late));
  return *urgent_start_;
}

void PlannerNode::forget_peers(Utime now) {
  if (!peers_come_and_go_) return;
  for (auto entry = peers_.begin(); entry != peers_.end();) {
    if (now - std::min(entry->second.told, now) < kElsewhere) {
      ++entry;
      continue;
    }
    const std::size_t place = entry->second.place;
    peer_list_.erase(peer_list_.begin() + static_cast<std::ptrdiff_t>(place));
    entry = peers_.erase(entry);
    for (auto& other : peers_) other.second.place -= other.second.place > place ? 1 : 0;
  }
}

void PlannerNode::plan(Utime now, Outbox& outbox) {
  forget_peers(now);
  if (planned_ && planned_->took_s > delay_of(planned_->is_slow).lead_s()) {  // it came too late to be announced
    delay_of(planned_->is_slow).took(planned_->took_s);
    planned_.reset();
  }
  request_.sogm = &map_;
  const bool sees = seen_.num_frames > 0 && seen_.geometry.resolution_m == map_.geometry.resolution_m &&
                    map_.start_utime - seen_.start_utime < kMaxAge;
  request_.seen = sees ? &seen_ : nullptr;
  request_.own = *own_;
  request_.margin_m = margin_m_;
  // Without a goal the robot holds its place, but steps aside like any other.
  if (!hold_) hold_ = own_->at(own_->end_utime()).position;
  const bool is_on_mission = flight_.led_to == flight_status_t::kGoal && !mission_.empty();
  if (is_on_mission) mission_.pass(now, own_->at(now));
  request_.goal = destination().value_or(*hold_);
  request_.v_max_mps = is_on_mission ? mission_.waypoint().speed_mps : config_.planner.limits.v_max_mps;
  const bool is_slow = planner_.is_slow(request_);
  request_.start_utime = start_utime(now, is_slow);
  const bool is_urgent = urgent_start_.has_value();
  for (auto& [id, entry] : peers_) {
    entry.heard = std::min(entry.heard, now);
    peer_list_[entry.place].silent = now - entry.heard > kSilent;
  }
  request_.peers = &peer_list_;
  std::optional<Eigen::Vector3d> aside = give_way_.place(now, request_, planner_);
  // A plan that must do without answers may meet others': it only steps aside.
  if (is_urgent && commit_delay_.is_unanswered()) aside = own_->at(own_->end_utime()).position;
  request_.is_aside = aside.has_value();
  request_.goal = aside.value_or(request_.goal);
  if (!planner_.knows_ways(request_) && ways_utime_ != map_.start_utime) {
    planner_.work_out_ways(request_);
    ways_utime_ = map_.start_utime;
    if (durations_count_) return;  // it took as long as many plans: then anew, by the time it is then
  }
  map_is_new_ = false;
  plan_.done(now);
  planned_to_ = destination();
  newest_ = &planner_.plan(request_);
  ++plans_;
  plan_times_.push_back(now);
  asked_.reset();
  if (newest_->fly && !is_hover_again(request_.own, newest_->trajectory)) {
    sogm_swarm::candidate_t candidate{};
    candidate.header = candidate_headers_.next(now);
    Trajectory trajectory = newest_->trajectory;
    trajectory.set_seq(++candidate_seq_);
    candidate.trajectory = trajectory.to_wire();
    candidate.urgent = is_urgent ? 1 : 0;
    asked_ = trajectory.start_utime();
    planned_ = {now, trajectory.start_utime(), durations_count_ ? newest_->total_ms() / 1000.0 : 0.0, is_slow};
    outbox.publish(BusId::kOnboard, channel::kCandidate, candidate);
    publish_corridors(now, outbox);
  }
  publish_status(now, planning_state(), outbox);
  planner_.prepare(request_);
}

// After the clock was set back, it may be of the future.
bool PlannerNode::is_stale(Utime now) const {
  return check_time(map_.start_utime, now, to_duration(config_.stale_map_s), to_duration(config_.clock_limit_s)) !=
         Refusal::kNone;
}

std::int16_t PlannerNode::state(Utime now) const {
  if (map_.num_frames == 0) return planner_status_t::kNoMap;
  if (is_stale(now)) return planner_status_t::kStaleMap;
  if (!own_) return planner_status_t::kNoCommitted;
  if (!is_led()) return planner_status_t::kNotLed;
  return destination() ? planning_state() : planner_status_t::kNoGoal;
}

Activity PlannerNode::activity(Utime now) const {
  switch (state(now)) {
    case planner_status_t::kNoMap:
      return waits_for(channel::kSogm);
    case planner_status_t::kStaleMap:
      return waits_for(channel::kSogm, "the last one is " + fixed(to_seconds(now - map_.start_utime), 1) + " s old");
    case planner_status_t::kNoCommitted:
      return waits_for(channel::kOwnTrajectory);
    case planner_status_t::kNoGoal:
      return waits_for(channel::kGoal);
    case planner_status_t::kNotLed:
      return {.text = "plans nothing: the robot stands, goes straight up or down, or a pilot flies it"};
    default:
      break;
  }
  const std::string goal = text_of(*destination());
  const bool is_of_this_goal = request_.goal == *destination();
  if (planning_state() == planner_status_t::kPlanning || !is_of_this_goal) return {.text = "plans to " + goal};
  return {true, "plans, but no way leads to " + goal, "by all that is known to stand still"};
}

std::int16_t PlannerNode::planning_state() const {
  return newest_ != nullptr && newest_->is_unreachable ? planner_status_t::kUnreachable : planner_status_t::kPlanning;
}

void PlannerNode::publish_corridors(Utime now, Outbox& outbox) {
  sogm_swarm::corridors_t message{};
  message.header = corridor_headers_.next(now);
  message.trajectory_seq = candidate_seq_;
  for (std::size_t piece = 0; piece < newest_->corridors.size(); ++piece) {
    const Polytope& polytope = newest_->corridors[piece];
    for (int i = 0; i < polytope.num_faces() && std::ssize(message.faces) < kMaxFaces; ++i) {
      sogm_swarm::face_t face;
      face.piece = static_cast<std::int16_t>(piece);
      for (int axis = 0; axis < 3; ++axis) face.normal[axis] = static_cast<float>(polytope.normals(i, axis));
      face.offset = static_cast<float>(polytope.offsets(i));
      message.faces.push_back(face);
    }
  }
  message.num_faces = static_cast<std::int32_t>(message.faces.size());
  outbox.publish(BusId::kOnboard, channel::kCorridors, message);
}

void PlannerNode::publish_status(Utime now, std::int16_t state, Outbox& outbox) {
  while (!plan_times_.empty() && plan_times_.front() <= now - 1s) plan_times_.pop_front();
  while (!plan_times_.empty() && plan_times_.back() > now) plan_times_.pop_back();
  planner_status_t status{};
  status.header = status_headers_.next(now);
  status.state = state;
  status.plans = plans_;
  status.missed = missed_;
  status.rate_hz = static_cast<float>(plan_times_.size());
  status.margin = static_cast<float>(margin_m_);
  status.waypoint = mission_.index();
  status.num_waypoints = mission_.size();
  if (const auto to = destination()) Eigen::Map<Eigen::Vector3d>(status.destination) = *to;
  if (newest_ != nullptr) {
    status.outcome = static_cast<std::int16_t>(newest_->outcome);
    status.expansions = newest_->expansions;
    if (durations_count_) {
      float* const step_ms[kNumPlanSteps] = {&status.compose_ms, &status.search_ms, &status.corridor_ms,
                                             &status.optimize_ms, &status.check_ms};
      for (std::size_t i = 0; i < kNumPlanSteps; ++i) *step_ms[i] = static_cast<float>(newest_->step_ms[i]);
      status.total_ms = static_cast<float>(newest_->total_ms());
      status.prepare_ms = static_cast<float>(newest_->prepare_ms);
    }
  }
  refused_.copy_to(status.refused);
  outbox.publish(BusId::kOnboard, channel::kPlannerStatus, status);
  status_.done(now);
}

}  // namespace swarm
