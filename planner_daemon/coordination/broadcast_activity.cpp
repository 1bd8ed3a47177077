// What the broadcast daemon says of itself, in its log and to who looks: why nothing is committed is what an operator
// asks first.
#include <algorithm>
#include <string>

#include "lcmtypes/bus/text.h"
#include "planner_daemon/coordination/broadcast_node.h"

namespace swarm {
namespace {

using sogm_swarm::broadcast_status_t;
using sogm_swarm::flight_status_t;

constexpr Duration kInVainFor = 3s;   // the planner sends candidates, and none is committed
constexpr Duration kStillAsked = 1s;  // the newest is no older; a peer that was not heard for so long is silent

void add(const std::string& separator, const std::string& item, std::string* list) {
  list->append(list->empty() ? "" : separator).append(item);
}

}  // namespace

Activity BroadcastNode::activity(Utime now) const {
  switch (state(now)) {
    case broadcast_status_t::kNoState:
      return waits_for(channel::kRobotState);
    case broadcast_status_t::kNoStorage:
      return {true, "commits nothing: --state-dir " + config_.state_dir + ": cannot be written", {}};
    case broadcast_status_t::kTwin:
      return {true, "commits nothing: another broadcaster speaks as robot " + std::to_string(config_.robot_id), {}};
    case broadcast_status_t::kClock:
      if (offered_step_ != 0us) return {true, "commits only what is urgent until it rests: the clock was set", {}};
      if (doubt_.id < 0) return {true, "commits nothing: the clock was set", "peers' clocks are measured anew"};
      return {true, "commits nothing: clocks differ",
              "robot " + std::to_string(doubt_.id) + "'s is " + fixed(std::abs(to_ms(doubt_.ahead)), 1) + " ms " +
                  (doubt_.ahead > 0us ? "ahead" : "behind")};
    case broadcast_status_t::kWaiting: {
      std::string peers;
      for (const auto& [id, peer] : protocol_.peers()) {
        if (peer.given_up) continue;
        const char* const what = strangers_.contains(id) ? " (is given another roster)" : " (never heard)";
        if (!peer.heard) add(", ", std::to_string(id) + what, &peers);
        if (peer.heard && !peer.hears_us) add(", ", std::to_string(id) + " (has not heard this start)", &peers);
      }
      return waits_for("robots " + peers);
    }
    default:
      return flight_activity(now);
  }
}

Activity BroadcastNode::flight_activity(Utime now) const {
  const bool is_in_vain =
      in_vain_.count > 0 && now - in_vain_.first >= kInVainFor && now - in_vain_.newest <= kStillAsked;
  const flight_status_t& flight = flight_.status();
  if (!is_in_vain) {
    std::string text = flight.state != flight_status_t::kFlying
                           ? text_of_flight(flight)
                           : "ready: commits what the planner sends and robots agree to";
    std::string given_up;
    for (const auto& [id, peer] : protocol_.peers())
      if (peer.given_up) add(", ", std::to_string(id), &given_up);
    if (!given_up.empty()) text += "; goes on without robots " + given_up;
    std::string strangers;
    for (const int id : strangers_.ids()) add(", ", std::to_string(id), &strangers);
    if (!strangers.empty()) text += "; keeps off strangers " + strangers + ", who are given another roster";
    return {.text = text};
  }
  std::string why = std::to_string(in_vain_.count) + " candidates";
  for (int i = 1; i < kNumRejections; ++i) {
    const std::int32_t count = in_vain_.rejected[static_cast<std::size_t>(i)];
    if (count > 0) why.append(", ").append(to_string(static_cast<Rejection>(i))).append(" ") += std::to_string(count);
  }
  const Motion& bound = *motion();
  const std::int32_t newest_seq = bound.next.empty() ? bound.committed.seq() : bound.next.seq();
  for (const auto& [id, peer] : protocol_.peers()) {
    const Duration silent = now - links_.at(id).heard;
    if (peer.given_up) {
      why += ", robot " + std::to_string(id) + " given up";
      continue;
    }
    if (silent > kStillAsked)
      why += ", robot " + std::to_string(id) + " silent for " + fixed(to_seconds(silent), 1) + " s";
    // Of one with a higher id nobody waits for the word.
    if (id < config_.robot_id && peer.our_verdict == sogm_swarm::ack_t::kNack && peer.our_seq > newest_seq)
      why += ", refused by robot " + std::to_string(id);
  }
  return {true, "commits nothing of what the planner sends", why};
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
