#include "tools/maps/save_node.h"

#include <algorithm>

#include "lcmtypes/bus/channels.h"

namespace swarm {
namespace {

using sogm_swarm::perception_status_t;

constexpr Duration kAgain = 3s;     // a request may get lost; the answer comes within a second of the last byte
constexpr Duration kHeard = 100ms;  // a status that is so much younger is of a daemon that was asked
constexpr Duration kMaxAge = 1s, kClockLimit = 100ms;

}  // namespace

std::vector<Subscription> SaveNode::subscriptions() const {
  return {{BusId::kOnboard, channel::kPerceptionStatus}};
}

void SaveNode::on_message(Utime now, BusId, std::string_view, std::span<const std::uint8_t> bytes, Outbox&) {
  perception_status_t status;
  const TimeWindow window{now, kMaxAge, kClockLimit};
  if (receive(bytes, FromRobot{robot_id_}, window, status_gate_, &status) != Refusal::kNone) return;
  is_full_ = status.map_state == perception_status_t::kMapFull;
  if (status.map_state == perception_status_t::kNoMap) {
    progress_ = Progress::kKeepsNone;
  } else if (!written_) {
    written_ = status.maps_written;
    progress_ = Progress::kAsked;
  } else if (status.maps_written != *written_) {
    progress_ = Progress::kWritten;
  } else if (status.map_state == perception_status_t::kMapNotWritten &&
             to_utime(status.header.utime) > asked_since_ + kHeard) {
    progress_ = Progress::kNotWritten;
  }
}

Utime SaveNode::step(Utime now, Outbox& outbox) {
  if (progress_ == Progress::kAsked && now >= asked_.due(now, kAgain)) {
    sogm_swarm::map_request_t request{};
    request.header = headers_.next(now);
    outbox.publish(BusId::kOnboard, channel::kSaveMap, request);
    asked_.done(now);
    asked_since_ = now;
  }
  return std::max(asked_.due(now, kAgain), now + 100ms);
}

}  // namespace swarm
