#include "planner_daemon/coordination/broadcast_node.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "lcmtypes/bus/portable_math.h"

namespace swarm {
namespace {

using sogm_swarm::announcement_t;

constexpr Duration kStatusPeriod = 1s;
constexpr Duration kLively = 300ms;  // after news, at most
constexpr Duration kLooksAhead = 1500ms;
constexpr double kTurns_m = 0.03;  // by then, at least

double wrap_angle(double angle) {
  return std::remainder(angle, 2 * std::numbers::pi);
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

}  // namespace

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
      cells_(in_cells(rules_of(config, kept_.boot), config.cell_m)),
      by_roster_(rules_of(config, kept_.boot)),
      agreement_(cells_ ? static_cast<FlightAgreement&>(*cells_) : by_roster_),
      protocol_(agreement_.robot()),
      identity_(config.robot_id, kept_.boot, static_cast<int>(protocol_.peers().size())),
      tracking_(config.error_bound_m, config.off_course_m),
      flight_(config.flight, config.limits, kept_.flight) {
  protocol_.remember(kept_.roster_crc, kept_.acks);
  follow_peers();
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
    const std::string_view kind = kind_of(channel);
    refusal = kind == channel::kLastWords          ? on_last_words(now, bytes)
              : kind == channel::kCellRoster       ? on_cell_roster(now, bytes)
              : kind == channel::kCellAnnouncement ? on_cell_announcement(now, bytes)
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

bool BroadcastNode::keep(Utime now, CellAnnouncement promise) {
  promise.robot.header = promise_headers_.next(now);
  promise.acks.clear();  // in cells they are void after a restart
  const std::vector<std::uint8_t> bytes = promise_bytes(std::move(promise), flight_.status());
  store_fails_ = bytes.empty() || !store_.save(bytes);
  return !store_fails_;
}

void BroadcastNode::keep_promise(Utime now) {
  keep(now, agreement_.promise());
}

FlightAgreement::Keep BroadcastNode::keeper(Utime now) {
  return [this, now](const CellAnnouncement& promise) { return keep(now, promise); };
}

Rejection BroadcastNode::propose(Utime now, const Trajectory& candidate, bool urgent) {
  const Rejection rejection = agreement_.propose(now, candidate, keeper(now), urgent);
  follow_peers();
  return rejection;
}

// From here on messages are of this start.
void BroadcastNode::set_boot(std::int32_t boot) {
  for (HeaderSource* headers : {&announcement_headers_, &own_headers_, &words_headers_, &setpoint_headers_,
                                &status_headers_, &flight_headers_, &promise_headers_})
    *headers = HeaderSource(config_.robot_id, boot);
  protocol_.set_boot(boot);
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
  strangers_.set_clock(step);
  for (auto& [id, link] : links_) {  // what they differed by is not what they differ by
    link.clock = ClockOffset();
    link.heard += step;
    shift(step, &link.last_words);
    link.turn.set_clock(step);
  }
  if (began_) *began_ += step;
  stepped_ += step;
  // As long as it takes to measure the clocks anew, and as peers may fly on by theirs.
  clock_doubt_until_ = then + (links_.empty() ? kClockDoubt : kMaxMotion);
  clock_set_until_ = then + kMaxMotion;
  doubt_ = {};
  in_vain_ = {};
  agreement_.set_clock(then, step);
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
  agreement_.advance(now, keeper(now));
  follow_peers();
}

void BroadcastNode::commit(Utime now) {
  if (identity_.has_twin(now) || !protocol_.may_commit(now) || !agreement_.commit(keeper(now))) return;
  in_vain_ = {};
  has_own_news_ = true;
}

Utime BroadcastNode::step(Utime now, Outbox& outbox) {
  advance(now);
  commit(now);
  judge_peers(now, outbox);
  relay_strangers(now, outbox);
  give_up(now);
  if (motion()) fly(now);
  advance(now);
  commit(now);
  listen_in_cells(outbox);
  const Duration setpoint_period = to_duration(1.0 / config_.setpoint_rate_hz);
  Utime wake = std::min(now + kStatusPeriod, strangers_.due_utime(now));
  for (auto& [id, link] : links_) wake = std::min(wake, link.turn.due(now, gap_));
  if (motion()) {
    const CommitProtocol::News news = agreement_.take_news();
    if (news != CommitProtocol::News::kNone) {
      if (!has_news_) has_answers_alone_ = true, answers_since_ = now;
      if (news == CommitProtocol::News::kMore) has_answers_alone_ = false;
      has_news_ = true;
      news_.done(now);
    }
    if (now >= announce_due(now)) announce(now, outbox);
    if (has_own_news_) publish_own(now, agreement_.state().robot, outbox);
    repeat_last_words(now, outbox);
    show_tombstones(now, outbox);
    if (now >= setpoint_.due_on_grid(now, setpoint_period)) {
      if (!identity_.gives_way(now)) publish_setpoint(now, outbox);
      setpoint_.done(now);
    }
    wake = std::min({wake, setpoint_.due_on_grid(now, setpoint_period), agreement_.due_utime(now), announce_due(now)});
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
  const bool is_lively = now < news_.due(now, kLively) && agreement_.is_awaited(now);
  const double period_s = is_lively ? config_.lively_s : protocol_.rests(now) ? config_.rest_s : config_.announce_s;
  return announcement_.due(now, std::max(gap_, to_duration(period_s)));
}

void BroadcastNode::announce(Utime now, Outbox& outbox) {
  CellAnnouncement said = agreement_.state();
  announcement_t& message = said.robot;
  message.header = announcement_headers_.next(now);
  identity_.said(BusId::kSwarm, message.header);
  if (const auto link = links_.find(agreement_.told_about(said)); link != links_.end()) {
    const auto delay = link->second.clock.least_delay();
    if (delay) message.least_delay_us = static_cast<std::int32_t>(delay->count());
  }
  const sogm_swarm::header_t header = message.header;
  say(&said, outbox);
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
  // Turn to where the robot will be: it flies around corners faster than it turns.
  const double turn = 1.0 / config_.setpoint_rate_hz * config_.yaw_rate_max_radps;
  const Eigen::Vector2d way = (motion()->at(now + kLooksAhead).position - state.position).head<2>();
  double step = 0.0;
  if (way.norm() > kTurns_m) step = std::clamp(wrap_angle(direction(way.x(), way.y()) - yaw_rad_), -turn, turn);
  yaw_rad_ = wrap_angle(yaw_rad_ + step);
  setpoint.yaw = yaw_rad_;
  setpoint.yaw_rate = step * config_.setpoint_rate_hz;
  outbox.publish(BusId::kOnboard, channel::kSetpoint, setpoint);
}

}  // namespace swarm
