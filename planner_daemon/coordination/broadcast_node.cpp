// Long because a daemon's whole reaction to each message, and all that it says, is to be read in one place; what it
// decides is in commit_protocol.h, flight_state.h, identity.h, clock_offset.h and tracking_monitor.h.
#include "planner_daemon/coordination/broadcast_node.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <set>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "lcmtypes/bus/portable_math.h"
#include "lcmtypes/bus/text.h"
#include "planner_daemon/coordination/cell.h"

namespace swarm {
namespace {

using sogm_swarm::announcement_t;
using sogm_swarm::broadcast_status_t;
using sogm_swarm::flight_status_t;

constexpr Duration kStatusPeriod = 1s;
constexpr Duration kLegPeriod = 200ms;  // between proposals of the way up or down
constexpr Duration kClockDoubt = 1s;
constexpr Duration kLively = 300ms;            // after news, at most
constexpr std::int64_t kMostLost = 1'000'000;  // that are counted, of a peer: the sum of all fits its field
constexpr Duration kNeverHeard = 10s;          // after its start a robot has heard all that are there
constexpr Duration kSlept = 500ms;             // between two steps: far more than between two setpoints
constexpr Duration kVotePeriod = 100ms;
constexpr Duration kWordsPeriod = 500ms;    // and fifty times as seldom as announcements may come
constexpr Duration kStrangerPeriod = 20ms;  // at most so often the planner is told of one
constexpr int kMostJudged = 4;              // peers at once: far less time than between two setpoints
constexpr double kLeastCell_m = 1.0;        // smaller ones are so many that no announcement holds them
constexpr double kTurns_mps = 0.3;          // faster, a robot looks where it flies
constexpr double kTurns_m = 0.05;           // else to where its motion ends, where that is farther
constexpr double kHere_m = 0.02;            // a robot that stands is where it is bound to be
constexpr double kResume_m = 0.5;           // a kept motion is gone on with where the robot is so close to it

double wrap_angle(double angle) {
  return std::remainder(angle, 2 * std::numbers::pi);
}

// As it is by a clock that is `ahead`. Times stay within what a message may say: a peer may say any.
void shift(Duration ahead, announcement_t* message) {
  const auto later = [ahead](std::int64_t* utime) {
    *utime = std::clamp<std::int64_t>(*utime + ahead.count(), 0, to_us(kMaxUtime));
  };
  later(&message->header.utime);
  later(&message->committed.start_utime);
  if (message->pending_state == announcement_t::kNone) return;
  later(&message->pending.start_utime);
  later(&message->pending_stamp);
}

bool ends_in_time(const announcement_t& message) {
  const Utime end = std::max(motion_of(message).end_utime(), pending_of(message).end_utime());
  return end <= to_utime(message.header.utime) + kMaxMotion;
}

// Somewhere in [1/2, 3/2) of the gap, elsewhere after each announcement: robots that hear one at the same time would
// otherwise speak at the same time again and again, and what collides in the air is lost.
Duration scattered(Duration gap, const sogm_swarm::header_t& header) {
  const auto number = static_cast<std::uint64_t>(header.seq) << 16 | static_cast<std::uint16_t>(header.robot_id);
  return gap / 2 + gap * static_cast<std::int64_t>(number * 0x9E3779B97F4A7C15u >> 54) / 1024;
}

CommitProtocol::Rules rules_of(const BroadcastConfig& config, std::int32_t boot) {
  return {config.robot_id, boot, config.roster, config.radius_m, config.separation_m, config.clock_error_s};
}

std::optional<CellProtocol> in_cells(const BroadcastConfig& config, std::int32_t boot) {
  if (config.cell_m == 0.0) return std::nullopt;
  const auto cells_of = [edge_m = config.cell_m](const Motion& motion, Utime from, double reach_m) {
    return cells_touched(motion, from, reach_m, edge_m);
  };
  return CellProtocol({rules_of(config, boot), cells_of});
}

}  // namespace

void declare(OptionSet& options, BroadcastConfig& config) {
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("roster", &config.roster, 0, 32767, "ids of all robots that fly; this one may be among them");
  options.add("cells", &config.cell_m, 0, 1000, "m",
              "flies in cells with edges of this, each with a keeper, and by no roster; 0: by the roster");
  options.add("radius", &config.radius_m, 0.01, 10, "m", "of the sphere that holds the robot");
  declare(options, config.limits);
  options.add("separation", &config.separation_m, 0, 10, "m", "kept between the surfaces of committed motions");
  options.add("announce-period", &config.announce_s, 0.005, 10, "s", "repetition of the announcement");
  options.add("rest-period", &config.rest_s, 0.005, 10, "s", "repetition of the announcement while the robot hovers");
  options.add("lively-period", &config.lively_s, 0.005, 10, "s",
              "repetition right after news, as long as peers wait for them: they may get lost");
  options.add("swarm-rate", &config.swarm_rate_hz, 1, 100'000, "Hz",
              "announcements of all robots of the roster together, in cells of the robot and its peers, at most");
  options.add("give-up-after", &config.give_up_after_s, 0, 1e6, "s",
              "a peer that was not heard for so long, 10 s after the start one that was never heard: once the majority "
              "of robots did not hear it, the others go on around it; 0: they wait for it for ever");
  options.add("setpoint-rate", &config.setpoint_rate_hz, 1, 1000, "Hz", "of setpoints");
  options.add("yaw-rate-max", &config.yaw_rate_max_radps, 0, 100, "rad/s",
              "how fast the robot turns into its direction of flight");
  options.add("error-bound", &config.error_bound_m, 0, 5, "m",
              "that the robot's radius grows by at most, by how far it lately was from its motion");
  options.add("off-course", &config.off_course_m, 0.05, 100, "m",
              "farther from its motion the robot has lost it: it brakes and goes on from where it is");
  options.add("space-min", &config.flight.space_min, -1e5, 1e5, "m",
              "flight space of the robot's centre, lower corner: who leaves it is led home");
  options.add("space-max", &config.flight.space_max, -1e5, 1e5, "m",
              "flight space of the robot's centre, upper corner");
  options.add("fence", &config.flight.fence_m, 0, 100, "m", "so far out of the flight space it is left");
  options.add("vertical-speed", &config.flight.vertical_mps, 0.1, 5, "m/s",
              "straight up from the ground and down to it, at most");
  options.add("battery-home", &config.flight.battery_home, 0, 1, "", "with less of it the robot flies home and lands");
  options.add("battery-land", &config.flight.battery_land, 0, 1, "", "with less of it the robot lands where it is");
  options.add("clock-error", &config.clock_error_s, 0, 1, "s",
              "clocks of two robots differ by at most this: motions are kept apart for it, and nothing is committed "
              "beyond it");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s",
              "the robot's own messages from further in the future are refused");
  options.add("state-dir", &config.state_dir,
              "directory, in memory as /run, where the robot's promises survive a crash of the daemon; none: they do "
              "not");
}

void verify(const BroadcastConfig& config) {
  verify(config.limits);
  for (int axis = 0; axis < 3; ++axis) {
    if (config.flight.space_min[axis] >= config.flight.space_max[axis])
      throw OptionError("--space-min: must be below --space-max on every axis");
  }
  if (config.flight.battery_land > config.flight.battery_home)
    throw OptionError("--battery-land: must be at most --battery-home");
  if (config.cell_m > 0.0 && !config.roster.empty())
    throw OptionError("--cells: who flies in cells must have no --roster");
  if (config.cell_m > 0.0 && config.cell_m < kLeastCell_m)
    throw OptionError("--cells: " + text_of(config.cell_m) + " m; must be at least " + text_of(kLeastCell_m) +
                      " m, or 0");
  std::set<int> robots(config.roster.begin(), config.roster.end());
  robots.insert(config.robot_id);
  if (std::ssize(robots) > kMaxRosterRobots) {
    throw OptionError("--roster: " + std::to_string(robots.size()) + " robots; at most " +
                      std::to_string(kMaxRosterRobots));
  }
}

BroadcastNode::BroadcastNode(const BroadcastConfig& config, PromiseStore& store, std::int32_t first_boot)
    : config_((verify(config), config)),
      store_(store),
      kept_(load_promise(store, config.robot_id, first_boot)),
      announcement_headers_(config.robot_id, kept_.boot),
      own_headers_(config.robot_id, kept_.boot),
      words_headers_(config.robot_id, kept_.boot),
      setpoint_headers_(config.robot_id, kept_.boot),
      status_headers_(config.robot_id, kept_.boot),
      flight_headers_(config.robot_id, kept_.boot),
      promise_headers_(config.robot_id, kept_.boot),
      cells_(in_cells(config, kept_.boot)),
      by_roster_(rules_of(config, kept_.boot)),
      protocol_(cells_ ? cells_->robot() : by_roster_),
      identity_(config.robot_id, kept_.boot, static_cast<int>(protocol_.peers().size())),
      tracking_(config.error_bound_m, config.off_course_m),
      flight_(config.flight, config.limits, kept_.flight) {
  std::set<int> robots(config.roster.begin(), config.roster.end());
  robots.insert(config.robot_id);
  places_.assign(robots.begin(), robots.end());
  for (const auto& [id, peer] : protocol_.peers()) links_[id];
  protocol_.remember(kept_.roster_crc, kept_.acks);
  gap_ = to_duration(static_cast<double>(places_.size()) / config.swarm_rate_hz);
}

std::vector<Subscription> BroadcastNode::subscriptions() const {
  std::vector<Subscription> subscriptions = {{BusId::kOnboard, channel::kRobotState},
                                             {BusId::kOnboard, channel::kCandidate},
                                             {BusId::kOnboard, channel::kOwnTrajectory},
                                             {BusId::kOnboard, channel::kFlightOrder},
                                             {BusId::kOnboard, channel::kVehicleStatus}};
  if (cells_) return subscriptions;  // on the swarm bus see listen_in_cells()
  for (const char* channel : {channel::kAnnouncement, channel::kLastWords})
    subscriptions.push_back({BusId::kSwarm, channel});
  return subscriptions;
}

void BroadcastNode::on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                               Outbox&) {
  Refusal refusal = Refusal::kNone;
  if (bus == BusId::kSwarm) {
    refusal = channel == channel::kLastWords             ? on_last_words(now, bytes)
              : kind_of(channel) == channel::kCellRoster ? on_cell_roster(now, bytes)
                                                         : on_peer(now, bytes);
  } else if (channel == channel::kRobotState) {
    refusal = on_state(now, bytes);
  } else if (channel == channel::kCandidate) {
    refusal = on_candidate(now, bytes);
  } else if (channel == channel::kOwnTrajectory) {
    refusal = on_own(now, bytes);
  } else if (channel == channel::kFlightOrder) {
    refusal = on_order(now, bytes);
  } else if (channel == channel::kVehicleStatus) {
    refusal = on_vehicle(now, bytes);
  }
  if (refusal != Refusal::kNone) refused_.count(refusal);
}

template <class T>
Refusal BroadcastNode::receive_onboard(Utime now, std::span<const std::uint8_t> bytes, SequenceGate& gate, T* message,
                                       Duration* ahead) const {
  const auto receive_at = [&](Utime time) {
    const TimeWindow window{time, kMaxAge, to_duration(config_.clock_limit_s)};
    return receive(bytes, FromRobot{config_.robot_id}, window, gate, message);
  };
  *ahead = offered_step_;
  const Refusal refusal = receive_at(now + offered_step_);
  if (refusal != Refusal::kTime || offered_step_ == 0us) return refusal;
  *ahead = 0us;  // on its way since before
  return receive_at(now);
}

Refusal BroadcastNode::on_state(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::robot_state_t state;
  Duration ahead{};
  const Refusal refusal = receive_onboard(now, bytes, state_gate_, &state, &ahead);
  if (refusal != Refusal::kNone) return refusal;
  state.header.utime -= ahead.count();
  measured_.position = Eigen::Vector3d(state.position);
  measured_.velocity = Eigen::Vector3d(state.velocity);
  if (motion()) return track(now, state), Refusal::kNone;
  const Eigen::Vector3d position(state.position);
  Motion first = kept_.motion.value_or(Motion{Trajectory::hover(1, now, position), {}});
  // Kept in another time, for the clock was set back since: it would be flown again. The last node's clock may have
  // been a little ahead.
  const bool is_of_another_time = kept_.utime > now + to_duration(config_.clock_limit_s);
  // Or the robot has been carried, or has lost its way.
  if (is_of_another_time || (first.at(now).position - position).norm() > kResume_m) {
    first = {Trajectory::hover(first.seq() + 1, now, position), {}};
  }
  cells_ ? cells_->start(first, kept_.forced_seq, kept_.cells) : protocol_.start(first, kept_.forced_seq);
  keep_promise(now);
  yaw_rad_ = state.yaw;
  return Refusal::kNone;
}

Refusal BroadcastNode::on_order(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::order_t order;
  Duration ahead{};
  const Refusal refusal = receive_onboard(now, bytes, order_gate_, &order, &ahead);
  if (refusal != Refusal::kNone || !motion()) return refusal;  // the operator asks again
  advance(now);
  if (order.order == sogm_swarm::order_t::kWithout) {
    flight_.answer(order, go_on_without(now, order.other_id) ? flight_status_t::kAccepted : flight_status_t::kNotNow);
    return Refusal::kNone;
  }
  const std::int16_t before = flight_.state();
  flight_.advance(now, robot(now));
  flight_.on_order(now, order, robot(now));
  if (flight_.state() != before) spdlog::info("ordered: {}", name_of_flight_state(flight_.state()));
  return Refusal::kNone;
}

bool BroadcastNode::go_on_without(Utime now, int id) {
  if (cells_ || !links_.contains(id)) return false;  // in cells it is for their keepers
  if (protocol_.give_up(id, keeper(now)))
    spdlog::warn("robot {} gives robot {} up: by the operator's word", config_.robot_id, id);
  return protocol_.peers().at(id).is_voted_out();
}

Refusal BroadcastNode::on_vehicle(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::vehicle_status_t vehicle;
  Duration ahead{};
  const Refusal refusal = receive_onboard(now, bytes, vehicle_gate_, &vehicle, &ahead);
  if (refusal == Refusal::kNone) flight_.on_vehicle(now, vehicle);
  return refusal;
}

FlightState::Robot BroadcastNode::robot(Utime now) const {
  return {measured_, *motion(), state(now) == broadcast_status_t::kFlying};
}

void BroadcastNode::fly(Utime now) {
  flight_.advance(now, robot(now));
  const auto is_here = [this](Utime utime) {
    return (motion()->at(utime).position - measured_.position).norm() < kHere_m;
  };
  const bool rests_here = is_here(now) && is_here(motion()->end_utime());
  if (flight_.take_rests_here() && !rests_here) {
    protocol_.force(Trajectory::hover(1, now, measured_.position));
    keep_promise(now);
    tracking_.back_on_course();
  }
  if (now < leg_.due(now, kLegPeriod) || !protocol_.pending().empty()) return;
  const std::optional<Trajectory> leg = flight_.next_leg(now, *motion());
  if (!leg) return;
  leg_.done(now);
  if (!identity_.has_twin(now)) (void)propose(now, *leg);
}

void BroadcastNode::track(Utime now, const sogm_swarm::robot_state_t& state) {
  const Utime utime = to_utime(state.header.utime);
  if (utime < motion()->committed.start_utime()) return;  // where it was bound to be then is not known any more
  const Eigen::Vector3d position(state.position), velocity(state.velocity);
  const bool was_off_course = tracking_.was_off_course(now);
  tracking_.saw(utime, (position - motion()->at(utime).position).norm());
  if (!tracking_.is_off_course()) return;
  if (!was_off_course)
    spdlog::warn("off course: the robot is {:.2f} m from its motion; it goes on from where it is",
                 tracking_.newest_m());
  protocol_.force(Trajectory::braking(1, utime, position, velocity, config_.limits));
  keep_promise(now);
  tracking_.back_on_course();
}

bool BroadcastNode::keep(Utime now, CellAnnouncement promise) {
  promise.robot.header = promise_headers_.next(now);
  promise.acks.clear();  // in cells they are void after a restart
  const std::vector<std::uint8_t> bytes = promise_bytes(std::move(promise), flight_.status());
  store_fails_ = bytes.empty() || !store_.save(bytes);
  return !store_fails_;
}

void BroadcastNode::keep_promise(Utime now) {
  keep(now, cells_ ? cells_->state() : CellAnnouncement{protocol_.promise(), {}, {}});
}

CommitProtocol::Keep BroadcastNode::keeper(Utime now) {
  return [this, now](const announcement_t& promise) { return keep(now, {promise, {}, {}}); };
}

CellProtocol::Keep BroadcastNode::keeper_in_cells(Utime now) {
  return [this, now](const CellAnnouncement& promise) { return keep(now, promise); };
}

Rejection BroadcastNode::propose(Utime now, const Trajectory& candidate, bool urgent) {
  if (!cells_) return protocol_.propose(now, candidate, urgent);
  const Rejection rejection = cells_->propose(now, candidate, keeper_in_cells(now), urgent);
  follow_peers();
  return rejection;
}

Refusal BroadcastNode::on_candidate(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::candidate_t message;
  Duration ahead{};
  const Refusal refusal = receive_onboard(now, bytes, candidate_gate_, &message, &ahead);
  if (refusal != Refusal::kNone) return refusal;
  ++candidates_;
  advance(now);
  Trajectory candidate = Trajectory::from_wire(message.trajectory);
  candidate.shift(-ahead);
  Rejection rejection = !flight_.is_led_by_planner() ? Rejection::kNotLed
                        : identity_.has_twin(now)    ? Rejection::kTwin
                                                     : examine(now, candidate);
  if (rejection == Rejection::kNone) rejection = propose(now, candidate, message.urgent != 0);
  ++rejected_[static_cast<std::size_t>(rejection)];
  if (in_vain_.count++ == 0) in_vain_.first = now;
  in_vain_.newest = now;
  ++in_vain_.rejected[static_cast<std::size_t>(rejection)];
  if (state(now) != broadcast_status_t::kFlying) in_vain_ = {};
  return Refusal::kNone;
}

Rejection BroadcastNode::examine(Utime now, const Trajectory& candidate) const {
  if (!motion()) return Rejection::kNoCommitted;
  const Utime start = candidate.start_utime();
  if (candidate.empty() || start <= now || start > now + kMaxAhead || candidate.end_utime() > now + kMaxMotion)
    return Rejection::kTime;
  const MotionState branch = motion()->at(start), first = candidate.knot(0);
  if ((branch.position - first.position).norm() > 1e-4 || (branch.velocity - first.velocity).norm() > 1e-3 ||
      (branch.acceleration - first.acceleration).norm() > 1e-2) {
    return Rejection::kDiscontinuous;
  }
  constexpr double kTolerance = 1.01;
  const Slack slack = Slack::of_rounded(kTolerance, candidate.piece_s());
  // Short pieces are looked at between their knots as well: they may be at rest there, and fast in between.
  const Duration step = std::min<Duration>(10ms, candidate.piece() / 8);
  for (Utime t = start; t < candidate.end_utime(); t += step) {
    const MotionState state = candidate.at(t);
    if (state.velocity.cwiseAbs().maxCoeff() > kTolerance * config_.limits.v_max_mps ||
        !config_.limits.can_follow(state, slack))
      return Rejection::kLimits;
  }
  return Rejection::kNone;
}

// Only what costs little: what it means is for judge_peers().
Refusal BroadcastNode::on_peer(Utime now, std::span<const std::uint8_t> bytes) {
  CellAnnouncement said;
  announcement_t& message = said.robot;
  // Its time comes last: a clock is not doubted for what was recorded and is played again.
  const auto from_peer = [this](const announcement_t& m) {
    if (!cells_ && !protocol_.is_of_roster(m)) return Refusal::kRobot;
    if (!links_.at(m.header.robot_id).gate.is_newer(m.header)) return Refusal::kSequence;
    return ends_in_time(m) ? Refusal::kNone : Refusal::kInconsistent;
  };
  const auto in_order = [this](const announcement_t& m) { return links_.at(m.header.robot_id).gate.pass(m.header); };
  const TimeWindow lately{now, kMaxAge, to_duration(config_.clock_error_s)};
  Refusal refusal = cells_ ? read_in_cells(bytes, &said) : decode_packed(bytes, &message);
  if (refusal == Refusal::kNone) {
    refusal = admit(message, from_peer, lately, in_order);
  } else if (!cells_ || (refusal != Refusal::kRobot && refusal != Refusal::kSequence)) {
    return refusal;
  }
  if (refusal == Refusal::kRobot && message.header.robot_id == config_.robot_id)  // multicast returns our own
    return identity_.is_of_twin(now, BusId::kSwarm, message.header) ? Refusal::kRobot : Refusal::kNone;
  // Others fly in its cells than its peers, and what is said in several of them comes as often.
  if (cells_ && (refusal == Refusal::kRobot || refusal == Refusal::kSequence)) return Refusal::kNone;
  if (refusal == Refusal::kRobot) return on_stranger(now, &message);
  if (refusal == Refusal::kTime) on_other_time(now, &message);
  if (refusal != Refusal::kNone) return refusal;
  const int id = message.header.robot_id;
  if (strangers_.forget(id)) protocol_.set_tombstones(strangers_.tombstones());
  Link& link = links_.at(id);
  if (link.boot == message.header.boot) {
    const std::int64_t missing = std::min(message.header.seq - link.seq - 1, kMostLost);  // any number may come
    link.lost = static_cast<std::int32_t>(std::min(link.lost + missing, kMostLost));
  }
  link.heard = now;
  link.clock.heard(now, to_utime(message.header.utime));
  if (told_about(said) == config_.robot_id && message.least_delay_us != announcement_t::kUnknown)
    link.clock.told(Duration(message.least_delay_us));
  if (link.clock.beyond(to_duration(config_.clock_error_s))) doubt_clock_of(id, now, -*link.clock.offset());
  link.boot = message.header.boot;
  link.seq = message.header.seq;
  link.newest = std::move(said);
  link.waits = true;
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
  const TimeWindow lately{now, kMaxAge, to_duration(config_.clock_error_s)};
  const Refusal refusal = admit(*message, from_stranger, lately, in_order);
  if (refusal != Refusal::kNone) return refusal;
  strangers_.heard(std::move(*message));
  protocol_.set_tombstones(strangers_.tombstones());
  return Refusal::kNone;
}

void BroadcastNode::relay_strangers(Utime now, Outbox& outbox) {
  while (auto message = strangers_.take_due(now, kStrangerPeriod)) {
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
  Link& link = links_.at(id);
  if (!is_by_other_clock || link.other_time.pass(message->header) != Refusal::kNone) return;
  shift(age, message);
  link.newest = {std::move(*message), {}, {}};
  link.waits = true;
  link.is_of_other_time = true;
}

// By a clock that is doubted it is not known when its robot moved.
Refusal BroadcastNode::on_last_words(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::last_words_t words;
  announcement_t message;
  const auto from_peer = [this](const sogm_swarm::last_words_t& m) {
    return links_.contains(m.header.robot_id) && links_.contains(m.robot_id) ? Refusal::kNone : Refusal::kRobot;
  };
  const TimeWindow lately{now, kMaxAge, to_duration(config_.clock_error_s)};
  Refusal refusal = decode(bytes, &words);
  if (refusal == Refusal::kNone && words.header.robot_id == config_.robot_id) return Refusal::kNone;  // our own
  if (refusal == Refusal::kNone) refusal = admit(words, from_peer, lately, AnyOrder());
  if (refusal == Refusal::kNone) refusal = unpack(words, &message);
  if (refusal == Refusal::kNone && !protocol_.is_of_roster(message)) refusal = Refusal::kRobot;
  if (refusal != Refusal::kNone) return refusal;
  if (!clocks_agree(now)) return Refusal::kTime;
  protocol_.learn(message, keeper(now));
  if (is_known(message)) links_.at(words.robot_id).last_words = std::move(message);
  return Refusal::kNone;
}

bool BroadcastNode::is_known(const announcement_t& message) const {
  const CommitProtocol::Peer& peer = protocol_.peers().at(message.header.robot_id);
  return peer.heard && std::pair(peer.boot, peer.seq) == std::pair(message.header.boot, message.header.seq);
}

bool BroadcastNode::is_silent(Utime now, const Link& link) const {
  const Duration after = to_duration(config_.give_up_after_s);
  if (after == 0us) return false;
  return link.boot >= 0 ? now - link.heard >= after : now - *began_ >= std::max(after, kNeverHeard);
}

bool BroadcastNode::is_in_vain(const CommitProtocol::Peer& peer, Link* link) const {
  if (std::exchange(link->answered_seq, peer.our_seq) != peer.our_seq || peer.is_never_answered()) link->in_vain = 0us;
  const bool asks = !protocol_.pending().empty() && peer.our_seq != protocol_.pending().seq();
  const bool errs = link->clock.beyond(to_duration(config_.clock_error_s));
  if (peer.heard && (asks || !peer.hears_us || errs)) link->in_vain += kVotePeriod;
  const Duration after = to_duration(config_.give_up_after_s);
  return after > 0us && link->in_vain >= after;
}

void BroadcastNode::give_up(Utime now) {
  if (!motion()) return;
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
    if (!(is_no_help || is_silent(now, link)) || !protocol_.give_up(id, keeper(now))) continue;
    spdlog::warn("robot {} gives robot {} up: it {}", config_.robot_id, id,
                 link.boot < 0 ? "was never heard"
                 : is_no_help  ? "does not answer, or its clock is wrong"
                               : "has fallen silent");
  }
}

void BroadcastNode::repeat_last_words(Utime now, Outbox& outbox) {
  const Duration period = std::max<Duration>(kWordsPeriod, 50 * gap_);
  if (now < words_.due(now, period)) return;
  words_.done(now);
  for (auto& [id, link] : links_) {
    const CommitProtocol::Peer& peer = protocol_.peers().at(id);
    if (!peer.heard || !(peer.given_up || peer.is_never_answered())) continue;
    if (clocks_agree(now) && protocol_.must_repeat(id)) {
      sogm_swarm::last_words_t words = last_words_of(&link.last_words);
      words.header = words_headers_.next(now);
      outbox.publish(BusId::kSwarm, channel::kLastWords, words);
    }
    announcement_t message = link.last_words;
    shift(offered_step_, &message);
    message.header.utime = to_us(now + offered_step_);  // a planner that started since takes it as new
    outbox.publish(BusId::kOnboard, channel::kPeerTrajectory, message);
  }
}

Utime BroadcastNode::judge_due(Utime now, Link& link) const {
  link.may_be_judged = std::min(link.may_be_judged, now + gap_);  // the clock may have been set back
  return link.waits ? std::max(link.may_be_judged, now) : kNever;
}

void BroadcastNode::judge_peers(Utime now, Outbox& outbox) {
  for (int judged = 0; judged < kMostJudged; ++judged) {
    const auto waits_longest = std::ranges::min_element(
        links_, {}, [&](auto& entry) { return std::pair(judge_due(now, entry.second), entry.second.heard); });
    if (waits_longest == links_.end()) return;
    auto& [id, link] = *waits_longest;
    if (judge_due(now, link) > now) return;
    link.may_be_judged = std::clamp(link.may_be_judged, now - gap_ / 2, now) + gap_ / 2;
    if (!link.is_of_other_time) {
      cells_ ? cells_->receive(now, link.newest) : protocol_.receive(now, link.newest.robot, keeper(now));
      if (is_known(link.newest.robot)) link.last_words = link.newest.robot;
    }
    shift(offered_step_, &link.newest.robot);
    outbox.publish(BusId::kOnboard, channel::kPeerTrajectory, link.newest.robot);
    link.waits = false;
    if (link.is_of_other_time) continue;
    if (identity_.outdo(now, protocol_.peers().at(id).our_boot, protocol_.commits() > 0)) {
      set_boot(identity_.boot());
      if (motion()) keep_promise(now);
    }
  }
}

// From here on messages are of this start.
void BroadcastNode::set_boot(std::int32_t boot) {
  for (HeaderSource* headers : {&announcement_headers_, &own_headers_, &words_headers_, &setpoint_headers_,
                                &status_headers_, &flight_headers_, &promise_headers_})
    *headers = HeaderSource(config_.robot_id, boot);
  protocol_.set_boot(boot);
}

Refusal BroadcastNode::on_own(Utime now, std::span<const std::uint8_t> bytes) {
  announcement_t message;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, {now}, AnyOrder(), &message);
  if (refusal != Refusal::kNone || !identity_.is_of_twin(now, BusId::kOnboard, message.header)) return refusal;
  identity_.give_way(now, message.header.boot);
  return Refusal::kRobot;
}

int BroadcastNode::told_about(const CellAnnouncement& message) const {
  const auto seq = static_cast<std::size_t>(message.robot.header.seq);
  if (!cells_) return places_[seq % places_.size()];
  if (message.acks.empty()) return -1;
  return std::next(message.acks.begin(), static_cast<std::ptrdiff_t>(seq % message.acks.size()))->first;
}

// For a while, and at least as long as the peer moves; but not of one that was given up meanwhile.
void BroadcastNode::doubt_clock_of(int id, Utime now, Duration ahead) {
  const CommitProtocol::Peer& peer = protocol_.peers().at(id);
  if (peer.given_up) return;  // nobody waits for it
  doubt_ = {id, ahead};
  const Utime rests = peer.heard ? std::min(peer.motion.end_utime(), now + kMaxMotion) : Utime();
  clock_doubt_until_ = std::max({clock_doubt_until_, now + kClockDoubt, rests});
}

bool BroadcastNode::on_clock_step(Utime now, Duration step) {
  offered_step_ = step;  // from here on only what is urgent is committed
  advance(now);
  const bool rests = !motion() || motion()->end_utime() <= now;
  if (rests) offered_step_ = 0us;
  if (step == 0us || !rests) return rests;
  const Utime then = now + step;
  tracking_.forget();
  flight_.shift(step);
  identity_.set_clock(then, step);
  for (auto& [id, link] : links_) {  // what they differed by is not what they differ by
    link.clock = ClockOffset();
    link.heard += step;
    shift(step, &link.last_words);
    link.may_be_judged += step;
  }
  if (began_) *began_ += step;
  stepped_ += step;
  // As long as it takes to measure the clocks anew, and as peers may fly on by theirs.
  clock_doubt_until_ = then + (links_.empty() ? kClockDoubt : kMaxMotion);
  clock_set_until_ = then + kMaxMotion;
  doubt_ = {};
  in_vain_ = {};
  cells_ ? cells_->set_clock(then, step) : protocol_.set_clock(then, step);
  if (motion()) keep_promise(then);
  return true;
}

void BroadcastNode::advance(Utime now) {
  // No doubt lasts longer; but it would, were the clock set back.
  clock_doubt_until_ = std::min(clock_doubt_until_, now + kMaxMotion);
  clock_set_until_ = std::min(clock_set_until_, now + kMaxMotion);
  identity_.advance(now);
  protocol_.doubt_clocks(!clocks_agree(now));
  protocol_.set_error_bound(tracking_.bound_m(now));
  cells_ ? cells_->advance(now, keeper_in_cells(now)) : protocol_.advance(now);
  if (cells_) follow_peers();
}

void BroadcastNode::commit(Utime now) {
  if (identity_.has_twin(now) || !protocol_.may_commit(now)) return;
  if (!(cells_ ? cells_->commit(keeper_in_cells(now)) : protocol_.commit(keeper(now)))) return;
  in_vain_ = {};
  has_own_news_ = true;
}

Utime BroadcastNode::step(Utime now, Outbox& outbox) {
  advance(now);
  commit(now);
  judge_peers(now, outbox);
  relay_strangers(now, outbox);
  if (!cells_) give_up(now);
  if (motion()) fly(now);
  advance(now);
  commit(now);
  if (cells_) listen_in_cells(outbox);
  const Duration setpoint_period = to_duration(1.0 / config_.setpoint_rate_hz);
  Utime wake = std::min(now + kStatusPeriod, strangers_.due_utime(now));
  for (auto& [id, link] : links_) wake = std::min(wake, judge_due(now, link));
  if (motion()) {
    const CommitProtocol::News news = cells_ ? cells_->take_news() : protocol_.take_news();
    if (news != CommitProtocol::News::kNone) {
      if (!has_news_) has_answers_alone_ = true, answers_since_ = now;
      if (news == CommitProtocol::News::kMore) has_answers_alone_ = false;
      has_news_ = true;
      news_.done(now);
    }
    if (now >= announce_due(now)) announce(now, outbox);
    if (has_own_news_) publish_own(now, protocol_.state(), outbox);
    cells_ ? show_tombstones(now, outbox) : repeat_last_words(now, outbox);
    if (now >= setpoint_.due_on_grid(now, setpoint_period)) {
      if (!identity_.gives_way(now)) publish_setpoint(now, outbox);
      setpoint_.done(now);
    }
    const Utime due = cells_ ? cells_->due_utime(now) : protocol_.due_utime(now);
    wake = std::min({wake, setpoint_.due_on_grid(now, setpoint_period), due, announce_due(now)});
  }
  if (now >= status_.due(now, kStatusPeriod)) {
    publish_status(now, outbox);
    status_.done(now);
  }
  if (flight_.take_news()) {
    if (motion()) keep_promise(now);
    flight_status_ = Recurring();
  }
  if (now >= flight_status_.due(now, kStatusPeriod)) {
    publish_flight_status(now, outbox);
    flight_status_.done(now);
  }
  return std::max(std::min({wake, status_.due(now, kStatusPeriod), flight_status_.due(now, kStatusPeriod)}), now + 1us);
}

// News at once, but for answers: the first of several waits for others, nearly as long as announcements are apart.
// And again soon while somebody waits for them, for they may get lost.
Utime BroadcastNode::announce_due(Utime now) {
  if (has_news_) {  // the clock may have been set back
    news_may_go_ = std::min(news_may_go_, now + 2 * gap_);
    answers_since_ = std::min(answers_since_, now);
    return has_answers_alone_ ? std::max(news_may_go_, answers_since_ + pause_ * 3 / 4) : news_may_go_;
  }
  const bool is_lively =
      now < news_.due(now, kLively) && (cells_ ? cells_->is_awaited(now) : protocol_.is_awaited(now));
  const double period_s = is_lively ? config_.lively_s : protocol_.rests(now) ? config_.rest_s : config_.announce_s;
  return announcement_.due(now, std::max(gap_, to_duration(period_s)));
}

void BroadcastNode::announce(Utime now, Outbox& outbox) {
  CellAnnouncement said = cells_ ? cells_->state() : CellAnnouncement{protocol_.state(), {}, {}};
  announcement_t& message = said.robot;
  message.header = announcement_headers_.next(now);
  identity_.said(BusId::kSwarm, message.header);
  if (const auto link = links_.find(told_about(said)); link != links_.end()) {
    const auto delay = link->second.clock.least_delay();
    if (delay) message.least_delay_us = static_cast<std::int32_t>(delay->count());
  }
  const sogm_swarm::header_t header = message.header;
  if (cells_) {
    announce_in_cells(&said, outbox);
  } else {
    outbox.publish(BusId::kSwarm, channel::kAnnouncement, pack(&message));
  }
  publish_own(now, std::move(message), outbox);
  protocol_.said();
  has_news_ = false;
  announcement_.done(now);
  pause_ = scattered(gap_, header);
  news_may_go_ = std::clamp(news_may_go_, now - gap_, now) + pause_;
}

// As it was announced, and when the planner has to know before peers do.
void BroadcastNode::publish_own(Utime now, announcement_t message, Outbox& outbox) {
  message.header.utime = to_us(now);
  shift(offered_step_, &message);
  message.header = own_headers_.next(to_utime(message.header.utime));
  identity_.said(BusId::kOnboard, message.header);
  outbox.publish(BusId::kOnboard, channel::kOwnTrajectory, message);
  has_own_news_ = false;
}

void BroadcastNode::publish_setpoint(Utime now, Outbox& outbox) {
  const MotionState state = motion()->at(now);
  sogm_swarm::setpoint_t setpoint{};
  setpoint.header = setpoint_headers_.next(now);
  Eigen::Map<Eigen::Vector3d>(setpoint.position) = state.position;
  Eigen::Map<Eigen::Vector3d>(setpoint.velocity) = state.velocity;
  Eigen::Map<Eigen::Vector3d>(setpoint.acceleration) = state.acceleration;
  Eigen::Map<Eigen::Vector3d>(setpoint.jerk) = state.jerk;
  // Turn to where the robot flies: there is what is to be seen.
  const double turn = 1.0 / config_.setpoint_rate_hz * config_.yaw_rate_max_radps;
  const Eigen::Vector2d velocity = state.velocity.head<2>();
  const Eigen::Vector2d way = (motion()->at(motion()->end_utime()).position - state.position).head<2>();
  const bool is_fast = velocity.norm() > kTurns_mps;
  const Eigen::Vector2d& ahead = is_fast ? velocity : way;
  double step = 0.0;
  if (is_fast || way.norm() > kTurns_m)
    step = std::clamp(wrap_angle(direction(ahead.x(), ahead.y()) - yaw_rad_), -turn, turn);
  yaw_rad_ = wrap_angle(yaw_rad_ + step);
  setpoint.yaw = yaw_rad_;
  setpoint.yaw_rate = step * config_.setpoint_rate_hz;
  outbox.publish(BusId::kOnboard, channel::kSetpoint, setpoint);
}

std::int32_t BroadcastNode::lost() const {
  std::int32_t sum = 0;
  for (const auto& [id, link] : links_) sum += link.lost;
  return sum;
}

std::int16_t BroadcastNode::state(Utime now) const {
  if (!motion()) return broadcast_status_t::kNoState;
  if (store_fails_) return broadcast_status_t::kNoStorage;
  if (identity_.has_twin(now)) return broadcast_status_t::kTwin;
  if (!clocks_agree(now)) return broadcast_status_t::kClock;
  if (tracking_.was_off_course(now)) return broadcast_status_t::kOffCourse;
  return protocol_.all_hear() ? broadcast_status_t::kFlying : broadcast_status_t::kWaiting;
}

void BroadcastNode::publish_status(Utime now, Outbox& outbox) {
  broadcast_status_t status{};
  status.header = status_headers_.next(now);
  status.state = state(now);
  status.candidates = candidates_;
  status.commits = protocol_.commits();
  status.forced = protocol_.forced();
  status.withdrawn = protocol_.withdrawn();
  std::copy(rejected_.begin(), rejected_.end(), status.rejected);
  status.lost = lost();
  status.tracking_error = static_cast<float>(tracking_.newest_m());
  status.error_bound = static_cast<float>(tracking_.bound_m(now));
  for (const auto& [id, link] : links_) {
    if (link.boot < 0 || now - link.heard > 1s) continue;
    ++status.peers_heard;
    status.max_age_ms = std::max(status.max_age_ms, static_cast<float>(to_ms(now - link.heard)));
    const Duration offset = link.clock.offset().value_or(0us);
    status.max_clock_offset_ms =
        std::max(status.max_clock_offset_ms, static_cast<float>(to_ms(std::chrono::abs(offset))));
  }
  refused_.copy_to(status.refused);
  outbox.publish(BusId::kOnboard, channel::kBroadcastStatus, status);
}

void BroadcastNode::publish_flight_status(Utime now, Outbox& outbox) {
  flight_status_t status = flight_.status();
  status.header = flight_headers_.next(now + offered_step_);
  outbox.publish(BusId::kOnboard, channel::kFlightStatus, status);
}

}  // namespace swarm
